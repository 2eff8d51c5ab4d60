"""What the drivers promise, whatever bus each device is on: the same tests, the same bench."""

import math

import pytest
from support.patience import GUARD

from hil_bench.plants.hydraulic_cylinder.model import paper_parameters
from hil_drivers import (
    DeviceFaultError,
    DeviceMismatchError,
    DriverError,
    MotionProfile,
    PositionLoop,
    Reading,
    StaleValueError,
    ValveState,
)


@pytest.fixture
def rig(any_rig):
    any_rig.set_up()
    return any_rig


def values(rig):
    """What tells each value of each device."""
    return [
        lambda: rig.pressure_a.pressure,
        lambda: rig.pressure_a.is_valid,
        lambda: rig.pressure_b.reading,
        lambda: rig.position.position,
        lambda: rig.position.speed,
        lambda: rig.position.reading,
        lambda: rig.valve.state,
        lambda: rig.valve.spool_position,
        rig.valve.check_active,
    ]


def test_the_devices_tell_the_plants_rest(rig):
    rig.hold_still()
    parameters = paper_parameters()
    assert rig.valve.state is ValveState.INIT
    assert rig.valve.spool_position == pytest.approx(0.0, abs=1e-3)
    assert rig.pressure_a.is_valid
    # At rest the forces on the piston differ by no more than friction holds.
    pressures = rig.pressure_a.pressure, rig.pressure_b.pressure
    assert abs(pressures[0] * parameters.A_A - pressures[1] * parameters.A_B) <= parameters.F_s
    assert min(pressures) > 1e5


def test_a_reading_carries_unit_time_and_validity(rig):
    before = rig.network.now()
    rig.sample()
    pressure, position = rig.pressure_a.reading, rig.position.reading
    assert pressure == Reading(
        rig.pressure_a.pressure, "Pa", rig.pressure_a.received_at, is_valid=True
    )
    assert position == Reading(rig.position.position, "m", rig.position.received_at, is_valid=True)
    for reading in (pressure, position):
        assert before <= reading.received_at <= rig.network.now()


def test_before_the_first_value_there_is_none(near_rig):
    assert near_rig.pressure_a.age == math.inf
    for value in values(near_rig):
        with pytest.raises(StaleValueError, match="never"):
            value()


def test_an_old_value_is_refused(rig):
    rig.sample()
    for device in rig.devices:
        device.max_age = 0.05
    rig.network.pump_until(rig.network.now() + 0.1)
    for value in values(rig):
        with pytest.raises(StaleValueError, match="at most 50 ms are right"):
            value()


def test_the_valve_walks_its_states(rig):
    valve = rig.valve
    for act, state in (
        (valve.enable, ValveState.ACTIVE),
        (valve.hold, ValveState.HOLD),
        (valve.enable, ValveState.ACTIVE),
        (valve.disable, ValveState.DISABLED),
    ):
        act(timeout=GUARD)
        assert valve.read_state() is state
        rig.sample()
        assert valve.state is state


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_piston_follows_the_spool(rig, direction):
    rig.hold_still()
    start = rig.position.position
    rig.valve.enable(timeout=GUARD)
    rig.valve.spool_setpoint = 0.5 * direction
    assert rig.valve.spool_setpoint == 0.5 * direction
    rig.wait_until(lambda: rig.sample() or direction * (rig.position.position - start) > 0.01)
    assert rig.valve.spool_position == pytest.approx(0.5 * direction, abs=0.01)
    assert direction * rig.position.speed > 0.05
    rig.valve.hold(timeout=GUARD)
    rig.hold_still()
    assert rig.valve.spool_position == pytest.approx(0.0, abs=0.001)


def test_a_set_point_that_makes_no_sense_is_refused(near_rig):
    for fraction in (1.001, -2.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="a fraction from -1 to 1 is right"):
            near_rig.valve.spool_setpoint = fraction
        assert near_rig.valve.spool_setpoint == 0.0


def test_silence_is_a_fault_that_can_be_reset(near_rig):
    near_rig.set_up(command_timeout=0.5)
    valve = near_rig.valve
    valve.enable(timeout=GUARD)
    near_rig.wait_until(lambda: valve.read_state().is_fault)
    with pytest.raises(DeviceFaultError) as caught:
        valve.enable()
    assert caught.value.code >> 8 in {0x81, 0x82}  # communication, or its protocol (CiA 301)
    valve.reset_fault(timeout=GUARD)
    valve.enable(timeout=GUARD)
    assert valve.read_state() is ValveState.ACTIVE


