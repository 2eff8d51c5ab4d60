"""J1939 messages that are not any more what they were: period, length, priority, values."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from statistics import fmean, median
from typing import Final

from hil_bench.abilities.eyes.explain.finding import (
    Cause,
    Evidence,
    Finding,
    finding,
    milliseconds,
    seconds,
)
from hil_bench.abilities.eyes.explain.j1939 import OfJ1939, Who, group_title
from hil_bench.abilities.eyes.sight import J1939Message, Sight
from hil_bench.abilities.j1939.protocol import signals

_MS: Final = 1_000_000
_KNOWN: Final = 5
_VALID: Final = 3
_CHANGED: Final = 3
"""Messages alike after which a property is known, a signal has values, and either has changed."""

_EEC1: Final = 0xF004
"""Its period goes with the speed of the engine (J1939-71)."""

_STEP: Final = 6
_ALIKE: Final = 0.2
_SLOWER: Final = 1.45
"""Intervals before and after a change of period, how far they may be off it; the least ratio."""

_WINDOW: Final = 16
_STEADY: Final = 12
_NEAR: Final = 0.35
_LEAST: Final = 3 * _MS
_LEAST_OFF: Final = 5 * _MS
_FEW: Final = 10
_MEAN: Final = (0.8, 1.25)
_SHORT: Final = 0.15
_TWICE: Final = 2
_BURSTS: Final = 6
_LOOK: Final = 4
"""So many intervals near each other are a steady period: within a share of it, or `_LEAST` [ns]. Of
a window that jitters no more than `_FEW` are near it, though their mean is the period; and no more
than a third of the others are next to nothing, as where a recorder was late and caught up. After
`_LOOK` messages each there is a look, and `_TWICE` in a row have to say so; of bursts `_BURSTS`, so
that one delay of the recorder is out of the window, and few other messages come so."""

_MOST: Final = 4096

_Key = tuple[int, int, int]
"""Bus, source address, PGN."""


@dataclass(slots=True)
class _Habit:
    """A property of a message that stays the same, until it changes for good.

    Attributes:
        usual: its value; None before the first message.
        count: messages with it.
        other: the first messages with another value.
        is_loose: whether both have come by turns.
    """

    usual: object = None
    count: int = 0
    other: Evidence = field(default_factory=Evidence)
    is_loose: bool = False

    def hear(self, value: object, sight: Sight) -> None:
        """Take the value of the next message."""
        if value == self.usual:
            self.count += 1
            if self.other.total:
                self.is_loose = self.is_loose or self.count > _KNOWN
                self.other = Evidence()
        elif self.count < _KNOWN:
            self.usual, self.count = value, 1
        else:
            self.other.append(sight)

    @property
    def has_changed(self) -> bool:
        """True if the messages have another value since a while, and had one before."""
        return self.other.total >= _CHANGED and not self.is_loose


@dataclass(slots=True)
class _Signal:
    """The indicators that a signal has shown: how often it was valid, and those since."""

    valid: int = 0
    shown: str = ""
    sights: Evidence = field(default_factory=Evidence)


@dataclass(slots=True)
class _Course:
    """A message that comes again and again.

    Attributes:
        last: the last one.
        due_from: when the next one's time began [ns].
        count: messages after it.
        intervals: the last ones [ns].
        changes: whether the data differ from those before, of the same messages.
        steady: the period while it was steady [ns]; 0 before that.
        jitters: windows in a row in which it was not.
        bursts: looks in a row at which it came in bursts.
        slower: the message before the change of period, the two periods [ns].
        jitter: the first message of the window in which it was seen to jitter.
        length: bytes of a message.
        priority: of a message.
    """

    last: Sight
    due_from: int
    count: int = 0
    intervals: deque[int] = field(default_factory=lambda: deque(maxlen=_WINDOW))
    changes: deque[bool] = field(default_factory=lambda: deque(maxlen=_WINDOW))
    steady: float = 0.0
    jitters: int = 0
    bursts: int = 0
    slower: tuple[Sight, float, float] | None = None
    jitter: Sight | None = None
    length: _Habit = field(default_factory=_Habit)
    priority: _Habit = field(default_factory=_Habit)


class Changes(OfJ1939):
    """Watches messages to all that change: their period, length, priority, and values that go."""

    def __init__(self) -> None:
        self._courses: dict[_Key, _Course] = {}
        self._signals: dict[tuple[_Key, str], _Signal] = {}

    def pause(self, length: int) -> None:
        """Count from the end of a pause."""
        for course in self._courses.values():
            course.due_from += length

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        message = sight.message
        if (
            message is None
            or message.source == signals.NULL
            or message.destination != signals.GLOBAL
        ):
            return
        who = sight.frame.bus, message.source
        if message.group == signals.ADDRESS_CLAIMED:
            if not message.is_answer:
                self._begin_anew(who)
            return
        if message.data is None or not signals.is_to_all(message.group):
            return
        key = (*who, message.group)
        course = self._courses.get(key)
        if course is not None:
            self._hear_time(course, sight, message)
        elif len(self._courses) < _MOST:
            course = self._courses[key] = _Course(sight, sight.now)
        else:
            return
        can_id = sight.frame.can_id
        if (
            can_id >> 8 & signals.HIGHEST_GROUP == message.group != signals.DM1
        ):  # no part of a long message
            course.length.hear(len(message.data), sight)
            course.priority.hear(can_id >> 26 & 7, sight)
        for name, shown in message.shown:
            self._hear_signal((key, name), shown, sight)
        course.last, course.due_from = sight, sight.now

    def _is_recorder_late(self, bus: int) -> bool:
        """Return True if most steady messages of a bus come in bursts, as of a late recorder."""
        steady = [each for key, each in self._courses.items() if key[0] == bus and each.steady]
        return 2 * sum(each.bursts >= _BURSTS for each in steady) > max(len(steady), _TWICE)

    def _begin_anew(self, who: Who) -> None:
        """Forget the intervals of a device that has claimed an address: it may have paused."""
        for key, course in self._courses.items():
            if key[:2] == who:
                course.intervals.clear()
                course.changes.clear()

    def _hear_time(self, course: _Course, sight: Sight, message: J1939Message) -> None:
        if message.group == signals.DM1:
            return
        before = course.last.message
        course.intervals.append(sight.now - course.due_from)
        course.changes.append(before is not None and before.data != message.data)
        course.count += 1
        if message.group != _EEC1:
            _judge_period(course)
        if course.count % _LOOK == 0:
            _judge_jitter(course, sight)

    def _hear_signal(self, key: tuple[_Key, str], shown: str, sight: Sight) -> None:
        signal = self._signals.get(key)
        if signal is None:
            if shown or len(self._signals) >= _MOST:
                return  # it shows nothing from the first on
            signal = self._signals[key] = _Signal()
        if not shown:
            signal.valid += 1
            if signal.shown == signals.NOT_AVAILABLE or signal.sights.total < _CHANGED:
                signal.sights = Evidence()
        elif signal.valid >= _VALID:
            if shown != signal.shown:
                signal.shown, signal.sights = shown, Evidence()
            signal.sights.append(sight)

    def findings(self, end: int) -> Iterator[Finding]:  # noqa: ARG002 - as every watch
        """Yield what has changed.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        late = {bus for bus, _, _ in self._courses if self._is_recorder_late(bus)}
        for (bus, _, group), course in self._courses.items():
            if bus in late and course.bursts >= _BURSTS:
                course.jitter = None
            head = f"{course.last.node}: {group_title(group)}"
            yield from _period_findings(head, course)
            for cause, habit, words in (
                (Cause.J1939_LENGTH, course.length, _length_words),
                (Cause.J1939_PRIORITY, course.priority, _priority_words),
            ):
                if habit.has_changed:
                    first = habit.other[0]
                    text = f"{head} {words(habit.usual, first)} from {seconds(first.now)} on"
                    yield finding(cause, first.node, habit.other, text)
        for ((_, _, group), name), signal in self._signals.items():
            if signal.sights.total >= _CHANGED:
                first = signal.sights[0]
                text = f"{first.node}: {name} of {group_title(group)} shows"
                text += f' "{signal.shown}" from {seconds(first.now)} on, after {signal.valid}'
                text += " messages with a value"
                yield finding(Cause.J1939_INDICATOR, first.node, signal.sights, text)


