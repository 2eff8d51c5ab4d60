"""The share of a requirement's time seen in a run; docs/expectations.md has the rules."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hil_bench.abilities.scenario.build import Asked
from hil_bench.abilities.scenario.reach import names_in
from hil_bench.abilities.scenario.sliding import Floats

if TYPE_CHECKING:
    from hil_bench.abilities.scenario.atoms import Truths


@dataclass(frozen=True, slots=True)
class Coverage:
    """The seen part of a requirement's time; all times in s from the first tick of the run.

    Attributes:
        start: the first instant for which the requirement asks.
        end: the last one.
        seen: how much of that was seen.
        unknown: how many of its ticks were not, as a time.
        is_stated: whether the requirement or the run says that end; else it is the last row's.
    """

    start: float
    end: float
    seen: float
    unknown: float
    is_stated: bool

    @property
    def share(self) -> float:
        """The share of the time that was seen, 0 to 1."""
        length = self.end - self.start
        return self.seen / length if length else float(not self.unknown)

    def __str__(self) -> str:
        """Return it in words."""
        if self.start == self.end:
            return f"{'not ' if self.unknown else ''}seen at {self.start:.9g} s"
        where = "" if self.is_stated else ", to the last row"
        return f"seen {self.seen:.9g} of {round(self.end - self.start, 9):.9g} s{where}"


class View:
    """The view that a run gives of a requirement.

    Args:
        asked: what the requirement asks for, and when.
        columns: the values of each signal, shape (ticks,); NaN or infinite where unknown.
        ticks: how many were seen.
        tick_ns: time between two [ns].
        planned: how many the run has; None where nothing says it.
    """

    def __init__(
        self,
        asked: Sequence[Asked],
        columns: Mapping[str, Floats],
        ticks: int,
        tick_ns: int,
        planned: int | None,
    ) -> None:
        self._tick_ns, self._ticks = tick_ns, ticks
        self._is_stated = planned is not None or all(s.last is not None for _, s in asked)
        last = (ticks if planned is None else planned) - 1
        spans = [(s.first, max(s.first, last) if s.last is None else s.last) for _, s in asked]
        self._first, self._last = min(f for f, _ in spans), max(to for _, to in spans)
        self._missing: dict[str, Truths] = {}
        for (node, _), (start, stop) in zip(asked, spans, strict=True):
            for name in sorted(names_in([node])):
                missing = self._missing.setdefault(name, np.zeros(ticks, dtype=np.bool_))
                asked_for = columns[name][start : min(ticks, stop + 1)]
                missing[start : stop + 1] |= ~np.isfinite(asked_for)
        self._unknown: Truths = np.any([*self._missing.values()], axis=0)
        self._behind = _count(spans, ticks)

    @property
    def coverage(self) -> Coverage:
        """The coverage of the requirement's time."""
        unknown = int(np.count_nonzero(self._unknown)) + self._behind
        length = self._last - self._first
        return Coverage(
            self._first * self._tick_ns / 1e9,
            self._last * self._tick_ns / 1e9,
            max(0, length - unknown) * self._tick_ns / 1e9,
            unknown * self._tick_ns / 1e9,
            self._is_stated,
        )

    def gaps(self) -> Iterator[str]:
        """Yield what was not seen, and when."""
        known = self._first + np.flatnonzero(~self._unknown[self._first : self._last + 1])
        if not len(known):
            yield self._what(self._first, self._ticks)
            return
        first, last = int(known[0]), int(known[-1])
        between = int(np.count_nonzero(self._unknown[first:last]))
        if first > self._first:
            yield f"{self._what(self._first, first)} before {self._time(first)}"
        if between:
            yield f"{self._what(first, last)} for {self._time(between)}"
        if self._unknown[last:].any():
            yield f"{self._what(last, self._ticks)} after {self._time(last)}"
        if self._behind:
            yield f"nothing seen after {self._time(self._ticks - 1)}"

    def _what(self, first: int, end: int) -> str:
        """Name the signals not seen at some of the ticks from `first` to before `end`."""
        missing = [name for name, each in self._missing.items() if each[first:end].any()]
        return f"{', '.join(sorted(missing))} not seen" if missing else "nothing seen"

    def _time(self, ticks: int) -> str:
        return f"{ticks * self._tick_ns / 1e9:.9g} s"


def _count(spans: Iterable[tuple[int, int]], start: int) -> int:
    """Return the number of ticks from `start` on in any of some spans, both ends included."""
    count = 0
    for first, last in sorted(spans):
        begin = max(first, start)
        if last >= begin:
            count += last + 1 - begin
            start = last + 1
    return count
