"""What another bus reads of a rotary encoder: angle and speed in SI, whatever its steps are."""

import math

import pytest
from support.encoders import move

from device_profiles import ROTARY_ENCODER_406
from hil_bench.devices.quantities import rotary_quantities
from hil_bench.devices.rotary_encoder_406 import RotaryEncoderDevice

TURN = math.tau
RPM = TURN / 60.0


def fit(rig):
    rig.device = RotaryEncoderDevice(rig.node)
    move(rig, 0.0)
    return rotary_quantities(rig.object_dictionary)


def test_speed_by_its_own_multiplier_and_divider(make_rig):
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
