"""The absolute time grid on which a loop runs."""

from hil_bench.errors import TimingError
from hil_bench.outside.realtime.clock import Clock, OverrunPolicy
from hil_bench.outside.realtime.statistics import TickStatistics

ONE_SECOND = 1_000_000_000

START_UP = 100
"""First ticks of a loop, in which much is done for the first time; an overrun does not stop it."""


class Pacer:
    """Lets a loop run at start + k * period, without drift.

    The loop::

        while running:
            now = pacer.wait()
            ...                     # the tick's work
            pacer.done()

    The grid starts with the first `wait`. A tick that comes late is run at once, so the ticks
    after a delay follow back to back until the loop is on time again and the number of ticks fits
    the time. Only a loop that is further behind than `backlog` (a suspended process) leaves
    periods out: whole ones, so that the phase stays. With `OverrunPolicy.SKIP` every loop does that
    which is a period behind; with `OverrunPolicy.STOP` a tick that took too long is an error, but
    for the first `START_UP` ticks. What is left out counts as lateness of the tick that is run.

    Args:
        clock: the clock to wait on.
        period: time between ticks [ns].
        backlog: delay [ns] up to which every missed tick is made up for.
        overrun: what to do after a tick that took longer than its period.
        statistics: where to count; new ones where it is None.
        spin: for how long before each tick to wait busily [ns]; the clock must go by itself.

    Attributes:
        period: time between ticks [ns].
        lateness: how much after its scheduled time the present tick started [ns].
        statistics: lateness, work, overruns and skipped periods so far.

    Raises:
        ValueError: the period is not positive, or the backlog is negative.
    """

    def __init__(
        self,
        clock: Clock,
        period: int,
        *,
        backlog: int = ONE_SECOND,
        overrun: OverrunPolicy = OverrunPolicy.COUNT,
        statistics: TickStatistics | None = None,
        spin: int = 0,
    ) -> None:
        if period <= 0:
            raise ValueError(f"tick period {period} ns: a positive number is right")
        if backlog < 0:
            raise ValueError(f"backlog {backlog} ns: 0 or more is right")
        self.period = period
        self.lateness = 0
        self.statistics = TickStatistics() if statistics is None else statistics
        self._clock = clock
        self._spin = spin
        self._backlog = 0 if overrun is OverrunPolicy.SKIP else backlog
        self._stops = overrun is OverrunPolicy.STOP
        self._next: int | None = None
        self._delay = 0
        self._started = 0

    def wait(self) -> int:
        """Sleep until the next tick is due and return its scheduled time [ns]."""
        now = self._clock.now()
        scheduled = now if self._next is None else self._next
        if now < scheduled:
            self._clock.sleep_until(scheduled - self._spin)
            now = self._clock.now()
            while now < scheduled:
                now = self._clock.now()
        self._delay = now - scheduled
        if self._delay > self._backlog:
            scheduled += self._skip(self._delay)
        self._next = scheduled + self.period
        self.lateness = now - scheduled
        self._started = now
        return scheduled

    def remaining(self) -> int:
        """Return the time until the loop waits for the next tick alone [ns]; negative if late."""
        return 0 if self._next is None else self._next - self._spin - self._clock.now()

    def done(self) -> None:
        """Record the tick that `wait` started: its work is over.

        Raises:
            TimingError: it took too long, and the policy is to stop.
        """
        now = self._clock.now()
        statistics = self.statistics
        statistics.lateness.record(self._delay)
        statistics.work.record(now - self._started)
        if self._next is not None and now > self._next:
            statistics.overruns += 1
            if self._stops and statistics.ticks > START_UP:
                raise TimingError(
                    f"tick {statistics.ticks} ended {(now - self._next) / 1e6:.3f} ms late: it "
                    f"started {self.lateness / 1e6:.3f} ms late and worked "
                    f'{(now - self._started) / 1e6:.3f} ms; overrun = "count" goes on'
                )

    def _skip(self, delay: int) -> int:
        """Count the whole periods within `delay` and return their length [ns]."""
        periods = delay // self.period
        self.statistics.skipped += periods
        return periods * self.period
