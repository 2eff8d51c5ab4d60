"""The lateness of a PDO against its usual time.

A computer or a bus that is too slow for a bench holds commands up, too, and by as much. A PDO that
is sent when its value changes comes at any time, and is never late.
"""

from collections import deque
from collections.abc import Callable, Sequence

_KEPT = 256
_FEWEST = 8
_REFRESHED = 16
"""After so many times the usual one is found anew."""
_PROMPT = 5e-3
"""A PDO of which a quarter comes within this time after SYNC answers it [s]."""
_TOLERANCE, _SHARE = 2e-3, 0.2
"""Intervals are alike within so many seconds, or so much of the median."""
_MANY = 0.4
"""Share of intervals that are alike if there is a usual one."""


class _Times:
    """The last times of one kind, and the usual one."""

    def __init__(self, find_usual: Callable[[Sequence[float]], float | None]) -> None:
        self._find_usual = find_usual
        self._times: deque[float] = deque(maxlen=_KEPT)
        self._usual: float | None = None
        self._count = 0

    def take(self, time: float) -> float | None:
        """Take the next time [s]; return how much longer than usual it is, None without a usual."""
        self._times.append(time)
        self._count += 1
        if self._count == _FEWEST or not self._count % _REFRESHED:
            self._usual = self._find_usual(sorted(self._times))
        return None if self._usual is None else max(time - self._usual, 0.0)


class PdoPunctuality:
    """The lateness of one PDO after the frame before and after the SYNC that it may answer."""

    def __init__(self) -> None:
        self._came_at: float | None = None
        self._unanswered: float | None = None
        self._intervals = _Times(usual_interval)
        self._answers = _Times(usual_answer)

    def synchronise(self, time: float) -> None:
        """Take a SYNC [s]."""
        if self._unanswered is None:
            self._unanswered = time

    def take(self, time: float) -> float:
        """Take a frame of the PDO at a time [s]; return how late it is [s], 0 if that is unknown.

        A PDO that answers SYNC is not late if SYNC was.
        """
        found = []
        if self._came_at is not None:
            found.append(self._intervals.take(time - self._came_at))
        if self._unanswered is not None:
            found.append(self._answers.take(time - self._unanswered))
        self._came_at, self._unanswered = time, None
        return min((late for late in found if late is not None), default=0.0)


def usual_interval(times: Sequence[float]) -> float | None:
    """Return the interval [s] that many of the sorted ones have; None where they differ."""
    usual = times[len(times) // 2]
    tolerance = max(_TOLERANCE, _SHARE * usual)
    alike = sum(abs(time - usual) <= tolerance for time in times)
    return usual if alike >= _MANY * len(times) else None


def usual_answer(times: Sequence[float]) -> float | None:
    """Return the time after SYNC [s] of an answer; None where too few of the sorted ones answer."""
    quarter = times[len(times) // 4]
    return quarter if quarter <= _PROMPT else None
