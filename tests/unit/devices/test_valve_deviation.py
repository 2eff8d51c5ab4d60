"""Control deviation monitoring (Moog ACV manual, 7.15.1): bit 11, EMCY 0x8301, the fault."""

import pytest
from support.valves import ACTIVE, FAULT_HOLD, FULL_OPENING, HOLD, INIT, activate, control, status

from device_profiles import VALVE_408
from hil_bench.devices.valve_408 import ValveDevice

FAULT_INIT = 0x0000
DEVIATION = 1 << 11
EMCY, REGISTER = 0x8301, 0x21
INCREMENT = FULL_OPENING / 16384


@pytest.fixture
def rig(make_rig):
    """A valve in ACTIVE whose spool is jammed at `rig.spool`, monitored with the defaults."""
    rig = make_rig(VALVE_408)
    rig.valve = ValveDevice(rig.node, FULL_OPENING)
    rig.spool = 0.0

    def work(now):
        rig.command = rig.valve.command(now)
        rig.valve.publish(rig.spool, now)

    rig.work = work
    rig.tick()
    activate(rig)
    assert rig.write(0x6351, 0, 1, 1) is None
    rig.sent(0x085)
    return rig


def test_a_deviation_that_lasts_30_ms_is_a_fault(rig):
    control(rig, 0x0007, 8192)  # the first tick outside
    rig.tick(29)
    assert status(rig) == ACTIVE
    rig.tick()  # 30 ms after the first
    assert status(rig) == FAULT_HOLD | DEVIATION
    assert rig.value(0x604E) == EMCY
    assert rig.value(0x1001) == REGISTER
    assert rig.emcy_codes() == [EMCY]
    rig.tick()
    assert rig.command == 0.0  # the hold set-point


@pytest.mark.parametrize(
    ("setpoint", "trips"),
    # The default thresholds are 512 and -512; the spool is at 0.
    [(512, False), (513, True), (-512, False), (-513, True)],
)
def test_the_thresholds_themselves_are_inside(rig, setpoint, trips):
    control(rig, 0x0007, setpoint)
    rig.tick(40)
    assert (rig.value(0x604E) == EMCY) is trips


def test_upper_and_lower_threshold_are_different_objects(rig):
    assert rig.write(0x6354, 1, 100, 2) is None
    assert rig.write(0x6355, 1, -2000, 2, signed=True) is None
    control(rig, 0x0007, -1999)
    rig.tick(40)
    assert status(rig) == ACTIVE
    control(rig, 0x0007, 101)
    rig.tick(40)
    assert status(rig) == FAULT_HOLD  # back inside, by the hold set-point


def test_off_by_default_nothing_is_watched(rig):
    assert rig.write(0x6351, 0, 0, 1) is None
    control(rig, 0x0007, 8192)
    rig.tick(100)
    assert status(rig) == ACTIVE
    assert rig.emcy_codes() == []


def test_the_time_begins_anew_inside_the_thresholds(rig):
    control(rig, 0x0007, 8192)
    rig.tick(28)
    control(rig, 0x0007, 0)
    control(rig, 0x0007, 8192)
    rig.tick(29)
    assert status(rig) == ACTIVE
    rig.tick()
    assert status(rig) & DEVIATION


@pytest.mark.parametrize(
    ("index", "subindex", "value", "size"),
    [(0x6351, 0, 1, 1), (0x6352, 1, 30, 2), (0x6354, 1, 400, 2), (0x6355, 1, -400, 2)],
)
def test_the_time_begins_anew_when_a_parameter_is_written(rig, index, subindex, value, size):
    control(rig, 0x0007, 8192)
    rig.tick(20)
    # The server writes at the end of a tick: the next one is the first outside.
    assert rig.write(index, subindex, value, size, signed=value < 0) is None
    rig.tick(30)
    assert status(rig) == ACTIVE
    rig.tick()
    assert status(rig) & 0x000F == FAULT_HOLD


@pytest.mark.parametrize("delay", [0, 3])
def test_the_delay_can_be_another_or_0(rig, delay):
    assert rig.write(0x6352, 1, delay, 2) is None
    control(rig, 0x0007, 8192)
    for _ in range(delay):
        assert status(rig) == ACTIVE
        rig.tick()
    assert status(rig) == FAULT_HOLD | DEVIATION


def jam(rig):
    """Trip the monitoring with a spool that does not come back either."""
    rig.spool = 8192 * INCREMENT
    control(rig, 0x0007, 0)
    rig.tick(40)
    assert status(rig) == FAULT_HOLD | DEVIATION
    rig.sent(0x085)


def test_the_bit_stays_while_the_spool_is_jammed_and_goes_when_it_is_free(rig):
    jam(rig)
    rig.tick(100)
    assert status(rig) == FAULT_HOLD | DEVIATION
    rig.spool = 0.0
    rig.tick()
    assert status(rig) == FAULT_HOLD
    assert rig.emcy_codes() == [0x0000]
    assert rig.value(0x604E) == EMCY  # until the reset


def test_after_the_reset_a_jammed_spool_is_found_again(rig):
    jam(rig)
    control(rig, 0x000B)
    assert status(rig) == HOLD
    assert rig.value(0x604E) == 0
    rig.tick(29)
    assert status(rig) == HOLD
    rig.tick()
    assert status(rig) == FAULT_HOLD | DEVIATION
    assert rig.emcy_codes() == [0x0000, EMCY]


def test_it_is_watched_in_every_state(rig):
    control(rig, 0x0000)
    assert status(rig) == INIT
    rig.spool = 8192 * INCREMENT
    rig.tick(31)
    assert status(rig) == FAULT_INIT | DEVIATION


def test_switching_it_off_takes_the_error_back(rig):
    jam(rig)
    assert rig.write(0x6351, 0, 0, 1) is None
    rig.tick()
    assert rig.emcy_codes() == [0x0000]
    assert status(rig) == FAULT_HOLD


def test_a_node_reset_forgets_it(rig):
    jam(rig)
    rig.nmt(rig.RESET_NODE)
    rig.tick(100)
    assert status(rig) == INIT


def test_a_lasting_deviation_is_no_new_fault_each_tick(rig):
    jam(rig)
    assert rig.write(0x1400, 5, 20, 2) is None
    control(rig, 0x0007)
    rig.tick(25)
    assert rig.value(0x604E) == 0x8250  # the RPDO time-out came later
    rig.tick(5)
    assert rig.value(0x604E) == 0x8250
