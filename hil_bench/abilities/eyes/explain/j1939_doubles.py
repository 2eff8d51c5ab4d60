"""J1939 messages that two send: two devices at one address, or two buses in one log."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median
from typing import Final

from hil_bench.abilities.eyes.explain.finding import (
    Cause,
    Evidence,
    Finding,
    finding,
    milliseconds,
    seconds,
)
from hil_bench.abilities.eyes.explain.j1939 import OfJ1939, group_title
from hil_bench.abilities.eyes.sight import Sight
from hil_bench.abilities.j1939.protocol import signals

_WINDOW: Final = 24
_LOOK: Final = 8
"""Messages that are looked at together, and after how many."""

_SHARE: Final = 0.8
_NEAR: Final = 0.15
"""Share of the messages that have to fit two senders, and how far each may be off its period."""

_UNLIKE: Final = 2.0
_LEAST: Final = 16
"""How many times farther the values of two senders are from each other than those of one, and how
far at least [sum of the differences of their bytes]."""

_ADDRESSES: Final = 2
"""Addresses of two senders that make it two buses."""

_ON_GRID: Final = 0.2
_RATIO: Final = (0.6, 1.6)
"""How far a message may be off the period of its sender, and the second period, of the first."""

_EVEN: Final = 0.6
"""Share of the intervals that are alike where one sender has doubled its rate, or sends two kinds
of values by turns."""

_PROPRIETARY: Final = 0xFF00
"""From here on a maker may have several kinds of values in one group; before, the standard says."""

_OF_A_FRAME: Final = 8
_SHORTEST: Final = 2_000_000
_MOST: Final = 4096

_Key = tuple[int, int, int]
"""Bus, source address, PGN."""


@dataclass(slots=True)
class _Stream:
    """The last messages of one identifier.

    Attributes:
        now: their times [ns].
        data: what they carried.
        looked: messages since the last look.
        steady: the period while one sender was there [ns]; 0 before that.
        found: the first messages that show two senders, and both periods [ns].
        is_weak: whether their times alone show it, from the first message on: one sender that sends
            twice in each period looks alike, so it counts beside other addresses only.
    """

    now: deque[int] = field(default_factory=lambda: deque(maxlen=_WINDOW))
    data: deque[bytes] = field(default_factory=lambda: deque(maxlen=_WINDOW))
    looked: int = 0
    steady: float = 0.0
    found: tuple[Evidence, float, float] | None = None
    is_weak: bool = True

    def look(self, sight: Sight, group: int) -> None:
        """Look whether the last messages are those of one sender or of two."""
        times = list(self.now)
        intervals = [b - a for a, b in pairwise(times)]
        if _is_regular(intervals[-_LOOK:]):
            self.steady = median(intervals[-_LOOK:])
        elif len(times) == _WINDOW and not _is_even(intervals):
            periods = _two_in(times, list(self.data), self.steady, group)
            self.is_weak = self.is_weak and periods is None
            if periods is None and group < _PROPRIETARY:
                periods = _two_of(_by_turns(times), times)
            if periods is not None:
                self.found = self.found or (Evidence(), *periods)
                self.found[0].append(sight)


class Doubles(OfJ1939):
    """Watches for messages that are those of two senders, each with a period and values of its own.

    A sender that doubles its rate, or sends at changes, has one course of values; two have two.
    """

    def __init__(self) -> None:
        self._streams: dict[_Key, _Stream] = {}

    def pause(self, length: int) -> None:
        """Begin anew after a pause."""
        del length
        for stream in self._streams.values():
            stream.now.clear()
            stream.data.clear()

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        message = sight.message
        if message is None or message.data is None or message.destination != signals.GLOBAL:
            return
        group = message.group
        if (
            message.source == signals.NULL
            or group in {signals.ADDRESS_CLAIMED, signals.DM1}
            or not signals.is_to_all(group)
        ):
            return
        if len(message.data) > _OF_A_FRAME:  # packets of two senders are no message
            return
        key = sight.frame.bus, message.source, group
        stream = self._streams.get(key)
        if stream is None:
            if len(self._streams) >= _MOST:
                return
            stream = self._streams[key] = _Stream()
        stream.now.append(sight.now)
        stream.data.append(message.data)
        stream.looked += 1
        if stream.looked >= _LOOK:
            stream.looked = 0
            stream.look(sight, group)

    def findings(self, end: int) -> Iterator[Finding]:  # noqa: ARG002 - as every watch
        """Yield the addresses of two senders; one finding for all where there are several.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        doubled: dict[tuple[int, int], list[tuple[_Key, _Stream]]] = {}
        for key, stream in self._streams.items():
            if stream.found is not None:
                doubled.setdefault(key[:2], []).append((key, stream))
        by_bus: dict[int, list[int]] = {}
        for bus, address in doubled:
            by_bus.setdefault(bus, []).append(address)
        for addresses in by_bus.values():
            if len(addresses) >= _ADDRESSES:
                text = "two send from each of the addresses "
                text += ", ".join(map(str, sorted(addresses)))
                text += ": the frames of two buses are in one log"
                yield Finding(Cause.TWO_BUSES, "", 0, text)
        for (bus, address), streams in doubled.items():
            (_, _, group), stream = min(streams, key=lambda each: each[1].is_weak)
            if len(by_bus[bus]) >= _ADDRESSES or stream.found is None or stream.is_weak:
                continue
            sights, one, other = stream.found
            text = f"two devices send {group_title(group)} from address {address}, each"
            text += f" {milliseconds(one)} and each {milliseconds(other)}; seen at"
            text += f" {seconds(sights[0].now)}"
            yield finding(Cause.ADDRESS_CLASH, sights[0].node, sights, text)


