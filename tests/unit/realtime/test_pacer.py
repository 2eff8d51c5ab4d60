import pytest

from hil_bench.bench.configuration import OverrunPolicy
from hil_bench.errors import TimingError
from hil_bench.outside.realtime.clock import MonotonicClock, ScaledClock, VirtualClock
from hil_bench.outside.realtime.pacer import START_UP, Pacer
from hil_bench.outside.realtime.statistics import TickStatistics

MS = 1_000_000


class LateClock(VirtualClock):
    """Wakes late by what `late` holds, one entry a sleep."""

    def __init__(self, start=0, late=()):
        super().__init__(start)
        self.late = list(late)

    def sleep_until(self, deadline):
        super().sleep_until(deadline)
        if self.late:
            self.advance(self.late.pop(0))


def run(pacer, clock, work):
    """Run one tick for each entry of `work` [ns]; return (scheduled, started) of each."""
    ticks = []
    for duration in work:
        scheduled = pacer.wait()
        ticks.append((scheduled, clock.now()))
        clock.advance(duration)
        pacer.done()
    return ticks


def test_the_grid_starts_with_the_first_wait():
    clock = VirtualClock(start=123)
    pacer = Pacer(clock, MS)
    clock.advance(1_000)  # setting up takes time, which is no delay of the loop
    assert run(pacer, clock, [0, 0, 0]) == [
        (1_123, 1_123),
        (1_123 + MS, 1_123 + MS),
        (1_123 + 2 * MS, 1_123 + 2 * MS),
    ]
    assert pacer.statistics.lateness.maximum == 0


def test_late_wake_ups_do_not_add_up():
    clock = LateClock(late=[70_000] * 999)
    ticks = run(Pacer(clock, MS), clock, [100_000] * 1_000)
    assert [scheduled for scheduled, _ in ticks] == [k * MS for k in range(1_000)]
    assert ticks[-1][1] == 999 * MS + 70_000


def test_lateness_and_work_are_told_apart():
    clock = LateClock(late=[30_000, 50_000])
    pacer = Pacer(clock, MS)
    run(pacer, clock, [10_000, 20_000, 40_000])
    assert (pacer.statistics.lateness.maximum, pacer.statistics.work.maximum) == (50_000, 40_000)
    assert (pacer.statistics.ticks, pacer.statistics.overruns) == (3, 0)


def test_late_ticks_follow_back_to_back_until_the_loop_is_on_time():
    clock = VirtualClock()
    pacer = Pacer(clock, MS)
    # 3.2 ms of work in the first tick: the ticks of 1, 2 and 3 ms are late, that of 4 ms is not.
    ticks = run(pacer, clock, [3_200_000, 100_000, 100_000, 100_000, 100_000])
    assert ticks == [
        (0, 0),
        (1 * MS, 3_200_000),
        (2 * MS, 3_300_000),
        (3 * MS, 3_400_000),
        (4 * MS, 4 * MS),
    ]
    # Ends at 3.2 (next due at 1), 3.3 (2), 3.4 (3), 3.5 (4), 4.1 (5): the first three are overruns.
    assert (pacer.statistics.overruns, pacer.statistics.skipped) == (3, 0)
    assert pacer.statistics.lateness.maximum == 2_200_000


def test_work_that_ends_with_the_next_deadline_is_no_overrun():
    clock = VirtualClock()
    pacer = Pacer(clock, MS)
    run(pacer, clock, [MS])
    assert pacer.statistics.overruns == 0
    run(pacer, clock, [MS + 1])
    assert pacer.statistics.overruns == 1


def test_a_delay_of_the_whole_backlog_is_made_up_for():
    clock = VirtualClock()
    pacer = Pacer(clock, MS, backlog=5 * MS)
    ticks = run(pacer, clock, [6 * MS, 0, 0])  # 5 ms late at the tick of 1 ms
    assert [scheduled for scheduled, _ in ticks] == [0, MS, 2 * MS]
    assert pacer.statistics.skipped == 0


def test_beyond_the_backlog_whole_periods_are_left_out_and_the_phase_stays():
    clock = VirtualClock(start=7)
    pacer = Pacer(clock, MS, backlog=5 * MS)
    ticks = run(pacer, clock, [10 * MS + 400_000, 0, 0])
    # At 10.4 ms the tick of 1 ms is 9.4 ms late: nine periods go, the tick of 10 ms runs at once.
    assert ticks == [(7, 7), (7 + 10 * MS, 7 + 10 * MS + 400_000), (7 + 11 * MS, 7 + 11 * MS)]
    assert pacer.statistics.skipped == 9
    assert pacer.lateness == 0  # of the last tick
    assert pacer.statistics.lateness.maximum == 9_400_000  # for 9.4 ms nothing ran


def test_skipping_leaves_out_each_whole_period_that_is_late():
    clock = VirtualClock()
    pacer = Pacer(clock, MS, overrun=OverrunPolicy.SKIP)
    # 3.2 ms of work in the first tick: at 3.2 ms the ticks of 1 and 2 ms go, that of 3 ms runs.
    assert run(pacer, clock, [3_200_000, 0, 0]) == [(0, 0), (3 * MS, 3_200_000), (4 * MS, 4 * MS)]
    assert (pacer.statistics.overruns, pacer.statistics.skipped) == (1, 2)
    assert pacer.statistics.lateness.maximum == 2_200_000  # the tick of 1 ms was due at 1 ms


def test_stopping_forgives_the_first_ticks_and_no_other():
    clock = VirtualClock()
    pacer = Pacer(clock, MS, overrun=OverrunPolicy.STOP)
    run(pacer, clock, [MS + 500_000] + [0] * (START_UP - 1))
    with pytest.raises(
        TimingError, match=r"^tick 101 ended 0\.250 ms late: it started 0\.000 ms late"
    ):
        run(pacer, clock, [MS + 250_000])


def test_statistics_may_be_kept_elsewhere():
    statistics = TickStatistics()
    clock = VirtualClock()
    run(Pacer(clock, MS, statistics=statistics), clock, [0, 0])
    assert statistics.ticks == 2


@pytest.mark.parametrize("period", [0, -1])
def test_a_period_that_is_not_positive_is_refused(period):
    with pytest.raises(ValueError, match="a positive number is right"):
        Pacer(VirtualClock(), period)


def test_a_negative_backlog_is_refused():
    with pytest.raises(ValueError, match="0 or more is right"):
        Pacer(VirtualClock(), MS, backlog=-1)


class TickingClock(LateClock):
    """Goes on by 100 ns whenever it is read, as a busy wait needs it."""

    def now(self):
        self.advance(100)
        return super().now()


def test_a_loop_that_waits_busily_is_not_late_by_a_late_wake_up():
    """Woken 60 us late it still has 140 of its 200 us; with 250 us it is late by the other 50."""
    clock = TickingClock(late=[60_000, 250_000])
    pacer = Pacer(clock, MS, spin=200_000)
    first = pacer.wait()
    pacer.done()
    assert pacer.wait() == first + MS
    assert 0 <= pacer.lateness <= 100
    assert pacer.remaining() == pytest.approx(MS - 200_000, abs=300)  # others have so much
    pacer.done()
    pacer.wait()
    assert pacer.lateness == pytest.approx(50_000, abs=200)


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
