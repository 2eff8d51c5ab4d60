"""Cams and work area of the encoder, over the bus. 0x6005.01 = 1000: 1 step is 1 um."""

import pytest

from device_profiles import ENCODER_406
from hil_bench.devices.encoder_406 import EncoderDevice

STEP = 1e-6


@pytest.fixture
def rig(make_rig):
    rig = make_rig(ENCODER_406)
    rig.device = EncoderDevice(rig.node)
    move(rig, 0)
    return rig


def move(rig, steps):
    rig.work = lambda now: rig.device.publish(steps * STEP, 0.0, now)
    rig.tick()


def set_cam(rig, number, low, high, hysteresis=0):
    for index, value, size in ((0x6310, low, 4), (0x6320, high, 4), (0x6330, hysteresis, 2)):
        assert rig.write(index + number - 1, 1, value, size, signed=value < 0) is None


def cams(rig, steps):
    move(rig, steps)
    return rig.value(0x6300, 1)


@pytest.mark.parametrize("number", range(1, 9))
def test_each_cam_has_its_bit_and_its_objects(rig, number):
    set_cam(rig, number, -100, 100)
    assert rig.write(0x6301, 1, 0xFF, 1) is None
    others = 0xFF ^ 1 << number - 1
    # The other cams are active at their default limits only, 0 to 0.
    assert cams(rig, 50) == 1 << number - 1
    assert cams(rig, 101) == 0
    assert cams(rig, 0) == 1 << number - 1 | others


@pytest.mark.parametrize(
    ("steps", "active"), [(-101, False), (-100, True), (200, True), (201, False)]
)
def test_the_limits_are_included(rig, steps, active):
    set_cam(rig, 3, -100, 200)
    assert rig.write(0x6301, 1, 0b100, 1) is None
    assert cams(rig, steps) == (0b100 if active else 0)


def test_a_cam_that_is_not_enabled_is_not_active(rig):
    set_cam(rig, 1, -100, 100)
    set_cam(rig, 2, -100, 100)
    assert rig.write(0x6301, 1, 0b10, 1) is None
    assert cams(rig, 50) == 0b10


def test_the_polarity_turns_each_bit_round(rig):
    set_cam(rig, 1, -100, 100)
    assert rig.write(0x6301, 1, 0b01, 1) is None
    assert rig.write(0x6302, 1, 0b11, 1) is None
    # Cam 2 is not enabled, so not active, so 1 (Turck BL20, 6B00h).
    assert cams(rig, 50) == 0b10
    assert cams(rig, 101) == 0b11


def test_without_a_cam_the_polarity_stands_alone(rig):
    assert rig.write(0x6302, 1, 0x81, 1) is None
    assert cams(rig, 50) == 0x81


def test_hysteresis_holds_an_active_cam(rig):
    set_cam(rig, 1, 0, 100, hysteresis=10)
    assert rig.write(0x6301, 1, 1, 1) is None
    # Outside and inactive, in, out by the hysteresis, out by more, back to where it held before.
    assert [cams(rig, steps) for steps in (105, 100, 110, 111, 105)] == [0, 1, 1, 0, 0]
    assert [cams(rig, steps) for steps in (-5, 0, -10, -11, -5)] == [0, 1, 1, 0, 0]


def test_each_cam_remembers_for_itself_that_it_was_active(rig):
    set_cam(rig, 1, 0, 100, hysteresis=10)
    set_cam(rig, 2, 300, 400, hysteresis=20)
    assert rig.write(0x6301, 1, 0b11, 1) is None
    # Cam 1, its hysteresis, that of cam 2, which was not active, cam 2, its hysteresis, that of 1.
    path = (100, 110, 415, 400, 415, 105)
    assert [cams(rig, steps) for steps in path] == [0b01, 0b01, 0, 0b10, 0b10, 0]


def test_a_cam_enabled_again_has_not_been_active(rig):
    set_cam(rig, 1, 0, 100, hysteresis=10)
    assert rig.write(0x6301, 1, 1, 1) is None
    assert cams(rig, 50) == 1
    assert rig.write(0x6301, 1, 0, 1) is None
    assert cams(rig, 50) == 0
    assert rig.write(0x6301, 1, 1, 1) is None
    assert cams(rig, 105) == 0


def test_a_node_reset_forgets_cams(rig):
    set_cam(rig, 1, 0, 100, hysteresis=10)
    assert rig.write(0x6301, 1, 1, 1) is None
    assert cams(rig, 50) == 1
    rig.nmt(rig.RESET_NODE)
    assert cams(rig, 50) == 0


def test_a_node_reset_forgets_that_a_cam_was_active(rig):
    for index, value in ((0x6301, 1), (0x6320, 100), (0x6330, 10)):
        variable = rig.object_dictionary.variable(index, 1)
        variable.default = variable.value = value
    assert [cams(rig, steps) for steps in (50, 105)] == [1, 1]
    rig.nmt(rig.RESET_NODE)
    assert cams(rig, 105) == 0


def test_limits_the_wrong_way_round_are_never_reached(rig):
    set_cam(rig, 1, 100, 0)
    assert rig.write(0x6301, 1, 1, 1) is None
    assert [cams(rig, steps) for steps in (0, 50, 100)] == [0, 0, 0]


def test_cams_follow_the_preset(rig):
    set_cam(rig, 1, 5000, 5100)
    assert rig.write(0x6301, 1, 1, 1) is None
    assert cams(rig, 50) == 0
    assert rig.write(0x6003, 0, 5050, 4) is None
    assert cams(rig, 50) == 1


@pytest.mark.parametrize(
    ("steps", "state"),
    # Bit 1 above, bit 2 below the work area.
    [(-1001, 0b100), (-1000, 0), (2000, 0), (2001, 0b010)],
)
def test_work_area(rig, steps, state):
    assert rig.write(0x6401, 1, -1000, 4, signed=True) is None
    assert rig.write(0x6402, 1, 2000, 4) is None
    move(rig, steps)
    assert rig.value(0x6400, 1) == state


@pytest.mark.parametrize(
    ("steps", "state"),
    # Bit 0 where the counter ends; the counter's ends are inside the default work area.
    [(0, 0), (2**31 - 1, 0), (-(2**31), 0), (2**31 + 5, 0b001), (-(2**31) - 5, 0b001)],
)
def test_beyond_the_counter_the_area_state_says_so(rig, steps, state):
    move(rig, steps)
    assert rig.value(0x6400, 1) == state
