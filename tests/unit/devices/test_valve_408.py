"""The valve behind a real node. 100 % are 16384 increments (Moog ACV manual, 0x6311) and here 1 mm.

Status words: low four bits R M H D as in `test_valve_state_machine`; bit 4 local, bit 10 limit
(Moog, 0x6041).
"""

import math

import pytest
from support.valves import ACTIVE, DISABLED, HOLD, INIT, activate, control, fit_valve, status

from device_profiles import VALVE_408
from hil_bench.devices.valve_state_machine import ValveState


@pytest.fixture
def rig(make_rig):
    return fit_valve(make_rig(VALVE_408))


@pytest.fixture
def active(rig):
    """A valve that follows the bus, at 50 %."""
    activate(rig, 8192)
    assert rig.spool == 0.5e-3
    return rig


def test_after_power_on_the_valve_is_in_init_and_its_spool_in_the_centre(rig):
    assert status(rig) == INIT
    assert rig.spool == 0.0


def test_the_control_word_leads_to_active_in_one_go(active):
    assert status(active) == ACTIVE
    assert active.valve.state is ValveState.ACTIVE


@pytest.mark.parametrize(
    ("setpoint", "position"),
    # position = set-point / 16384 * 1 mm
    [(0, 0.0), (16384, 1e-3), (-16384, -1e-3), (1, 1e-3 / 16384), (-4096, -0.25e-3)],
)
def test_the_spool_follows_the_setpoint(active, setpoint, position):
    control(active, 0x0007, setpoint)
    assert active.spool == pytest.approx(position, abs=1e-15)
    assert active.value(0x6310, 1) == setpoint
    assert active.value(0x6301, 1) == setpoint


def test_tpdo1_carries_status_word_and_actual_value(active):
    # 0x000F and 8192 = 0x2000, both little endian.
    assert active.sent(0x185)[-1] == bytes.fromhex("0f00 0020")


def test_a_change_of_the_status_word_sends_tpdo1_at_once(active):
    active.tick(3)
    active.sent(0x185)
    control(active, 0x0003, 8192)  # 4 ms after the last one; the event timer is 10 ms
    assert active.sent(0x185) == [bytes.fromhex("0b00 0000")]


def test_without_a_change_tpdo1_comes_every_10_ms(active):
    active.sent(0x185)
    active.tick(30)
    assert len(active.sent(0x185)) == 3


@pytest.mark.parametrize(
    ("word", "expected"), [(0x0000, INIT), (0x0001, DISABLED), (0x0003, HOLD), (0x0007, ACTIVE)]
)
def test_only_active_follows_the_bus(rig, word, expected):
    rig.nmt(rig.START)
    assert rig.write(0x6314, 1, 4096, 2) is None
    control(rig, word, 8192)
    assert status(rig) == expected
    # The hold set-point: 4096 / 16384 * 1 mm.
    assert rig.spool == (0.5e-3 if expected == ACTIVE else 0.25e-3)


def test_device_mode_2_is_not_the_bus(active):
    assert active.write(0x6042, 0, 2, 1) is None
    active.tick()
    assert status(active) == ACTIVE
    assert active.spool == 0.0
    assert active.write(0x6042, 0, 1, 1) is None
    active.tick()
    assert active.spool == 0.5e-3


@pytest.mark.parametrize("command", ["STOP", "PRE_OPERATIONAL", "RESET_COMMUNICATION"])
def test_leaving_operational_drops_to_hold_in_the_same_tick(active, command):
    active.nmt(getattr(active, command))
    active.tick()
    assert status(active) == HOLD
    assert active.spool == 0.0


def test_a_node_reset_starts_in_init(active):
    active.nmt(active.RESET_NODE)
    active.tick()
    assert status(active) == INIT
    assert active.spool == 0.0


@pytest.mark.parametrize(
    "command", ["STOP", "PRE_OPERATIONAL", "RESET_COMMUNICATION", "RESET_NODE"]
)
def test_a_stale_control_word_does_not_bring_active_back(active, command):
    active.nmt(getattr(active, command))
    active.tick(2)
    active.nmt(active.START)
    active.tick(2)
    assert status(active) != ACTIVE
    assert active.spool == 0.0
    control(active, 0x0007, 8192)
    assert status(active) == ACTIVE
    assert active.spool == 0.5e-3


def test_leaving_operational_within_one_tick_is_not_missed(active):
    active.nmt(active.PRE_OPERATIONAL)
    active.nmt(active.START)
    active.tick()
    assert status(active) == HOLD


