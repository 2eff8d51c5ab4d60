"""The time of a log whose clock does not go on evenly, or that holds the frames of two."""

from collections.abc import Iterator
from typing import Final

from hil_bench.abilities.eyes.explain.finding import seconds

_UNSORTED: Final = 5_000_000
"""Time by which frames may be written in another order than they came [ns]."""

_SET_BACK: Final = 50
"""Frames in a row of an earlier time after which the clock was set back for good."""

_LEAP: Final = 60_000_000_000
"""Time without a frame from which on the clock was set, or the recording stopped [ns]."""


class Clock:
    """Gives each frame a time that never goes back, and leaves out those of a second clock."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._offset = 0
        self._strange = 0
        self._left_out = 0
        self._backs: list[int] = []
        self._leaps: list[tuple[int, int]] = []
        self._back_count = 0

    def time_of(self, now: int) -> tuple[int, int] | None:
        """Return the time of a frame and the leap before it [ns]; None for one to leave out."""
        if self._last is None:
            self._last, self._offset = now, -now
            return 0, 0
        step = now - self._last
        if step >= 0:
            self._strange = 0
            self._last = now
            if step <= _LEAP:
                return now + self._offset, 0
            self._leaps.append((now - step + self._offset, step))
            del self._leaps[1:]
            return now + self._offset, step
        if step > -_UNSORTED:
            return self._last + self._offset, 0
        self._strange += 1
        if self._strange < _SET_BACK:
            self._left_out += 1
            return None
        self._strange, self._back_count = 0, self._back_count + 1
        self._backs.append(self._last + self._offset)
        del self._backs[1:]
        self._offset -= step
        self._last = now
        return now + self._offset, 1

    def notes(self) -> Iterator[str]:
        """Yield a line for each oddity."""
        if self._backs:
            more = f", and {self._back_count - 1} times more" if self._back_count > 1 else ""
            at = f"the clock goes back at {seconds(self._backs[0])}{more}"
            yield f"{at}; what follows is joined on"
        if self._left_out:
            yield f"{self._left_out} frames of an earlier time, as of a second log, are left out"
        for since, step in self._leaps:
            yield f"the clock leaps by {seconds(step)} at {seconds(since)}, or nothing was recorded"
