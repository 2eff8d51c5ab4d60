"""Statistics of the loop's lateness and work, in fixed memory however long the bench runs.

The histograms are those of HdrHistogram (Tene): bins whose width grows with the value, so that
every duration from 1 ns to half an hour is known to better than 1 %. They may lie in memory that
another process reads while the loop runs.
"""

import ctypes
import multiprocessing
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

NS_PER_US = 1_000

_BITS = 7  # of a value that its bin keeps, after the leading one
_HALF = 1 << _BITS
_LONGEST = 41  # bits of the longest duration that has a bin of its own: 2**41 ns are 37 minutes
_BINS = (_LONGEST - _BITS + 1) * _HALF
_COUNT, _MAXIMUM = _BINS, _BINS + 1
_ROW = _BINS + 2
_OVERRUNS, _SKIPPED = range(2)


class Counts(Protocol):
    """A row of integers: a list, or shared memory."""

    def __getitem__(self, index: int, /) -> int: ...

    def __setitem__(self, index: int, value: int, /) -> None: ...


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
    """The summary of a paced loop.

    Attributes:
        ticks: ticks that were run.
        overruns: ticks whose work ended after the next tick's time.
        skipped: periods that were left out because the loop was too far behind.
        lateness: from when a tick, or what was left out before it, was due, to its start.
        work: from the start of a tick to its end.
    """

    ticks: int
    overruns: int
    skipped: int
    lateness: DurationSummary
    work: DurationSummary


class DurationHistogram:
    """Counts of durations, in bins of 1 ns up to 256 ns, and of 1/128 of the value above.

    Args:
        row: where the counts are kept, zeros at the start; a list where nobody else reads them.
    """

    __slots__ = ("_row",)

    def __init__(self, row: Counts | None = None) -> None:
        self._row = [0] * _ROW if row is None else row

    @property
    def count(self) -> int:
        """Number of values."""
        return self._row[_COUNT]

    @property
    def maximum(self) -> int:
        """Largest value [ns]; 0 where there is none."""
        return self._row[_MAXIMUM]

    def record(self, duration: int) -> None:
        """Count one duration [ns]; a negative one counts as 0."""
        row = self._row
        row[_COUNT] += 1
        if duration > row[_MAXIMUM]:  # noqa: PLR1730 - max() takes twice the time
            row[_MAXIMUM] = duration
        if duration < 2 * _HALF:
            row[duration if duration > 0 else 0] += 1  # noqa: FURB136 - max() takes twice the time
        else:
            shift = duration.bit_length() - _BITS - 1
            index = (shift << _BITS) + (duration >> shift)
            row[index if index < _BINS else _BINS - 1] += 1

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
        return min(self._edge(rank), self.maximum) / NS_PER_US

    def bins(self) -> Iterator[tuple[float, int]]:
        """Yield the bins that are not empty, the smallest first.

        Yields:
            The largest value that falls into it [us], and its count.
        """
        for index in range(_BINS):
            if self._row[index]:
                edge = _upper_edge(index) if index < _BINS - 1 else self.maximum
                yield edge / NS_PER_US, self._row[index]

    def summary(self) -> DurationSummary:
        """Return median, 99th, 99.9th percentile and maximum."""
        return DurationSummary(
            p50_us=self.percentile(50),
            p99_us=self.percentile(99),
            p999_us=self.percentile(99.9),
            max_us=self.maximum / NS_PER_US,
        )

    def _edge(self, rank: float) -> int:
        """Return the largest value [ns] of the bin in which the value of this rank lies."""
        seen = 0
        for index in range(_BINS - 1):
            seen += self._row[index]
            if seen >= rank:
                return _upper_edge(index)
        return self.maximum


def _upper_edge(index: int) -> int:
    """Return the largest value [ns] that falls into a bin."""
    shift = max((index >> _BITS) - 1, 0)
    return ((index - (shift << _BITS) + 1) << shift) - 1


class TickStatistics:
    """Histograms of wake-up lateness and of work, and the counters of a paced loop.

    Args:
        is_shared: whether another process may read them while the loop runs; it gets this object
            as an argument of its `multiprocessing.Process`.

    Attributes:
        lateness: from when a tick, or what was left out before it, was due, to its start.
        work: from the start of a tick to its end.
    """

    __slots__ = ("_counters", "_memory", "lateness", "work")

    def __init__(self, *, is_shared: bool = False) -> None:
        self._memory: Any = None
        self._counters: Counts = [0, 0]
        self.lateness = DurationHistogram()
        self.work = DurationHistogram()
        if is_shared:
            self._share(multiprocessing.RawArray(ctypes.c_uint64, 2 * _ROW + 2))

    @property
    def ticks(self) -> int:
        """Number of ticks recorded."""
        return self.work.count

    @property
    def overruns(self) -> int:
        """Ticks whose work ended after the next tick's time."""
        return self._counters[_OVERRUNS]

    @overruns.setter
    def overruns(self, count: int) -> None:
        self._counters[_OVERRUNS] = count

    @property
    def skipped(self) -> int:
        """Periods that were left out."""
        return self._counters[_SKIPPED]

    @skipped.setter
    def skipped(self, count: int) -> None:
        self._counters[_SKIPPED] = count

    def summary(self) -> TickSummary:
        """Return the figures so far; it walks the histograms, so it belongs outside of a tick."""
        return TickSummary(
            ticks=self.ticks,
            overruns=self.overruns,
            skipped=self.skipped,
            lateness=self.lateness.summary(),
            work=self.work.summary(),
        )

    def __getstate__(self) -> Any:  # noqa: ANN401 - what ctypes gives has no name
        if self._memory is None:
            raise TypeError("statistics of one process only: TickStatistics(is_shared=True)")
        return self._memory

    def __setstate__(self, memory: Any) -> None:  # noqa: ANN401 - what ctypes gives has no name
        self._share(memory)

    def _share(self, memory: Any) -> None:  # noqa: ANN401 - what ctypes gives has no name
        numbers = memoryview(memory).cast("B").cast("Q")
        self._memory = memory
        self.lateness = DurationHistogram(numbers[:_ROW])
        self.work = DurationHistogram(numbers[_ROW : 2 * _ROW])
        self._counters = numbers[2 * _ROW :]