def _length_words(usual: object, first: Sight) -> str:
    return f"has {len(first.frame.data)} bytes, {usual} before,"


def _priority_words(usual: object, first: Sight) -> str:
    return f"has the priority {signals.split(first.frame.can_id).priority}, {usual} before,"


def _period_findings(head: str, course: _Course) -> Iterator[Finding]:
    if course.slower is not None:
        sight, before, after = course.slower
        text = f"{head} comes each {milliseconds(after)} after {seconds(sight.now)}, each"
        text += f" {milliseconds(before)} before"
        yield Finding(Cause.J1939_PERIOD, sight.node, sight.now, text, (sight,))
    elif course.jitter is not None:
        sight = course.jitter
        text = f"{head} comes irregularly from about {seconds(sight.now)} on, steadily each"
        text += f" {milliseconds(course.steady)} before"
        yield Finding(Cause.J1939_PERIOD, sight.node, sight.now, text, (sight,))


def _judge_period(course: _Course) -> None:
    """Compare the last intervals with those before them."""
    intervals = course.intervals
    count = len(intervals)
    if count < 2 * _STEP or intervals[-1] < _SLOWER * intervals[count - 2 * _STEP]:
        if course.slower is not None and _is_back(course):
            course.slower = None
        return
    before = list(islice(intervals, count - 2 * _STEP, count - _STEP))
    after = list(islice(intervals, count - _STEP, count))
    was, now = median(before), median(after)
    if now < _SLOWER * was or not (_are_alike(before, was) and _are_alike(after, now)):
        return
    changes = list(islice(course.changes, count - 2 * _STEP, count))
    if sum(changes[:_STEP]) >= _STEP // 2 and not any(changes[_STEP:]):
        return  # it came at each change, and nothing changes any more
    course.slower = course.slower or (course.last, was, now)


