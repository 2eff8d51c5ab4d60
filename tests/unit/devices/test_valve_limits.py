"""A valve at its limits: the last value that counts and the first that does not."""

import math

import pytest
from support.valves import ACTIVE, activate, demand, fit_valve, set_up, status

from device_profiles import VALVE_408
from hil_bench.devices.bound_objects import saturate
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
    with pytest.raises(ParameterError, match=r"full_opening is .* spool position of 100 % is"):
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
    assert rig.write(kind, 0, last + 1, 1) == TOO_HIGH
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
    [(0x0001_0001, None), (0x0000_0001, VALUE), (0x0001_0000, VALUE), (0, VALUE)],
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


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        *((-5.0, -5), (-5.1, -5), (-4.6, -5), (-4.4, -4), (0.0, 0), (6.4, 6), (6.6, 7), (7.0, 7)),
        *((7.1, 7), (math.inf, 7), (-math.inf, -5), (math.nan, 3)),
    ],
)
def test_an_object_shows_the_nearest_value_that_it_holds(value, shown):
    assert saturate(value, -5, 7, unknown=3) == shown
