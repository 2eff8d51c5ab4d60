import pytest

from hil_bench.outside.realtime.clock import MonotonicClock, ScaledClock, VirtualClock


def test_a_virtual_clock_stands_still_between_waits():
    clock = VirtualClock(start=5)
    assert [clock.now(), clock.now()] == [5, 5]


def test_a_virtual_clock_jumps_to_the_deadline():
    clock = VirtualClock()
    clock.sleep_until(1_000)
    assert clock.now() == 1_000


def test_a_virtual_clock_never_goes_back():
    clock = VirtualClock(start=1_000)
    clock.sleep_until(10)
    assert clock.now() == 1_000


def test_work_on_a_virtual_clock_is_advanced_by_hand():
    clock = VirtualClock(start=1_000)
    clock.advance(250)
    assert clock.now() == 1_250
    with pytest.raises(ValueError, match="cannot go back: advance by -1 ns"):
        clock.advance(-1)


def test_the_monotonic_clock_never_wakes_before_the_deadline():
    clock = MonotonicClock()
    for delay in (-1_000_000, 0, 1, 50_000, 1_000_000):
        deadline = clock.now() + delay
        clock.sleep_until(deadline)
        assert clock.now() >= deadline


@pytest.mark.parametrize("speed", [0.1, 1.0, 3.0])
def test_a_scaled_clock_goes_as_fast_as_asked_from_where_the_other_is(speed):
    other = VirtualClock(start=5_000)
    clock = ScaledClock(other, speed)
    assert clock.now() == 5_000
    other.advance(3_000)
    assert clock.now() == 5_000 + int(3_000 * speed)


@pytest.mark.parametrize("speed", [0.1, 1.0, 3.0, 1e6])
def test_a_scaled_clock_wakes_at_its_deadline_never_before(speed):
    other = VirtualClock(start=5_000)
    clock = ScaledClock(other, speed)
    clock.sleep_until(1_005_000)
    assert clock.now() >= 1_005_000
    # One nanosecond less of the other clock would have been too early.
    assert int((other.now() - 1 - 5_000) * speed) < 1_000_000
