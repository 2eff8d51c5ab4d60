"""Two recordings of one bus in one log: all that any node sends comes twice, at one distance."""

from collections import deque
from collections.abc import Iterator
from statistics import median
from typing import Final

from hil_bench.abilities.eyes.explain.finding import Cause, Finding, milliseconds
from hil_bench.canopen_device.frame import Frame

_MOST: Final = 4096
_KEPT: Final = 64
"""Intervals of one identifier that are kept."""

_FEWEST: Final = 6
_IDENTIFIERS: Final = 3
_SHARE: Final = 0.8
"""Of the identifiers that were heard often enough, those that come twice."""

_HALF: Final = (0.35, 0.65)
"""Of the intervals of a heartbeat that comes twice, those of the distance of the two."""

_CLOSE: Final = 2_000_000
_NEAR: Final = 0.25
"""How far intervals of the distance may be off it [ns]; how far the others must be, of it."""


class Recordings:
    """Follows how long ago a frame came just like that: NMT, SDO and heartbeats."""

    def __init__(self) -> None:
        self._last: dict[tuple[int, bytes], int] = {}
        self._intervals: dict[int, deque[int]] = {}

    def take(self, frame: Frame, now: int) -> None:
        """Take a frame."""
        can_id = frame.can_id
        if not (can_id == 0 or 0x580 < can_id < 0x680 or 0x700 < can_id < 0x780):
            return
        if frame.is_extended or frame.is_remote:
            return
        key = can_id | frame.bus << 16, frame.data
        before = self._last.get(key)
        if before is not None:
            self._intervals.setdefault(key[0], deque(maxlen=_KEPT)).append(now - before)
        elif len(self._last) >= _MOST:
            return
        self._last[key] = now

    def findings(self) -> Iterator[Finding]:
        """Yield that there are two recordings.

        Yields:
            At most one finding.
        """
        often = {c: [*each] for c, each in self._intervals.items() if len(each) >= _FEWEST}
        beats = [each for can_id, each in often.items() if _is_heartbeat(can_id)]
        if len(often) < _IDENTIFIERS or not beats:
            return
        middle = (min(beats[0]) + max(beats[0])) / 2
        halves = [i for i in beats[0] if i <= middle], [i for i in beats[0] if i > middle]
        for distance in (median(half) for half in halves if half):
            doubled = sum(_is_doubled(c, each, distance) for c, each in often.items())
            if doubled >= _SHARE * len(often):
                text = "all frames come twice, "
                text += f"{milliseconds(distance)} apart: two recordings of one bus in one log"
                yield Finding(Cause.TWO_RECORDINGS, "", 0, text)
                return


def _is_heartbeat(can_id: int) -> bool:
    return can_id & 0x780 == 0x700


def _is_doubled(can_id: int, intervals: list[int], distance: float) -> bool:
    """Return True if half of the intervals are the distance of two recordings, and none is near it.

    What is sent once comes at that distance alone: a command, the download of an object.
    """
    close = sum(abs(each - distance) <= _CLOSE for each in intervals) / len(intervals)
    if not _is_heartbeat(can_id):
        return close >= _HALF[0]
    wide = max(_NEAR * distance, 2 * _CLOSE)
    near = sum(abs(each - distance) <= wide for each in intervals) / len(intervals)
    return _HALF[0] <= close and near <= _HALF[1]