def _is_back(course: _Course) -> bool:
    """Return True if a message has its first period again: it has two, and may choose."""
    last = list(islice(course.intervals, len(course.intervals) - _STEP, None))
    return course.slower is not None and _are_alike(last, course.slower[1])


def _are_alike(intervals: list[int], period: float) -> bool:
    return all(abs(each - period) <= max(_ALIKE * period, _LEAST) for each in intervals)


def _judge_jitter(course: _Course, sight: Sight) -> None:
    """Find a steady period, and later windows in which it is not kept."""
    intervals = course.intervals
    if len(intervals) < _STEADY or course.jitter is not None:
        return
    last = list(intervals)[-_STEADY:]
    middle = median(last)
    off = sum(abs(each - middle) > max(_ALIKE * middle, _LEAST) for each in last)
    if off <= 1:
        course.steady, course.jitters, course.bursts = middle, 0, 0
        return
    if len(intervals) < _WINDOW:
        return
    period = course.steady
    if not period or not _MEAN[0] <= fmean(intervals) / period <= _MEAN[1]:
        course.jitters = course.bursts = 0
        return
    far = [i for i in intervals if abs(i - period) > max(_NEAR * period, _LEAST_OFF)]
    is_off = len(intervals) - len(far) <= _FEW
    has_bursts = 3 * sum(i < _SHORT * period for i in far) > len(far)
    course.jitters = course.jitters + 1 if is_off and not has_bursts else 0
    course.bursts = course.bursts + 1 if is_off and has_bursts else 0
    if course.jitters >= _TWICE or course.bursts >= _BURSTS:
        course.jitter = sight
