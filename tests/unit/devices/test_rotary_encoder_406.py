"""The rotary encoder behind a real node: 65536 steps a revolution over 4096 of them."""

import math

import pytest
from support.encoders import move

from device_profiles import ROTARY_ENCODER_406
from hil_bench.abilities.modbus.quantities import rotary_quantities
from hil_bench.devices.rotary_encoder_406 import RotaryEncoderDevice

TURN = math.tau
VALUE, TOO_LOW, TOO_HIGH = 0x06090030, 0x06090032, 0x06090031


@pytest.fixture
def rig(make_rig):
    rig = make_rig(ROTARY_ENCODER_406)
    rig.device = RotaryEncoderDevice(rig.node)
    move(rig, 0.0)
    return rig


@pytest.mark.parametrize(
    ("turns", "steps"),
    [
        (0.0, 0),
        (0.25, 16384),
        (1.0, 65536),
        (100.5, 6586368),
        (-1.0, 268435456 - 65536),  # one revolution before 0 is the last one
        (4096.25, 16384),
        (-4096.0, 0),
    ],
)
def test_position_goes_round_after_all_revolutions(rig, turns, steps):
    move(rig, turns * TURN)
    assert rig.value(0x6004) == steps


@pytest.mark.parametrize(
    ("rpm", "shown", "warning"),
    [(1500.0, 1500, 0), (-20.0, -20, 0), (32766.0, 32766, 0), (40000.0, 32767, 1)],
)
def test_speed_in_revolutions_a_minute(rig, rpm, shown, warning):
    move(rig, 0.0, rpm * TURN / 60.0)
    assert (rig.value(0x6030, 1), rig.value(0x6505)) == (shown, warning)


def test_speed_by_its_own_multiplier_and_divider(rig):
    assert rig.write(0x6031, 3, 600, 2) is None  # tenths of a revolution a minute
    move(rig, 0.0, 12.3 * TURN / 60.0)
    assert rig.value(0x6030, 1) == 123


def test_scaling_holds_while_its_bit_is_set(rig):
    assert rig.write(0x6001, 0, 3600, 4) is None
    assert rig.write(0x6002, 0, 36000, 4) is None
    move(rig, 1.5 * TURN)
    assert rig.value(0x6004) == 5400
    move(rig, 11.0 * TURN)
    assert rig.value(0x6004) == 3600
    assert rig.write(0x6000, 0, 0, 2) is None
    move(rig, 1.5 * TURN)
    assert rig.value(0x6004) == 98304


def test_code_sequence_reverses_position_and_speed(rig):
    assert rig.write(0x6000, 0, 5, 2) is None
    move(rig, 0.25 * TURN, 10.0 * TURN / 60.0)
    assert rig.value(0x6004) == 268435456 - 16384
    assert rig.value(0x6030, 1) == -10


def test_preset_makes_the_present_position_that_value(rig):
    move(rig, -0.25 * TURN)
    assert rig.write(0x6003, 0, 100, 4) is None
    move(rig, -0.25 * TURN)
    assert rig.value(0x6004) == 100
    assert rig.value(0x6509) == 100 + 16384
    move(rig, 0.0)
    assert rig.value(0x6004) == 100 + 16384


def test_refuses_what_it_does_not_have(rig):
    assert rig.write(0x6001, 0, 65537, 4) == TOO_HIGH
    assert rig.write(0x6001, 0, 0, 4) == TOO_LOW
    assert rig.write(0x6002, 0, 1 << 29, 4) == TOO_HIGH
    assert rig.write(0x6031, 4, 0, 4) == TOO_LOW
    assert rig.write(0x6003, 0, 268435456, 4) == TOO_HIGH
    assert rig.write(0x6000, 0, 2, 2) == VALUE


def test_no_angle_is_a_position_error(rig):
    move(rig, 0.25 * TURN)
    move(rig, math.nan)
    assert (rig.value(0x6004), rig.value(0x6503)) == (16384, 1)
    assert rig.value(0x1001) & 1
    move(rig, 0.5 * TURN)
    assert (rig.value(0x6004), rig.value(0x6503)) == (32768, 0)


def test_a_cam_switches_between_its_limits(rig):
    assert rig.write(0x6310, 1, 16000, 4) is None
    assert rig.write(0x6320, 1, 17000, 4) is None
    assert rig.write(0x6301, 1, 1, 1) is None
    for turns, state in ((0.0, 0), (0.25, 1), (0.5, 0)):
        move(rig, turns * TURN)
        assert rig.value(0x6300, 1) == state


# What another bus reads of a rotary encoder: angle and speed in SI, whatever its steps are.


RPM = TURN / 60.0


def fit(rig):
    rig.device = RotaryEncoderDevice(rig.node)
    move(rig, 0.0)
    return rotary_quantities(rig.object_dictionary)


def test_the_quantity_of_speed_has_its_own_multiplier_and_divider(make_rig):
    rig = make_rig(ROTARY_ENCODER_406)
    known = fit(rig)
    assert rig.write(0x6031, 3, 600, 2) is None  # tenths of a revolution a minute
    move(rig, 0.0, 12.3 * RPM)
    assert known["speed"].read() == pytest.approx(12.3 * RPM)
    assert rig.write(0x6001, 0, 32768, 4) is None
    move(rig, 0.0, 12.4 * RPM)  # 62 steps of 0.2 rpm: half the steps a second
    assert known["speed"].read() == pytest.approx(12.4 * RPM)


def test_a_reversed_encoder_shows_what_it_sends(make_rig):
    rig = make_rig(ROTARY_ENCODER_406)
    known = fit(rig)
    assert rig.write(0x6000, 0, 5, 2) is None
    move(rig, 0.25 * TURN, 10.0 * RPM)
    assert known["angle"].read() == pytest.approx(4095.75 * TURN)
    assert known["speed"].read() == pytest.approx(-10.0 * RPM)


def test_an_encoder_without_the_optional_objects(make_rig):
    """Its resolution counts; without revolutions it has one, without parameters 60 for rpm."""
    absent = {0x6000, 0x6001, 0x6002, 0x6031, 0x6502, 0x6503}
    rig = make_rig(ROTARY_ENCODER_406, without=absent)
    known = fit(rig)
    move(rig, 2.25 * TURN, 1500.0 * RPM)
    assert known["angle"].read() == pytest.approx(0.25 * TURN)
    assert known["speed"].read() == pytest.approx(1500.0 * RPM)
    assert (known["turn_steps"].read(), known["range_steps"].read()) == (65536, 65536)
    assert known["valid"].read() == 1.0


def test_an_encoder_without_a_speed_has_no_such_quantity(make_rig):
    known = fit(make_rig(ROTARY_ENCODER_406, without={0x6030, 0x1800, 0x1801, 0x1A00, 0x1A01}))
    assert set(known) == {"angle", "valid", "turn_steps", "range_steps"}
