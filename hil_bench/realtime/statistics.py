"""How late the loop woke and how long it worked, in fixed memory however long the bench runs."""

from dataclasses import dataclass

NS_PER_US = 1_000

_FINE_BINS = 2_048  # of 1 us: everything that a healthy 1 kHz loop does
_COARSE_BINS = 2_048  # of 1 ms, for what is later; the last one also takes all that lies beyond
_COARSE_US = 1_000


@dataclass(frozen=True, slots=True)
class DurationSummary:
    """Percentiles of one duration, nearest rank, as upper edge of the histogram's bin.

    Attributes:
        p50_us: median [us].
        p99_us: 99th percentile [us].
        p999_us: 99.9th percentile [us].
        max_us: largest value [us], exact.
    """

    p50_us: float
    p99_us: float
    p999_us: float
    max_us: float


@dataclass(frozen=True, slots=True)
class TickSummary:
    """What a paced loop did.

    Attributes:
        ticks: ticks that were run.
        overruns: ticks whose work ended after the next tick's time.
        skipped: periods that were left out because the loop was too far behind.
        lateness: from the scheduled time of a tick to its start.
        work: from the start of a tick to its end.
    """

    ticks: int
    overruns: int
    skipped: int
    lateness: DurationSummary
    work: DurationSummary


class DurationHistogram:
    """Counts of durations: 1 us bins up to 2.048 ms, 1 ms bins up to 2.048 s, and what lies beyond.

    Attributes:
        count: number of values.
        maximum: largest value [ns]; 0 where there is none.
    """

    __slots__ = ("_coarse", "_fine", "count", "maximum")

    def __init__(self) -> None:
        self.count = 0
        self.maximum = 0
        self._fine = [0] * _FINE_BINS
        self._coarse = [0] * _COARSE_BINS

    def record(self, duration: int) -> None:
        """Count one duration [ns]; a negative one counts as 0."""
        self.count += 1
        if duration > self.maximum:  # noqa: PLR1730 - max() takes twice the time
            self.maximum = duration
        micros = duration // NS_PER_US
        if micros < _FINE_BINS:
            self._fine[micros if micros > 0 else 0] += 1  # noqa: FURB136 - max() takes twice the time
        else:
            self._coarse[min(micros // _COARSE_US, _COARSE_BINS - 1)] += 1

    def percentile(self, percent: float) -> float:
        """Return the duration [us] that `percent` of the values do not exceed (nearest rank).

        The answer is the upper edge of the bin that holds the value, or the exact maximum where
        that is smaller; 0 without values.

        Raises:
            ValueError: `percent` is not within 0 to 100.
        """
        if not 0 <= percent <= 100:
            raise ValueError(f"percentile {percent}: 0 to 100 is right")
        rank = max(1.0, self.count * percent / 100)
        return min(self._edge_us(rank), self.maximum / NS_PER_US)

    def summary(self) -> DurationSummary:
        """Return median, 99th, 99.9th percentile and maximum."""
        return DurationSummary(
            p50_us=self.percentile(50),
            p99_us=self.percentile(99),
            p999_us=self.percentile(99.9),
            max_us=self.maximum / NS_PER_US,
        )

    def _edge_us(self, rank: float) -> float:
        """Return the upper edge [us] of the bin in which the value of this rank lies."""
        seen = 0
        for micros, count in enumerate(self._fine, start=1):
            seen += count
            if seen >= rank:
                return micros
        for millis, count in enumerate(self._coarse[:-1], start=1):
            seen += count
            if seen >= rank:
                return millis * _COARSE_US
        return self.maximum / NS_PER_US


class TickStatistics:
    """Histograms of wake-up lateness and of work, and the counters of a paced loop.

    Attributes:
        lateness: from the scheduled time of a tick to its start.
        work: from the start of a tick to its end.
        overruns: ticks whose work ended after the next tick's time.
        skipped: periods that were left out.
    """

    __slots__ = ("lateness", "overruns", "skipped", "work")

    def __init__(self) -> None:
        self.lateness = DurationHistogram()
        self.work = DurationHistogram()
        self.overruns = 0
        self.skipped = 0

    @property
    def ticks(self) -> int:
        """Number of ticks recorded."""
        return self.work.count

    def summary(self) -> TickSummary:
        """Return the figures so far; it walks the histograms, so it belongs outside of a tick."""
        return TickSummary(
            ticks=self.ticks,
            overruns=self.overruns,
            skipped=self.skipped,
            lateness=self.lateness.summary(),
            work=self.work.summary(),
        )
