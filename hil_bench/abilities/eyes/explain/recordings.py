"""Two recordings of one bus in one log: all that any node sends comes twice, at one distance.

Of CANopen NMT, SDO and heartbeats show it; of J1939 all messages of more than one value, since each
comes a second time as it was.
"""

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
_SENT: Final = 2
"""Identifiers of CANopen and senders of J1939 that show it at least."""

_SHARE: Final = 0.8
"""Of the identifiers that were heard often enough, those that come twice."""

_HALF: Final = (0.35, 0.65)
"""Of the intervals of a heartbeat that comes twice, those of the distance of the two."""

_CLOSE: Final = 2_000_000
_NEAR: Final = 0.25
"""How far intervals of the distance may be off it [ns]; how far the others must be, of it."""


_EARLIER: Final = 8
_MESSAGES: Final = 64
"""Messages of an identifier in which the same one is looked for; identifiers of J1939 at most."""

_LATEST: Final = 100_000_000
"""Distance of two recordings at most, of J1939 [ns]."""

_TWINS: Final = (0.4, 0.6)
"""Of the messages of J1939, those that are the second ones."""

_TRANSPORT: Final = frozenset({0xEB, 0xEC})
"""PDU formats of the parts of long messages, which are alike where the messages are."""

_SOURCE: Final = 0xFF


class Recordings:
    """Follows how long ago a frame came just like that: NMT, SDO and heartbeats."""

    def __init__(self) -> None:
        self._last: dict[tuple[int, bytes], int] = {}
        self._intervals: dict[int, deque[int]] = {}
        self._messages: dict[int, _Messages] = {}

    def take(self, frame: Frame, now: int) -> None:
        """Take a frame."""
        can_id = frame.can_id
        if frame.is_extended:
            if can_id >> 16 & 0xFF not in _TRANSPORT:
                self._take_message(frame, now)
            return
        if not (can_id == 0 or 0x580 < can_id < 0x680 or 0x700 < can_id < 0x780):
            return
        if frame.is_remote:
            return
        key = can_id | frame.bus << 16, frame.data
        before = self._last.get(key)
        if before is not None:
            self._intervals.setdefault(key[0], deque(maxlen=_KEPT)).append(now - before)
        elif len(self._last) >= _MOST:
            return
        self._last[key] = now

    def _take_message(self, frame: Frame, now: int) -> None:
        key = frame.can_id | frame.bus << 32
        messages = self._messages.get(key)
        if messages is None:
            if len(self._messages) < _MESSAGES:
                self._messages[key] = _Messages(frame.data, now)
            return
        messages.take(frame.data, now)

    def findings(self) -> Iterator[Finding]:
        """Yield that there are two recordings.

        Yields:
            At most one finding.
        """
        distance = self._canopen_distance() or self._j1939_distance()
        if distance:
            text = "all frames come twice, "
            text += f"{milliseconds(distance)} apart: two recordings of one bus in one log"
            yield Finding(Cause.TWO_RECORDINGS, "", 0, text)

    def _j1939_distance(self) -> float:
        """Return the distance at which the messages of J1939 come twice [ns]; 0 for never."""
        often = {key: each for key, each in self._messages.items() if each.is_often}
        if len({key & _SOURCE for key in often}) < _SENT:
            return 0.0
        distances = {each.distance for each in often.values()}
        for distance in sorted(distances - {0.0}):
            doubled = sum(each.is_doubled(distance) for each in often.values())
            if doubled >= _SHARE * len(often):
                return distance
        return 0.0

    def _canopen_distance(self) -> float:
        """Return the distance at which frames of CANopen come twice [ns]; 0 for never."""
        often = {c: [*each] for c, each in self._intervals.items() if len(each) >= _FEWEST}
        beats = [each for can_id, each in often.items() if _is_heartbeat(can_id)]
        if len(often) < _IDENTIFIERS or not beats:
            return 0.0
        middle = (min(beats[0]) + max(beats[0])) / 2
        halves = [i for i in beats[0] if i <= middle], [i for i in beats[0] if i > middle]
        for distance in (median(half) for half in halves if half):
            doubled = sum(_is_doubled(c, each, distance) for c, each in often.items())
            if doubled >= _SHARE * len(often):
                return distance
        return 0.0


class _Messages:
    """The last messages of an identifier of J1939, and how far the same one was before them.

    Args:
        data: of the first.
        now: its time [ns].

    Attributes:
        twins: how far each was behind the same one [ns].
    """

    def __init__(self, data: bytes, now: int) -> None:
        self.twins: deque[int] = deque(maxlen=_KEPT)
        self._last: deque[tuple[bytes, int]] = deque([(data, now)], maxlen=_EARLIER)
        self._count = 0

    def take(self, data: bytes, now: int) -> None:
        """Take a message."""
        if self._count >= _KEPT:
            return
        self._count += 1
        twin = next((time for value, time in reversed(self._last) if value == data), None)
        if twin is not None and now - twin <= _LATEST:
            self.twins.append(now - twin)
        self._last.append((data, now))

    @property
    def is_often(self) -> bool:
        """True if there were enough of them."""
        return self._count >= 2 * _FEWEST

    @property
    def distance(self) -> float:
        """The usual distance of the nearer twins [ns]; 0 where there are too few."""
        if len(self.twins) < _FEWEST // 2:
            return 0.0
        return median(sorted(self.twins)[: -(-len(self.twins) // 2)])

    def is_doubled(self, distance: float) -> bool:
        """Return True if every second one was so far behind the same one [ns]."""
        close = sum(abs(each - distance) <= _CLOSE for each in self.twins)
        return _TWINS[0] <= close / self._count <= _TWINS[1]


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
