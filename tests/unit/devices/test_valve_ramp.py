"""The ramp between set-point and demand, over the bus. 16384 increments are 100 %, here 1 mm."""

import pytest
from support.valves import (
    ACTIVE,
    FAULT_HOLD,
    FULL_OPENING,
    HOLD,
    activate,
    control,
    demand,
    fit_valve,
    set_up,
)

from device_profiles import VALVE_408
from hil_bench.canopen_device.object_dictionary import Access
from hil_bench.devices.valve_408 import ValveDevice

RAMP_RUNNING, LIMITED = 1 << 9, 1 << 10


@pytest.fixture
def rig(make_rig):
    """A valve in ACTIVE at 0 whose spool is where it is told to be."""
    return activate(fit_valve(make_rig(VALVE_408)))


@pytest.mark.parametrize(
    ("types", "setpoint", "after_10_ms"),
    # From 0 to the set-point; 16384 * 10 ms / time.
    [
        ({"x6330": 1, "x6331": 100}, 16384, 1638),
        ({"x6330": 1, "x6331": 100}, -16384, -1638),
        ({"x6330": 2, "x6331": 200}, 16384, 819),
        ({"x6330": 2, "x6331": 200}, -16384, -819),
        ({"x6330": 3, "x6332": 400, "x6333": 50}, 16384, 410),
        ({"x6330": 3, "x6332": 400, "x6333": 50}, -16384, -3277),
        ({"x6330": 0, "x6331": 100}, 16384, 16384),
        ({"x6330": 3, "x6331": 100, "x6334": 100}, 16384, 16384),
    ],
)
def test_speeding_up(rig, types, setpoint, after_10_ms):
    set_up(rig, **types)
    demand(rig, setpoint)
    rig.tick(10)
    assert rig.value(0x6310, 1) == after_10_ms


@pytest.mark.parametrize(
    ("types", "start", "after_10_ms"),
    # From the start to 0; 16384 * 10 ms / time less.
    [
        ({"x6330": 1, "x6331": 100}, 16384, 14746),
        ({"x6330": 2, "x6331": 100, "x6334": 200}, 16384, 15565),
        ({"x6330": 2, "x6331": 100, "x6334": 200}, -16384, -15565),
        ({"x6330": 3, "x6335": 400, "x6336": 50}, 16384, 15974),
        ({"x6330": 3, "x6335": 400, "x6336": 50}, -16384, -13107),
    ],
)
def test_slowing_down(rig, types, start, after_10_ms):
    demand(rig, start)
    set_up(rig, **types)
    demand(rig, 0)
    rig.tick(10)
    assert rig.value(0x6310, 1) == after_10_ms


def test_the_ramp_ends_at_its_tick_and_says_so(rig):
    set_up(rig, x6330=1, x6331=100)
    assert demand(rig, 8192) == 0
    assert rig.value(0x6041) == ACTIVE | RAMP_RUNNING
    rig.tick(49)
    assert rig.value(0x6310, 1) == 8028  # 8192 * 49 / 50
    assert rig.value(0x6041) == ACTIVE | RAMP_RUNNING
    rig.tick()
    assert rig.value(0x6310, 1) == 8192  # half the way, half the time
    assert rig.value(0x6041) == ACTIVE


def test_a_ramp_switched_on_begins_where_the_valve_is(rig):
    demand(rig, 8192)
    set_up(rig, x6331=100, x6330=1)
    assert rig.value(0x6310, 1) == 8192
    demand(rig, 16384)
    rig.tick(10)
    assert rig.value(0x6310, 1) == 8192 + 1638


def test_a_ramp_switched_on_begins_at_the_scaled_set_point(rig):
    set_up(rig, x6322=0x0002_0001)
    demand(rig, 4096)
    set_up(rig, x6331=100, x6330=1)
    rig.tick()
    assert rig.value(0x6310, 1) == 8192
    assert rig.value(0x6041) == ACTIVE


def test_a_ramp_switched_off_is_at_its_end(rig):
    set_up(rig, x6331=100, x6330=1)
    demand(rig, 16384)
    set_up(rig, x6330=0)
    rig.tick()
    assert rig.value(0x6310, 1) == 16384
    assert rig.value(0x6041) == ACTIVE


