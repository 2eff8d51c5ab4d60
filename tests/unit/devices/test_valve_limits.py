"""A valve at its limits: the last value that counts and the first that does not."""

import math

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
    status,
)

from device_profiles import VALVE_408
from hil_bench.devices.demand_generator import (
    CURVE_POINTS,
    DeadBand,
    DeadBandType,
    apply_directional_gain,
    follow_curve,
)
from hil_bench.devices.motion_profiles import Ramp, RampTimes
from hil_bench.devices.profile_objects import saturate
from hil_bench.devices.valve_408 import ValveDevice
from hil_bench.devices.valve_state_machine import LocalCommand, ValveState, ValveStateMachine
from hil_bench.errors import ParameterError, SdoAbort

VALUE, TOO_LOW, TOO_HIGH = 0x06090030, 0x06090032, 0x06090031
LIMITED, DEVIATION = 1 << 10, 1 << 11
SECOND = 1_000_000_000


@pytest.fixture
def rig(make_rig):
    """A valve in ACTIVE at 0 whose spool is where it is told to be."""
    return activate(fit_valve(make_rig(VALVE_408)))


@pytest.mark.parametrize("full_opening", [0.0, -0.0, -1e-3, math.inf, math.nan])
def test_the_spool_position_of_100_percent_is_a_positive_length(make_rig, full_opening):
    node = make_rig(VALVE_408).node
    with pytest.raises(ParameterError, match="spool position of 100 % is more than 0"):
        ValveDevice(node, full_opening)
    assert ValveDevice(node, 5e-324).full_opening == 5e-324


@pytest.mark.parametrize(
    ("setpoint", "expected", "limited"),
    [
        *((1000, 1000, 0), (1001, 1000, LIMITED), (999, 999, 0)),
        *((-2000, -2000, 0), (-2001, -2000, LIMITED), (-1999, -1999, 0)),
    ],
)
def test_a_set_point_at_its_limit_is_not_limited(rig, setpoint, expected, limited):
    set_up(rig, x6320=1000, x6321=-2000)
    assert demand(rig, setpoint) == expected
    assert status(rig) == ACTIVE | limited


def test_the_limits_may_meet_and_not_cross(rig):
    set_up(rig, x6320=1000, x6321=1000)
    assert rig.write(0x6321, 1, 1001, 2) == TOO_HIGH
    assert rig.write(0x6320, 1, 999, 2) == TOO_LOW
    assert demand(rig, 5000) == demand(rig, -5000) == 1000


def test_a_valve_without_scaling_and_gain_leaves_the_set_point_as_it_is(make_rig):
    rig = activate(fit_valve(make_rig(VALVE_408, without=(0x6322, 0x6341))))
    set_up(rig, x6323=1)  # an offset, so that the demand value is calculated
    assert demand(rig, 1001) == 1002
    assert demand(rig, -16384) == -16383


@pytest.mark.parametrize("reference", [1, 16384])
def test_100_percent_is_more_than_0(rig, reference):
    variable = rig.object_dictionary.variable(0x6311, 1)
    variable.write(reference)
    for refused in (0, -1):
        with pytest.raises(SdoAbort) as raised:
            variable.write(refused)
        assert raised.value.code == TOO_LOW
    assert variable.value == reference


@pytest.mark.parametrize(("kind", "last"), [(0x6330, 3), (0x6340, 1), (0x6342, 2)])
def test_a_type_beyond_the_last_is_refused(rig, kind, last):
    for value in range(last + 1):
        assert rig.write(kind, 0, value, 1) is None
    variable = rig.object_dictionary.variable(kind)
    for value in (-1, last + 1):
        with pytest.raises(SdoAbort):
            variable.write(value)
    assert variable.value == last


@pytest.mark.parametrize("size", [0x6343, 0x6344, 0x6345])
def test_the_sizes_of_the_dead_band_are_not_negative(rig, size):
    assert rig.write(size, 1, 0, 2) is None
    assert rig.write(size, 1, -1, 2, signed=True) == TOO_LOW