def test_a_word_after_the_return_to_operational_counts_in_the_same_tick(active):
    active.nmt(active.PRE_OPERATIONAL)
    active.nmt(active.START)
    control(active, 0x0007, 8192)
    assert status(active) == ACTIVE


def test_that_operational_was_left_counts_though_nobody_told(active):
    active.nmt(active.STOP)
    active.node.events.clear()
    active.tick()
    assert (status(active), active.spool) == (HOLD, 0.0)


def test_two_words_within_one_tick_both_count(active):
    # The first has the rising edge of R, the second would hide it.
    active.valve._machine.fault()
    active.receive(0x205, 0x0B, 0x00, 0x00, 0x00)
    active.receive(0x205, 0x03, 0x00, 0x00, 0x00)
    active.tick()
    assert status(active) == HOLD


def test_outside_operational_a_word_by_sdo_leads_no_further_than_hold(rig):
    assert rig.write(0x6040, 0, 0x0007, 2) is None
    rig.nmt(rig.START)  # in the very next tick
    rig.tick()
    assert status(rig) == HOLD


def test_local_control_leads_to_init_and_ignores_the_bus(active):
    assert active.write(0x604F, 0, 1, 1) is None
    active.tick()
    assert (status(active), active.spool) == (INIT | 0x0010, 0.0)
    control(active, 0x0007, 8192)
    assert status(active) == INIT | 0x0010
    assert active.write(0x604F, 0, 0, 1) is None
    active.tick()
    assert status(active) == INIT
    control(active, 0x0007, 8192)
    assert status(active) == ACTIVE


def test_setpoints_beyond_100_percent_need_wider_limits(active):
    control(active, 0x0007, 32767)
    assert (active.spool, status(active)) == (1e-3, ACTIVE | 0x0400)
    assert active.write(0x6320, 1, 32767, 2) is None
    active.tick()
    assert active.spool == pytest.approx(32767 / 16384 * 1e-3)
    assert status(active) == ACTIVE


@pytest.mark.parametrize(
    ("index", "subindex", "value", "size", "abort"),
    [
        (0x6320, 1, -16385, 2, 0x06090032),  # below the lower limit
        (0x6321, 1, 16385, 2, 0x06090031),  # above the upper limit
        (0x6042, 0, 0, 1, 0x06090032),
        (0x6042, 0, 3, 1, 0x06090031),
        (0x6043, 0, 1, 1, 0x06090032),  # spool position open loop
        (0x6043, 0, 4, 1, 0x06090030),  # pressure, without a sensor
        (0x6043, 0, 9, 1, 0x06090030),  # axis position, without a sensor
        (0x6043, 0, 10, 1, 0x06090031),
        (0x604F, 0, 2, 1, 0x06090031),
        (0x6041, 0, 0, 2, 0x06010002),
        (0x6301, 1, 0, 2, 0x06010002),
        (0x6311, 1, 0, 2, 0x06090032),
        (0x6311, 1, 10000, 2, None),
        (0x6314, 1, 100, 2, None),
        (0x6320, 1, -16384, 2, None),  # both limits equal is no contradiction
    ],
)
def test_writes_are_checked(rig, index, subindex, value, size, abort):
    assert rig.write(index, subindex, value, size, signed=value < 0) == abort


def place_spool(rig, position):
    def work(now):
        rig.valve.command(now)
        rig.valve.publish(position, now)

    rig.work = work
    rig.tick()


@pytest.mark.parametrize(
    ("position", "actual", "deviation"),
    # actual = position / 1 mm * 16384; deviation = 8192 - actual; both within INTEGER16
    [
        (0.25e-3, 4096, 4096),
        (0.75e-3, 12288, -4096),
        (0.0, 0, 8192),
        (3e-3, 32767, 8192 - 32767),
        (-3e-3, -32768, 32767),
        (math.inf, 32767, -24575),
    ],
)
def test_actual_value_and_control_deviation(active, position, actual, deviation):
    place_spool(active, position)
    assert active.value(0x6301, 1) == actual
    assert active.value(0x6350, 1) == deviation


def test_an_unknown_spool_position_leaves_the_last_one(active):
    place_spool(active, 0.25e-3)
    place_spool(active, math.nan)
    assert active.value(0x6301, 1) == 4096


def test_without_its_enable_input_the_valve_is_disabled(active):
    active.valve.enable_input = False
    active.tick()
    assert status(active) == DISABLED
    assert active.spool == 0.0
    control(active, 0x0007, 8192)
    assert status(active) == DISABLED
    active.valve.enable_input = True
    active.tick()
    assert status(active) == DISABLED  # the word that only still stands there does nothing
    control(active, 0x0007, 8192)
    assert status(active) == ACTIVE