def test_the_hold_setpoint_is_reached_on_the_ramp(rig):
    set_up(rig, x6331=100, x6330=1)
    demand(rig, 16384)
    rig.tick(100)
    control(rig, 0x0003)
    rig.tick(50)
    assert rig.value(0x6310, 1) == 8192
    assert rig.value(0x6041) == HOLD | RAMP_RUNNING


FAULT_REACTION, FAULT_DISABLED = 0x0007, 0x0001


def test_the_fault_reaction_lasts_as_long_as_the_ramp(rig):
    set_up(rig, x6331=100, x6330=1)
    rig.write(0x1400, 5, 110, 2)  # RPDO time-out [ms]
    demand(rig, 8192)
    rig.tick(109)  # 110 ms after the RPDO
    assert rig.value(0x6041) == FAULT_REACTION | RAMP_RUNNING
    assert rig.value(0x604E) == 0x8250
    rig.tick(49)
    assert rig.value(0x6310, 1) == 164  # 8192 / 50
    assert rig.value(0x6041) == FAULT_REACTION | RAMP_RUNNING
    rig.tick()
    assert rig.value(0x6310, 1) == 0
    assert rig.value(0x6041) == FAULT_HOLD


def test_nothing_is_reset_before_the_fault_reaction_is_over(rig):
    set_up(rig, x6331=100, x6330=1)
    rig.write(0x1400, 5, 110, 2)
    demand(rig, 8192)
    rig.tick(109)
    control(rig, 0x000F)
    assert rig.value(0x6041) == FAULT_REACTION | RAMP_RUNNING
    rig.tick(49)
    assert rig.value(0x6041) == FAULT_HOLD
    control(rig, 0x0007)
    control(rig, 0x000F)
    assert rig.value(0x6041) == HOLD


def test_without_the_enable_input_the_fault_reaction_leads_to_fault_disabled(rig):
    set_up(rig, x6331=100, x6330=1)
    rig.write(0x1400, 5, 110, 2)
    demand(rig, 8192)
    rig.tick(109)
    rig.valve.enable_input = False
    rig.tick(49)
    assert rig.value(0x6041) == FAULT_REACTION | RAMP_RUNNING
    rig.tick()
    assert rig.value(0x6041) == FAULT_DISABLED


def test_a_fault_reaction_without_a_way_to_go_is_over_at_once(rig):
    set_up(rig, x6331=100, x6330=1)
    rig.write(0x1400, 5, 50, 2)
    demand(rig, 0)
    rig.tick(49)
    assert rig.value(0x6041) == FAULT_HOLD


def test_a_node_reset_ends_the_ramp(rig):
    set_up(rig, x6331=100, x6330=1)
    demand(rig, 16384)
    rig.tick(50)
    rig.nmt(rig.RESET_NODE)
    rig.tick()
    assert rig.value(0x6310, 1) == 0
    assert not rig.value(0x6041) & RAMP_RUNNING


def test_a_write_to_another_function_does_not_hold_the_ramp_up(rig):
    set_up(rig, x6331=100, x6330=1)
    demand(rig, 16384)
    rig.tick(49)
    set_up(rig, x6324=7)  # takes one tick
    rig.tick(49)
    assert rig.value(0x6310, 1) == 16220 + 7  # 16384 * 99 / 100
    rig.tick()
    assert rig.value(0x6310, 1) == 16384 + 7


def test_another_reference_is_another_100_percent(rig):
    rig.object_dictionary.variable(0x6311, 1).access = Access.RW  # as in profile files
    set_up(rig, x6331=100, x6330=1, x6311=10000)
    demand(rig, 10000)
    rig.tick(10)
    assert rig.value(0x6310, 1) == 1000  # 10 ms of 100 ms
    assert rig.spool == pytest.approx(0.1 * FULL_OPENING)


def test_a_node_reset_leads_to_the_centre_whatever_the_default_ramp(make_rig):
    rig = make_rig(VALVE_408)
    for index, subindex, value in ((0x6330, 0, 1), (0x6331, 1, 100)):
        variable = rig.object_dictionary.variable(index, subindex)
        variable.default = variable.value = value
    rig.valve = ValveDevice(rig.node, FULL_OPENING)
    rig.work = lambda now: rig.valve.publish(rig.valve.command(now), now)
    rig.tick()
    rig.nmt(rig.START)
    demand(rig, 16384)
    rig.tick(50)
    assert rig.value(0x6310, 1) == 8192
    rig.nmt(rig.RESET_NODE)
    rig.tick()
    assert rig.value(0x6310, 1) == 0