def _two_in(
    times: list[int], data: list[bytes], steady: float, group: int
) -> tuple[float, float] | None:
    """Return the periods [ns] of two senders among messages; None where there is one.

    Args:
        times: of the messages [ns].
        data: of the messages.
        steady: the period of the one that was there before [ns]; 0 for nobody.
        group: the PGN.
    """
    ways: list[tuple[list[int], ...]] = []
    if steady:
        ways += [_off_grid(times, first, steady) for first in (0, 1)]
    if steady or group < _PROPRIETARY:
        ways.append(_shared(data))
    return next(filter(None, (_two_of(courses, times) for courses in ways)), None)


def _two_of(courses: tuple[list[int], ...], times: list[int]) -> tuple[float, float] | None:
    """Return the periods [ns] of two courses; None where one has no period or is far slower."""
    found = [_period(course, times) for course in courses]
    if len(found) == 2 and all(found) and _RATIO[0] <= found[1] / found[0] <= _RATIO[1]:
        return found[0], found[1]
    return None


def _by_turns(times: list[int]) -> tuple[list[int], list[int]]:
    """Share messages out by turns."""
    return list(range(0, len(times), 2)), list(range(1, len(times), 2))


def _period(course: list[int], times: list[int]) -> float:
    """Return the period of the messages at some places [ns]; 0 where they have none."""
    intervals = [times[b] - times[a] for a, b in pairwise(course)]
    return median(intervals) if _is_regular(intervals) else 0.0


def _is_regular(intervals: list[int]) -> bool:
    if len(intervals) < _WINDOW // 4:
        return False
    period = median(intervals)
    near = sum(abs(i - period) <= max(_NEAR * period, _SHORTEST) for i in intervals)
    return near >= _SHARE * len(intervals)


def _is_even(intervals: list[int]) -> bool:
    middle = median(intervals)
    alike = sum(abs(i - middle) <= max(_ON_GRID * middle, _SHORTEST) for i in intervals)
    return alike >= _EVEN * len(intervals)


def _off_grid(times: list[int], first: int, period: float) -> tuple[list[int], list[int]]:
    """Share messages out: those at the period of the first, and the others."""
    grid, others = [first], list(range(first))
    due = times[first] + period
    for place in range(first + 1, len(times)):
        if abs(times[place] - due) <= _ON_GRID * period:
            grid.append(place)
            due = times[place] + period
        else:
            others.append(place)
            if times[place] > due + period:
                due = times[place] + period
    return grid, others


def _shared(data: list[bytes]) -> tuple[list[int], ...]:
    """Share messages out to two courses of values; return nothing where there are no two.

    Each goes to the course whose last one is nearer to it, and the courses are far from each other.
    """
    first = 0
    second = max(range(1, len(data)), key=lambda each: _distance(data[0], data[each]))
    if _distance(data[first], data[second]) < _LEAST:
        return ()
    courses: tuple[list[int], list[int]] = ([], [])
    heads = [data[first], data[second]]
    steps, gaps = 0, 0
    for place, each in enumerate(data):
        distances = [_distance(each, head) for head in heads]
        nearer = 0 if distances[0] <= distances[1] else 1
        courses[nearer].append(place)
        steps += distances[nearer]
        gaps += distances[1 - nearer]
        heads[nearer] = each
    return courses if gaps > _UNLIKE * steps + _LEAST * len(data) else ()


def _distance(one: bytes, other: bytes) -> int:
    """Return the distance of two messages: the sum of the differences of their bytes."""
    return sum(abs(a - b) for a, b in zip(one, other, strict=False)) + 255 * abs(
        len(one) - len(other)
    )