@pytest.mark.parametrize(
    ("factor", "abort"),
    [(0x0001_0001, None), (0x0000_0001, VALUE), (0x0001_0000, VALUE), (0xFFFF_FFFF, None)],
)
@pytest.mark.parametrize("index", [0x6322, 0x6341])
def test_a_factor_has_a_numerator_and_a_denominator(rig, index, factor, abort):
    assert rig.write(index, 0, factor, 4) == abort


def test_a_local_command_centres_the_spool_and_is_watched_for_a_second():
    local = LocalCommand()
    assert (local.control_word, local.setpoint) == (0, 0)
    assert not local.is_late(SECOND)
    assert local.is_late(SECOND + 1)
    local.watchdog = 0
    assert not local.is_late(3600 * SECOND)
    local.watchdog, local.control_word, local.setpoint = 5, 7, 100
    local.restart()
    assert (local.control_word, local.setpoint, local.watchdog) == (0, 0, 5)


@pytest.mark.parametrize("state", ValveState)
def test_a_twin_enters_the_state_that_is_reported(state):
    machine = ValveStateMachine()
    machine.start()
    machine.adopt(ValveState.ACTIVE)
    machine.adopt(state)
    assert machine.state is state
    # Of what was ACTIVE, the reaction ends in FAULT_HOLD; no other state waits for its end.
    after = ValveState.FAULT_HOLD if state is ValveState.FAULT_REACTION else state
    machine.end_reaction()
    assert machine.state is after


def test_a_start_ends_a_reaction_and_forgets_its_word():
    machine = ValveStateMachine()
    machine.adopt(ValveState.ACTIVE)
    machine.fault(takes_time=True)
    machine.start()
    assert machine.end_reaction() == ()
    assert machine.state is ValveState.INIT


def test_without_the_enable_input_a_reset_leads_up_to_disabled(rig):
    control(rig, 0x0007)
    rig.valve.enable_input = False
    rig.tick()
    assert status(rig) == 0x0009
    rig.valve.enable_input = True
    rig.tick()
    assert status(rig) == 0x0009  # a new control word is needed
    control(rig, 0x0007)
    assert status(rig) == ACTIVE


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        *((-5.0, -5), (-5.1, -5), (-4.6, -5), (-4.4, -4), (0.0, 0), (6.4, 6), (6.6, 7), (7.0, 7)),
        *((7.1, 7), (math.inf, 7), (-math.inf, -5), (math.nan, 3)),
    ],
)
def test_an_object_shows_the_nearest_value_that_it_holds(value, shown):
    assert saturate(value, -5, 7, unknown=3) == shown


def monitored(rig, milliseconds=3, upper=100, lower=-50):
    """Have the deviation be what `rig.deviation` says, and watched."""
    set_up(rig, x6352=milliseconds, x6354=upper, x6355=lower, x6351=1)
    rig.deviation = 0

    def work(now):
        rig.spool = rig.valve.command(now)
        rig.valve.publish(rig.spool - rig.deviation / 16384 * FULL_OPENING, now)

    rig.work = work
    control(rig, 0x0007)
    return rig


@pytest.mark.parametrize(("deviation", "trips"), [(100, 0), (101, 1), (-50, 0), (-51, 1)])
def test_a_deviation_trips_beyond_its_threshold_after_its_delay(rig, deviation, trips):
    monitored(rig).deviation = deviation
    rig.tick(3)  # seen at the first, 2 ms ago
    assert status(rig) == ACTIVE
    rig.tick()
    assert status(rig) == (FAULT_HOLD | DEVIATION if trips else ACTIVE)
    assert rig.value(0x6350, 1) == deviation
    rig.tick(5)
    assert rig.emcy_codes() == [0x8301] * trips
    rig.deviation = 0
    rig.tick()
    assert status(rig) == (FAULT_HOLD if trips else ACTIVE)
    assert rig.emcy_codes() == [0x0000] * trips


def test_a_deviation_that_is_back_in_time_begins_anew(rig):
    monitored(rig).deviation = 101
    rig.tick(3)
    rig.deviation = 100
    rig.tick()
    rig.deviation = 101
    rig.tick(3)
    assert status(rig) == ACTIVE
    rig.tick()
    assert status(rig) == FAULT_HOLD | DEVIATION


