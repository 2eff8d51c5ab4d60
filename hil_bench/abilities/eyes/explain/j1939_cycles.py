"""J1939 messages that come with a period, and the devices and messages that stay out."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from statistics import median
from typing import Final

from hil_bench.abilities.eyes.explain.finding import Cause, Finding, milliseconds, seconds
from hil_bench.abilities.eyes.explain.j1939 import OfJ1939, Who, group_title
from hil_bench.abilities.eyes.j1939 import trouble_codes
from hil_bench.abilities.eyes.sight import J1939Message, Sight
from hil_bench.abilities.j1939.protocol import signals

_MS: Final = 1_000_000
_DM1_PERIOD: Final = 1000 * _MS
_LATE: Final = 3.0
"""Periods after which a message stays out."""
_FEWEST: Final = 6
_REGULAR: Final = 0.3
"""How far intervals may be off their median for a period, of it."""
_STILL: Final = 0.1
"""How far the last interval may be off the period that was counted before, of it."""

_BEHIND: Final = 3
"""Intervals of the period after which one before them, too long for it, counts as a gap."""
_FEWEST_OF_SILENT: Final = 4
_SHARE_OF_SILENT: Final = 0.6
_LATE_OF_SILENT: Final = 5.0
"""Less is asked of the messages of a device that sends nothing at all any more."""
_OFTEN: Final = 12
"""Gaps of a message, or silences of a device, from which on they are its way to send."""
_SEVERAL: Final = 2
"""Messages with a period of a device that was away; of one message it is this that stayed out."""

_OFF: Final = 8
"""Of so many intervals one may be off."""
_NEVER_CYCLIC: Final = frozenset(
    {signals.TRANSPORT_CONNECTION, signals.TRANSPORT_DATA, signals.REQUEST}
)
"""Parts of a long message whose beginning is not in the log, and requests: a tool asks for one
group after the other, and has asked for all."""

_MOST: Final = 4096


@dataclass(slots=True)
class _Cycle:
    """A message that comes again and again.

    Attributes:
        last: the last one.
        due_from: when the next one's time began [ns].
        intervals: the last ones [ns].
        gap: the first time that it stayed out: the messages before and behind.
        gaps: how often it stayed out.
        early: an interval before there was a period that is far above the one before it [ns], and
            the messages around it.
        counted: the period when it was last counted [ns]; 0 for none.
        is_new: whether its sender has claimed its address since, and so may have paused.
    """

    last: Sight
    due_from: int
    intervals: deque[int] = field(default_factory=lambda: deque(maxlen=32))
    gap: tuple[Sight, Sight] | None = None
    gaps: int = 0
    early: tuple[int, Sight, Sight] | None = None
    is_new: bool = False
    counted: float = 0.0

    @property
    def period(self) -> float:
        """Its period [ns]; 0 where it has none.

        It is counted anew where the last interval is not near the one before.
        """
        if len(self.intervals) < _FEWEST:
            return 0.0
        if self.counted and abs(self.intervals[-1] - self.counted) <= _STILL * self.counted:
            return self.counted
        middle = median(self.intervals)
        off = sum(abs(each - middle) > _REGULAR * middle for each in self.intervals)
        self.counted = middle if off <= len(self.intervals) // _OFF else 0.0
        return self.counted

    @property
    def rough_period(self) -> float:
        """The interval that most have [ns], some others between; 0 where there is none."""
        if len(self.intervals) < _FEWEST_OF_SILENT:
            return 0.0
        middle = median(self.intervals)
        alike = sum(abs(each - middle) <= _REGULAR * middle for each in self.intervals)
        return middle if alike >= _SHARE_OF_SILENT * len(self.intervals) else 0.0


@dataclass(slots=True)
class _Away:
    """A device that sent nothing for a while.

    Attributes:
        last: what it sent before.
        again: what it sent first after that.
        period: of its quickest message [ns].
        group: PGN of this one.
        times: how often it was away.
    """

    last: Sight
    again: Sight
    period: float
    group: int
    times: int = 0

    def finding(self) -> Finding:
        """Return it as a finding."""
        last = self.last
        text = f"{last.node} sends nothing for {milliseconds(self.again.now - last.now)} after"
        text += f" {seconds(last.now)} ({group_title(self.group)} every"
        text += f" {milliseconds(self.period)} before)"
        text += f"; {self.times} times" if self.times > 1 else ""
        return Finding(Cause.J1939_SILENT, last.node, last.now, text, (last, self.again))


class Cycles(OfJ1939):
    """Watches messages that come with a period, and DM1 while a code is active."""

    def __init__(self) -> None:
        self._cycles: dict[tuple[int, int, int], _Cycle] = {}
        self._heard: dict[Who, Sight] = {}
        self._first: dict[Who, int] = {}
        self._away: dict[Who, _Away] = {}
        self._paused: dict[Who, int] = {}

    def pause(self, length: int) -> None:
        """Count from the end of a pause."""
        for cycle in self._cycles.values():
            cycle.due_from += length
        for who in self._heard:
            self._paused[who] = self._paused.get(who, 0) + length

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        message = sight.message
        if message is None or message.source == signals.NULL:
            return
        bus = sight.frame.bus
        self._hear_device((bus, message.source), sight)
        if (
            message.data is None
            or message.destination != signals.GLOBAL
            or message.group in _NEVER_CYCLIC
        ):
            return
        if message.group == signals.ADDRESS_CLAIMED:
            for place, each in () if message.is_answer else self._cycles.items():
                each.is_new = each.is_new or place[:2] == (bus, message.source)
            return
        key = bus, message.source, message.group
        cycle = self._cycles.get(key)
        if cycle is None:
            if len(self._cycles) < _MOST:
                self._cycles[key] = _Cycle(sight, sight.now)
            return
        if cycle.is_new:
            cycle.last, cycle.due_from, cycle.is_new = sight, sight.now, False
            return
        interval, period = sight.now - cycle.due_from, _period(cycle)
        if period and interval > _LATE * period:
            cycle.gap = cycle.gap or (cycle.last, sight)
            cycle.gaps += 1
        elif message.group != signals.DM1 or _has_codes(cycle.last.message):
            _take_interval(cycle, interval, sight)
        cycle.last, cycle.due_from = sight, sight.now

    def _hear_device(self, who: Who, sight: Sight) -> None:
        """Note when a device was heard, and that it was away as a whole before that."""
        last = self._heard.get(who)
        self._heard[who] = sight
        paused = self._paused.pop(who, 0)
        if last is None:
            if len(self._first) < _MOST:
                self._first[who] = sight.now
        elif sight.now - last.now - paused > _DM1_PERIOD:
            cycles = [each for place, each in self._cycles.items() if place[:2] == who]
            period, group, messages = _quickest(cycles)
            silence = sight.now - last.now - paused
            if messages >= _SEVERAL and silence > max(_LATE_OF_SILENT * period, _DM1_PERIOD):
                away = self._away.setdefault(who, _Away(last, sight, period, group))
                away.times += 1

    def _has_moved(self, who: Who, groups: set[int]) -> bool:
        """Return True if another address has sent the same since a device fell silent."""
        since = self._heard[who].now
        sent: dict[Who, set[int]] = {}
        for bus, source, group in self._cycles:
            first = self._first.get((bus, source), 0)
            if bus == who[0] and since <= first <= since + 2 * _DM1_PERIOD:
                sent.setdefault((bus, source), set()).add(group)
        return any(groups <= each for each in sent.values())

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield the devices and the messages that stay out.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        silent = set()
        for away in self._away.values():
            if away.times < _OFTEN:
                yield away.finding()
        for who, cycles in self._by_sender().items():
            period, group, _ = _quickest(cycles)
            last = self._heard[who]
            silence = end - last.now - self._paused.get(who, 0)
            if period and silence > max(_LATE_OF_SILENT * period, _DM1_PERIOD):
                silent.add(who)
                if self._has_moved(who, {_group_of(each) for each in cycles if each.rough_period}):
                    continue
                text = f"{last.node} sends nothing after {seconds(last.now)}"
                text += f" ({group_title(group)} every {milliseconds(period)} before)"
                yield Finding(Cause.J1939_SILENT, last.node, last.now, text, (last,))
        for (bus, source, group), cycle in self._cycles.items():
            period = _period(cycle)
            if not period or cycle.gaps >= _OFTEN or (bus, source) in silent:
                continue
            before, after = cycle.gap or (cycle.last, None)
            lasts = end - cycle.due_from if after is None else after.now - before.now
            if lasts <= _LATE * period:
                continue
            text = f"{before.node}: no {group_title(group)} after {seconds(before.now)}"
            text += f" for {milliseconds(lasts)} (every {milliseconds(period)} "
            by_standard = "by SAE J1939-73), while a trouble code is active"
            text += by_standard if group == signals.DM1 else "before)"
            text += f"; {cycle.gaps} such gaps" if cycle.gaps > 1 else ""
            sights = (before,) if after is None else (before, after)
            yield Finding(Cause.J1939_MISSING, before.node, before.now, text, sights)

    def _by_sender(self) -> dict[Who, list[_Cycle]]:
        found: dict[Who, list[_Cycle]] = {}
        for (bus, source, _), cycle in self._cycles.items():
            found.setdefault((bus, source), []).append(cycle)
        return found


def _quickest(cycles: list[_Cycle]) -> tuple[float, int, int]:
    """Return period [ns] and PGN of the quickest message, and how many have a period."""
    periods = [(period, _group_of(each)) for each in cycles if (period := each.rough_period)]
    return (*min(periods, default=(0.0, 0)), len(periods))


def _take_interval(cycle: _Cycle, interval: int, sight: Sight) -> None:
    """Keep an interval; one that was too long before there was a period shows three later.

    Those before and behind it have one period then.
    """
    intervals = cycle.intervals
    if not cycle.period and intervals and interval > _LATE * intervals[-1]:
        cycle.early = interval, cycle.last, sight
    intervals.append(interval)
    if cycle.early is None or len(intervals) <= _FEWEST:
        return
    long, before, after = cycle.early
    if intervals[-1 - _BEHIND] != long:
        return
    intervals.remove(long)
    if cycle.period and long > _LATE * cycle.period:
        cycle.gap, cycle.gaps = cycle.gap or (before, after), cycle.gaps + 1
    else:
        intervals.append(long)
    cycle.early = None


def _period(cycle: _Cycle) -> float:
    """Return the period of a message [ns]; of DM1 with an active code that of the standard."""
    if _group_of(cycle) != signals.DM1:
        return cycle.period
    return float(_DM1_PERIOD) if _has_codes(cycle.last.message) else 0.0


def _group_of(cycle: _Cycle) -> int:
    return cycle.last.message.group if cycle.last.message is not None else 0


def _has_codes(message: J1939Message | None) -> bool:
    return message is not None and bool(trouble_codes(message.data or b""))
