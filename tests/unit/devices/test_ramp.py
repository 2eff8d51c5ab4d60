"""The ramp by itself. Times are [ns for one increment], so that 1 increment takes 1 ns at 1."""

import pytest

from hil_bench.devices.ramp import Ramp, RampTimes, advance

EACH = RampTimes(
    speed_up_positive=1.0, speed_up_negative=2.0, slow_down_positive=4.0, slow_down_negative=8.0
)


def test_each_quadrant_has_its_time():
    # 8 ns at 1, 2, 4, 8 ns for one increment: 8, 4, 2 and 1 increments.
    expected = {
        (10.0, 30.0): 18.0,
        (-10.0, -30.0): -14.0,
        (30.0, 10.0): 28.0,
        (-30.0, -10.0): -29.0,
    }
    assert {
        (value, target): advance(value, target, 8.0, EACH) for value, target in expected
    } == expected


def test_a_way_through_zero_from_above():
    # 2 increments at 4 ns are 8 ns; 6 ns more at 2 ns are 3 increments.
    assert advance(2.0, -30.0, 14.0, EACH) == -3.0


def test_a_way_through_zero_from_below():
    # 2 increments at 8 ns are 16 ns; 5 ns more at 1 ns are 5 increments.
    assert advance(-2.0, 30.0, 21.0, EACH) == 5.0


def test_the_target_is_not_passed():
    assert advance(0.0, 5.0, 100.0, EACH) == 5.0
    assert advance(0.0, -5.0, 100.0, EACH) == -5.0


def test_a_time_of_zero_jumps():
    times = RampTimes(speed_up_positive=1.0)
    assert advance(10.0, 2.0, 0.0, times) == 2.0
    # Down to 0 at once, and on to the negative side at once too.
    assert advance(10.0, -7.0, 0.0, times) == -7.0
    # Up from -4: at once to 0, then 3 ns of 1 ns each.
    assert advance(-4.0, 7.0, 3.0, times) == 3.0


def test_a_new_target_acts_from_the_tick_that_brings_it():
    ramp = Ramp()
    ramp.times = EACH
    assert ramp.follow(0.0, 0) == 0.0
    assert ramp.follow(6.0, 10) == 0.0
    assert ramp.is_running
    assert ramp.follow(6.0, 14) == 4.0
    # What is new at 15 does not change the nanosecond before it.
    assert ramp.follow(0.0, 15) == 5.0
    assert ramp.follow(0.0, 19) == 4.0
    assert ramp.is_running
    assert ramp.follow(0.0, 35) == 0.0
    assert not ramp.is_running


@pytest.mark.parametrize("milliseconds", [6, 7, 10, 100, 300])
def test_it_arrives_at_the_tick_although_times_are_no_binary_fractions(milliseconds):
    ramp = Ramp()
    ramp.times = RampTimes(speed_up_positive=milliseconds * 1e6 / 16384)
    ramp.follow(0.0, 0)
    values = [ramp.follow(16384.0, tick * 1_000_000) for tick in range(1, milliseconds + 1)]
    # Begun at tick 1; each later tick is that part of the way.
    part = 16384 / milliseconds
    assert values[:3] == [0.0, pytest.approx(part), pytest.approx(2 * part)]
    assert values[-1] == pytest.approx(16384 - part)
    assert ramp.is_running
    assert ramp.follow(16384.0, (milliseconds + 1) * 1_000_000) == 16384.0
    assert not ramp.is_running


def test_a_restart_stands_still():
    ramp = Ramp()
    ramp.times = EACH
    ramp.follow(0.0, 0)
    ramp.follow(9.0, 0)
    ramp.restart(3.0)
    assert not ramp.is_running
    assert ramp.follow(9.0, 100) == 3.0  # the new target is known from this call on
    assert ramp.follow(9.0, 102) == 5.0
