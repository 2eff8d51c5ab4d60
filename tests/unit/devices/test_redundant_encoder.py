"""Two measuring systems in one encoder; by the EDS steps are 1 um and 0.1 mm/s."""

import math

import pytest

from device_profiles import ENCODER_REDUNDANT_406
from hil_bench.devices.rotary_encoder_406 import RedundantEncoder

POSITION_ERROR_EMCY = 0x1000
VALUE = 0x06090030


@pytest.fixture
def rig(make_rig):
    rig = make_rig(ENCODER_REDUNDANT_406)
    rig.encoder = RedundantEncoder(rig.node, (-0.3, 0.3))
    measure(rig, 0.1, 0.101)
    return rig


def measure(rig, first, second, speed=0.02):
    def work(now):
        rig.encoder.publish(first, speed, now)
        rig.encoder.publish_second(second, 2 * speed, now)

    rig.work = work
    rig.tick()


def positions(rig):
    return rig.value(0x6020, 1), rig.value(0x6020, 2)


def test_each_channel_shows_what_it_measures(rig):
    assert positions(rig) == (100_000, 101_000)
    assert (rig.value(0x6030, 1), rig.value(0x6030, 2)) == (200, 400)


@pytest.mark.parametrize(("speed", "steps"), [(1.64, 32767), (-1.64, -32768)])
def test_a_speed_of_channel_2_beyond_its_16_bits_saturates(rig, speed, steps):
    measure(rig, 0.1, 0.101, speed)  # channel 2 moves twice as fast, 3.28 m/s: 32,800 steps
    assert rig.value(0x6030, 2) == steps


def test_steps_and_direction_are_those_of_the_device(rig):
    assert rig.write(0x6005, 1, 2000, 4) is None
    assert rig.write(0x6000, 0, 1 << 3, 2) is None
    rig.tick()
    assert positions(rig) == (-50_000, -50_500)
    assert rig.value(0x6030, 2) == -400


def test_a_preset_of_one_channel_leaves_the_other(rig):
    assert rig.write(0x6010, 2, 5, 4) is None
    rig.tick()
    assert positions(rig) == (100_000, 5)
    assert (rig.value(0x650C, 1), rig.value(0x650C, 2)) == (0, 5 - 101_000)
    rig.nmt(rig.RESET_NODE)
    rig.tick()
    assert positions(rig) == (100_000, 101_000)


def test_a_preset_that_does_not_fit_is_refused(rig):
    measure(rig, 0.1, -0.101)
    assert rig.write(0x6010, 2, (1 << 31) - 1, 4) == VALUE


def test_the_alarm_lasts_until_both_channels_are_right(rig):
    rig.nmt(rig.START)
    rig.emcy_codes()
    measure(rig, math.nan, math.nan)
    assert positions(rig) == (100_000, 101_000)  # the last ones
    assert rig.value(0x6503) == 1
    measure(rig, 0.1, math.nan)
    assert rig.value(0x6503) == 1
    assert rig.value(0x6400, 1) == 0  # the area of channel 1 has its position again
    assert 0 not in rig.emcy_codes()
    measure(rig, 0.1, 0.1)
    rig.tick()
    assert rig.value(0x6503) == 0
    assert rig.emcy_codes() == [0]
