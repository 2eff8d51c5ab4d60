"""A requirement held against a whole run: its margin, what decided it, and how much was seen."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.scenario import nodes
from hil_bench.abilities.scenario.monitor import Asked, Monitor, window_ticks
from hil_bench.abilities.scenario.nodes import Atom, Condition, Window
from hil_bench.abilities.scenario.reach import breadth, has_duration, names_in, walk
from hil_bench.abilities.scenario.streams import Stream
from hil_bench.abilities.scenario.syntax import DEEPEST
from hil_bench.abilities.scenario.values import Block, Bounds, Floats, join

if TYPE_CHECKING:
    from hil_bench.abilities.scenario.values import Truths


# The search for the comparison that decides a requirement, and for its tick.


class Cause(NamedTuple):
    """The cause of a decision.

    Attributes:
        node: the comparison, state, event or edge.
        tick: at which.
        is_true: whether it is true then.
    """

    node: Atom
    tick: int
    is_true: bool


class Log:
    """Keeps the margins of each condition of a requirement, while a monitor judges it."""

    def __init__(self) -> None:
        self._parts: dict[int, list[Bounds]] = {}
        self._whole: dict[int, Bounds] = {}

    def wrap(self, node: Condition, stream: Stream) -> Stream:
        """Return a stream that is kept."""
        return _Logged(stream, self._parts.setdefault(id(node), []))

    def margins(self, node: Condition) -> Bounds:
        """Return the margins of a condition, all ticks."""
        if id(node) not in self._whole:
            self._whole[id(node)] = join(self._parts[id(node)])
        return self._whole[id(node)]

    def has(self, node: Condition) -> bool:
        """Return True if the margins of a condition are kept: it is inside the outermost ones."""
        return id(node) in self._parts


class _Logged:
    def __init__(self, stream: Stream, parts: list[Bounds]) -> None:
        self._stream, self._parts = stream, parts

    def push(self, block: Block) -> Bounds:
        found = self._stream.push(block)
        self._parts.append(found)
        return found

    def finish(self) -> Bounds:
        found = self._stream.finish()
        self._parts.append(found)
        return found


class Explainer:
    """Walks from a requirement down to what decides it.

    Args:
        log: of the monitor that judged it.
        tick_ns: time between two ticks [ns].
        ticks: of the run.
        is_failed: whether it failed: then the upper bounds decide.
    """

    def __init__(self, log: Log, tick_ns: int, ticks: int, *, is_failed: bool) -> None:
        self._log, self._tick_ns, self._ticks = log, tick_ns, ticks
        self._is_failed = is_failed

    def find(self, node: Condition, tick: int = 0) -> Cause:
        """Return the cause that decides a condition at a tick."""
        match node:
            case nodes.Not():
                cause = self._contrary().find(node.operand, tick)
            case nodes.All() | nodes.Any():
                pick = min if isinstance(node, nodes.All) else max
                operand = pick(node.operands, key=lambda each: self.margin(each, tick))
                cause = self.find(operand, tick)
            case nodes.Implies():
                cause = self._implication(node, tick)
            case nodes.PreviousCondition():
                cause = self.find(node.operand, max(0, tick - 1))
            case nodes.Always() | nodes.Eventually() | nodes.Historically() | nodes.Once():
                cause = self.find(node.operand, self._extreme(node, tick))
            case nodes.Until() | nodes.Since():
                cause = self._until(node, tick)
            case _:
                cause = Cause(node, tick, not self._is_failed)
        return cause

    def _contrary(self) -> "Explainer":
        return Explainer(self._log, self._tick_ns, self._ticks, is_failed=not self._is_failed)

    def _margins(self, node: Condition) -> Floats:
        bounds = self._log.margins(node)
        return bounds.high if self._is_failed else bounds.low

    def margin(self, node: Condition, tick: int) -> float:
        """Return the margin at a tick; of what spans the run it is not kept, but found here.

        Raises:
            TypeError: a bug: a condition is neither.
        """
        if self._log.has(node):
            return float(self._margins(node)[tick])
        match node:
            case nodes.Not():
                return -self._contrary().margin(node.operand, tick)
            case nodes.All():
                return min(self.margin(each, tick) for each in node.operands)
            case nodes.Always() | nodes.Eventually():
                return self._margin_of_window(node, tick)
            case _:
                raise TypeError(f"{type(node).__name__} is kept")

    def _margin_of_window(self, node: nodes.Always | nodes.Eventually, tick: int) -> float:
        first, last = self._reach(node, node.window, tick, 1)
        part = self._margins(node.operand)[first : last + 1]
        _, end = window_ticks(node, node.window, self._tick_ns)
        if not len(part) or (end is not None and tick + end >= self._ticks):  # unknown behind
            part = np.append(part, np.inf if self._is_failed else -np.inf)
        return float(part.min() if isinstance(node, nodes.Always) else part.max())

    def _implication(self, node: nodes.Implies, tick: int) -> Cause:
        bounds = self._log.margins(node.trigger)
        trigger = -(bounds.low if self._is_failed else bounds.high)[tick]
        if trigger > self.margin(node.response, tick):
            return self._contrary().find(node.trigger, tick)
        return self.find(node.response, tick)

    def _extreme(
        self, node: nodes.Always | nodes.Eventually | nodes.Historically | nodes.Once, tick: int
    ) -> int:
        is_ahead = isinstance(node, nodes.Always | nodes.Eventually)
        first, last = self._reach(node, node.window, tick, 1 if is_ahead else -1)
        part = self._margins(node.operand)[first : last + 1]
        is_lowest = isinstance(node, nodes.Always | nodes.Historically)
        if not len(part):
            return tick  # an empty past decides
        return first + int(np.argmin(part) if is_lowest else np.argmax(part))

    def _until(self, node: nodes.Until | nodes.Since, tick: int) -> Cause:
        sign = 1 if isinstance(node, nodes.Until) else -1
        first, last = self._reach(node, node.window, tick, sign)
        held, goal = self._margins(node.operand), self._margins(node.goal)
        best, lowest, lowest_at = -np.inf, np.inf, tick
        cause: tuple[Condition, int] = (node.goal, tick)
        for at in range(tick, (last if sign == 1 else first) + sign, sign):
            if first <= at <= last and min(goal[at], lowest) > best:
                best = min(goal[at], lowest)
                cause = (node.goal, at) if goal[at] <= lowest else (node.operand, lowest_at)
            if held[at] < lowest:
                lowest, lowest_at = held[at], at
        if self._may_come_later(node, tick) and lowest > best:
            cause = (node.operand, lowest_at)
        return self.find(*cause)

    def _may_come_later(self, node: nodes.Until | nodes.Since, tick: int) -> bool:
        """Return True if the goal has a window that reaches behind the run, where it may be true.

        Then it is not the goal that fails, but what has to hold until it comes.
        """
        end = node.window.end
        is_open = isinstance(node, nodes.Until) and self._is_failed and end is not None
        return is_open and tick + (end or 0) // self._tick_ns >= self._ticks

    def _reach(self, node: Condition, window: Window, tick: int, sign: int) -> tuple[int, int]:
        start, end = window_ticks(node, window, self._tick_ns)
        if sign == 1:
            last = self._ticks - 1 if end is None else min(self._ticks - 1, tick + end)
            return tick + start, last
        return (0 if end is None else max(0, tick - end)), tick - start


# The share of a requirement's time seen in a run; docs/expectations.md has the rules.


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
        if not self.unknown:
            return 1.0  # by count: 0.2 of 2.0 - 1.8 is not one
        length = self.end - self.start
        return self.seen / length if length else 0.0

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


# A requirement held against a whole run, with all that led to its margin.

_HEAD = 8192  # ticks that come first: what they decide needs no more


class Examination:
    """A requirement and a run.

    Args:
        requirement: the condition.
        columns: the values of each signal that it names, shape (ticks,); NaN where unknown.
        ticks: how many of them were seen.
        tick_ns: time between two [ns].
        planned: how many ticks the run has; those behind the ones seen are unknown. None for a run
            that ends with what was seen.

    Attributes:
        monitor: that has seen the whole run.
        view: how much of the requirement's time was seen.
        values: the values of each signal, up to where nothing changes any more.
    """

    def __init__(
        self,
        requirement: Condition,
        columns: Mapping[str, Floats],
        ticks: int,
        tick_ns: int,
        planned: int | None = None,
    ) -> None:
        ticks = ticks if planned is None else min(ticks, planned)
        unseen = 0 if planned is None else min(planned - ticks, _settling(requirement, tick_ns))
        seen = {name: column[:ticks] for name, column in columns.items()}
        self.values = Block(
            {n: _padded(column, unseen) for n, column in seen.items()}, ticks + unseen
        )
        self._requirement, self._ticks, self._tick_ns = requirement, ticks + unseen, tick_ns
        self._log = Log()
        self.monitor = Monitor(requirement, tick_ns, self._log.wrap)
        self._seen = ticks
        for start, end in pairwise(sorted({0, min(_HEAD, ticks), ticks, self._ticks})):
            part = {name: column[start:end] for name, column in self.values.columns.items()}
            self.monitor.push(part, end - start)
        self.monitor.finish()
        self.view = View(self.monitor.asked, seen, ticks, tick_ns, planned)

    def find_cause(self) -> Cause:
        """Return the cause of the decision; only where the requirement is decided."""
        is_failed = self.monitor.is_failed
        explainer = Explainer(self._log, self._tick_ns, self._ticks, is_failed=is_failed)
        return explainer.find(self._requirement)

    @property
    def first_violated(self) -> int | None:
        """The first tick that violates the requirement, where it says of each that it must hold."""
        found = np.flatnonzero(self._violated(self._requirement))
        return int(found[0]) if found.size else None

    @property
    def violated_time(self) -> float:
        """For how long it was seen violated [s]; 0 where its violations are instants.

        A tick stands for the time to the next one, the last one that was seen for none.
        """
        found = self._violated(self._requirement, lasting=True)
        return min(int(np.count_nonzero(found)) * self._tick_ns / 1e9, self.view.coverage.seen)

    def violated_spans(self) -> list[tuple[int, int]]:
        """Return first and last tick of each time in which the requirement is violated.

        Only a requirement that says of each tick that it must hold has such times; of the run, what
        was seen.
        """
        found = self._violated(self._requirement)[: self._seen]
        edges = np.diff(found.astype(np.int8), prepend=0, append=0)
        starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
        return list(zip(starts.tolist(), ends.tolist(), strict=True))

    def stillness(self) -> str:
        """Say that no signal of a requirement about signals alone ever changed; else nothing."""
        pieces = list(walk([self._requirement]))
        names = sorted({each.name for each in pieces if isinstance(each, nodes.Reading)})
        if not names or any(isinstance(each, nodes.StateIs | nodes.Event) for each in pieces):
            return ""
        columns = [self.values.columns[name][: self._seen] for name in names]
        seen = [column[np.isfinite(column)] for column in columns]
        has_changed = any((column[1:] != column[:-1]).any() for column in seen)
        if has_changed or self._seen < 2:
            return ""
        where = " where it was seen" if sum(map(len, seen)) < sum(map(len, columns)) else ""
        return f"{', '.join(names)} never changed{where}"

    def idle_wait(self) -> str:
        """Say that a fulfilled requirement waits for what was so from the start; else nothing.

        It is looked for where the requirement is a wait itself, or one behind each of its triggers.
        """
        match self._requirement:
            case nodes.Eventually() | nodes.Until() as wait:
                starts, when = np.zeros(1, dtype=np.intp), "from the start"
            case nodes.Always(
                window=window,
                operand=nodes.Implies(trigger, nodes.Eventually() | nodes.Until() as wait),
            ):
                start, end = window_ticks(self._requirement, window, self._tick_ns)
                asked = self._log.margins(trigger).low[start : None if end is None else end + 1]
                starts, when = np.flatnonzero(asked > 0.0) + start, "at each trigger already"
            case _:
                return ""
        goal = wait.goal if isinstance(wait, nodes.Until) else wait.operand
        low = self._log.margins(goal).low
        first = starts + window_ticks(wait, wait.window, self._tick_ns)[0]
        is_idle = first.size and first.max() < low.size and np.all(low[first] > 0.0)
        return f"what it waits for was so {when}" if is_idle else ""

    def _violated(self, node: Condition, *, lasting: bool = False) -> npt.NDArray[np.bool_]:
        found = np.zeros(self._ticks, dtype=np.bool_)
        if isinstance(node, nodes.All):
            for operand in node.operands:
                found |= self._violated(operand, lasting=lasting)
        elif isinstance(node, nodes.Always) and (not lasting or has_duration(node.operand)):
            start, end = window_ticks(node, node.window, self._tick_ns)
            stop = self._ticks if end is None else min(self._ticks, end + 1)
            if lasting:
                stop = max(0, min(stop, self._seen) - 1)
            part = self._log.margins(node.operand).high[start:stop] < 0.0
            found[start : start + len(part)] = part
        return found


def _settling(requirement: Condition, tick_ns: int) -> int:
    """Return after how many ticks that are all unknown another one changes nothing.

    By then each window lies in them as a whole. A level rounds it up by a tick, or looks a tick
    back.
    """
    return breadth(requirement) // tick_ns + DEEPEST


def _padded(column: Floats, count: int) -> Floats:
    """Return a column with unknown values behind it."""
    return np.concatenate((column, np.full(count, np.nan))) if count else column
