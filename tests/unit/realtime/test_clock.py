import pytest

from hil_bench.realtime.clock import MonotonicClock, VirtualClock


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