def test_a_reset_of_the_fault_starts_the_monitoring_anew(rig):
    monitored(rig).deviation = 101
    rig.tick(4)
    assert status(rig) == FAULT_HOLD | DEVIATION
    assert rig.value(0x604E) == 0x8301
    control(rig, 0x000F)  # the deviation is still there: 3 ms from now it trips again
    assert (status(rig), rig.value(0x604E)) == (HOLD, 0)
    rig.tick(2)
    assert status(rig) == HOLD
    rig.tick()
    assert status(rig) == FAULT_HOLD | DEVIATION


BAND = DeadBand(DeadBandType.JUMP, side_a=2000, side_b=3000, threshold=100, reference=16384)


@pytest.mark.parametrize(
    ("value", "expected"),
    # Straight from (threshold, step) to (reference, reference): Moog 7.2.8.
    [
        *((0.0, 0.0), (99.0, 0.0), (100.0, 2000.0), (16384.0, 16384.0), (20000.0, 20000.0)),
        *((8242.0, 9192.0), (-99.0, 0.0), (-100.0, -3000.0), (-8242.0, -9692.0)),
        *((-16384.0, -16384.0), (-20000.0, -20000.0)),
    ],
)
def test_a_dead_band_jumps_at_its_threshold(value, expected):
    assert BAND.compensate(value) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("value", "expected"), [(50.0, 1000.0), (99.0, 1980.0), (100.0, 2000.0), (-50.0, -1500.0)]
)
def test_a_continuous_dead_band_rises_to_its_step(value, expected):
    band = BAND._replace(kind=DeadBandType.CONTINUOUS)
    assert band.compensate(value) == pytest.approx(expected)


def test_a_characteristic_is_straight_between_its_points_and_holds_beyond_its_ends():
    outputs = [number**2 for number in range(CURVE_POINTS)]  # its k-th point at -16384 + 128 k
    assert follow_curve(-20000.0, outputs) == 0
    assert follow_curve(-16384.0, outputs) == 0
    assert follow_curve(-16384.0 + 128, outputs) == 1
    assert follow_curve(-16384.0 + 128 * 2.5, outputs) == 6.5  # between 4 and 9
    assert follow_curve(16384.0 - 64, outputs) == (255**2 + 256**2) / 2
    assert follow_curve(16384.0, outputs) == 256**2
    assert follow_curve(20000.0, outputs) == 256**2


@pytest.mark.parametrize(
    ("factor", "positive", "negative"), [(0.5, 500.0, -1000.0), (1.0, 1000, -1000), (2, 1000, -500)]
)
def test_a_directional_gain_reduces_one_side(factor, positive, negative):
    assert apply_directional_gain(1000.0, factor) == positive
    assert apply_directional_gain(-1000.0, factor) == negative
    assert apply_directional_gain(0.0, factor) == 0.0


TIMES = RampTimes(1.0, 2.0, 3.0, 4.0)  # ns for one increment


@pytest.mark.parametrize(
    ("start", "target", "needed"),
    # Speeding up leaves 0, slowing down approaches it; a way through 0 does both.
    [
        *((0.0, 100.0, 100), (0.0, -100.0, 200), (100.0, 0.0, 300), (-100.0, 0.0, 400)),
        *((50.0, 100.0, 50), (-50.0, -100.0, 100), (100.0, 50.0, 150), (-100.0, -50.0, 200)),
        *((100.0, -100.0, 500), (-100.0, 100.0, 500)),
    ],
)
def test_a_ramp_takes_the_time_of_its_quadrants(start, target, needed):
    ramp = Ramp()
    ramp.times = TIMES
    ramp.restart(start)
    assert not ramp.is_running
    assert ramp.follow(target, 1000) == start
    assert ramp.is_running
    just_before = ramp.follow(target, 1000 + needed - 1)
    assert just_before != target
    assert ramp.is_running
    assert ramp.follow(target, 1000 + needed) == target
    assert not ramp.is_running