def test_a_closed_valve_takes_silence_for_no_fault(near_rig):
    near_rig.set_up(command_timeout=0.3)
    near_rig.valve.enable(timeout=GUARD)
    near_rig.valve.close()
    state = near_rig.valve.read_state()
    assert state in {ValveState.DISABLED, ValveState.INIT}
    near_rig.network.pump_until(near_rig.network.now() + 0.5)
    assert near_rig.valve.read_state() is state


def test_another_device_under_the_address_is_refused(near_rig):
    with pytest.raises((DeviceMismatchError, ValueError)):
        near_rig.make("PositionSensor", 2).setup()


def test_a_device_that_is_not_there_is_an_error(near_rig):
    with pytest.raises(DriverError):
        near_rig.make("PositionSensor", 99).setup()


def test_a_lost_sensor_is_never_fresh_and_comes_back(near_rig):
    rig = near_rig
    rig.set_up()
    rig.sample()
    rig.pressure_a.max_age = 0.02
    value, then = rig.pressure_a.pressure, rig.pressure_a.received_at
    rig.lose()
    for _ in range(20):
        rig.network.pump_until(rig.network.now() + 0.005)
        rig.network.sync()
        try:
            rig.pressure_a.poll()
            assert rig.pressure_a.pressure == value
            assert rig.network.now() - then <= 0.02
        except DriverError:
            continue
    with pytest.raises(StaleValueError):
        rig.pressure_a.reading  # noqa: B018 - the property raises
    assert rig.pressure_a.received_at == then

    rig.regain()
    # Longer than any back-off that the attempts can have led to.
    rig.network.pump_until(rig.network.now() + 1.0)
    rig.sample()
    assert rig.pressure_a.reading.is_valid
    assert rig.pressure_a.received_at > then


def prepare_motion(rig):
    """A loop on the rig's devices, and a motion to 20 mm for it."""
    loop = PositionLoop(
        rig.network,
        valve=rig.valve,
        position=rig.position,
        pressures=(rig.pressure_a, rig.pressure_b),
        period=0.004,
    )
    profile = MotionProfile(loop.sample(), [0.02], speed=0.1, acceleration=1.0, dwell=1.0)
    return loop, profile


AT_TARGET = pytest.approx(0.02, abs=1e-4)
"""The controller's tolerance, and what the piston still moves while the valve closes [m]."""


def test_the_position_loop_follows_its_profile(near_rig):
    near_rig.set_up()
    loop, profile = prepare_motion(near_rig)
    near_rig.valve.enable(timeout=GUARD)
    records = list(loop.run(profile, profile.duration))
    near_rig.valve.hold(timeout=GUARD)
    near_rig.hold_still()
    assert near_rig.position.position == AT_TARGET
    assert loop.overruns == 0
    assert profile.duration - 2 * loop.period <= records[-1].time < profile.duration


def test_the_position_loop_comes_to_its_target_in_real_time(far_rig):
    """A busy machine leaves out cycles, so it may take longer than the profile.

    It is there where the controller has left it alone for 200 cycles: a valve that has just closed
    leaves pressures that still move the piston by 0.1 mm.
    """
    far_rig.set_up()
    loop, profile = prepare_motion(far_rig)
    far_rig.valve.enable(timeout=GUARD)
    cycles_at_rest = 0
    for record in loop.run(profile, GUARD):
        is_left_alone = record.spool_setpoint == 0.0 and record.position == AT_TARGET
        cycles_at_rest = cycles_at_rest + 1 if is_left_alone else 0
        if cycles_at_rest == 200:
            break
    far_rig.valve.hold(timeout=GUARD)
    far_rig.hold_still()
    assert far_rig.position.position == AT_TARGET


def test_a_loop_whose_sensor_is_lost_ends(near_rig):
    rig = near_rig
    rig.set_up()
    rig.position.max_age = 0.05
    rig.pressure_a.max_age = 0.05
    loop, profile = prepare_motion(rig)
    rig.valve.enable(timeout=GUARD)
    cycles = loop.run(profile, profile.duration)
    for _ in range(10):
        next(cycles)
    rig.lose()
    further = 0
    try:
        for _ in cycles:
            further += 1
    except DriverError:
        # It goes on with what it has for 50 ms, and no longer.
        assert further <= 0.05 / loop.period + 1
    else:
        pytest.fail("the loop went on without its sensor")
