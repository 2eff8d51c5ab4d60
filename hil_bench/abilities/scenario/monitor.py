"""The monitor of a requirement: it decides as early as the run allows.

A requirement is its condition at the first tick. What spans the run, as in ``always ...``, is not
kept: a monitor holds the worst margin so far. So a violation is known a block after it is decided,
and the memory is that of the windows inside.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from hil_bench.abilities.scenario import nodes, streams, values
from hil_bench.abilities.scenario.nodes import Atom, Condition, Window
from hil_bench.abilities.scenario.streams import Combined, Stream
from hil_bench.abilities.scenario.syntax import ExpectationError
from hil_bench.abilities.scenario.values import Block, Bounds, Floats, negate

# The typed tree to streams.


class Span(NamedTuple):
    """Ticks at which a condition is asked for.

    Attributes:
        first: number of the first.
        last: of the last; None for the end of the run.
    """

    first: int
    last: int | None

    def ahead(self, start: int, end: int | None) -> "Span":
        """Return the ticks that windows ahead of these reach."""
        last = None if self.last is None or end is None else self.last + end
        return Span(self.first + start, last)

    def back(self, start: int, end: int | None) -> "Span":
        """Return the ticks that windows back from these reach."""
        first = 0 if end is None else max(0, self.first - end)
        return Span(first, None if self.last is None else max(0, self.last - start))


AT_START = Span(0, 0)


class Asked(NamedTuple):
    """A comparison, a state, an event or an edge, and the ticks at which it is asked for."""

    node: Atom
    span: Span


Wrap = Callable[[Condition, streams.Stream], streams.Stream]
"""Puts something between a stream and who reads it."""


def window_ticks(node: Condition, window: Window, tick_ns: int) -> tuple[int, int | None]:
    """Return the first and the last tick of a window: those that lie in it.

    Raises:
        ExpectationError: it lies between two ticks, where nothing is seen, or is shorter than one.
    """
    start = -(-window.start // tick_ns)
    if window.end is None:
        return start, None
    end = window.end // tick_ns
    length = window.end - window.start
    if start > end or 0 < length < tick_ns - 1:  # both bounds are rounded to 1 ns
        raise ExpectationError(
            node.position,
            f"a window of {length / 1e6:g} ms is shorter than a tick of {tick_ns / 1e6:g} ms, and "
            "between ticks nothing is seen; give a longer window or shorter ticks",
        )
    return start, end


class StreamBuilder:
    """Builds the streams of a condition.

    Args:
        tick_ns: time between two ticks [ns].
        wrap: what to put around each stream.

    Attributes:
        triggers: of each implication, its stream's counter.
        asked: all comparisons, states, events and edges.
    """

    def __init__(self, tick_ns: int, wrap: Wrap | None = None) -> None:
        self.triggers: list[tuple[nodes.Implies, streams.Trigger]] = []
        self.asked: list[Asked] = []
        self._tick_ns = tick_ns
        self._wrap = wrap or (lambda _node, stream: stream)

    def build(self, node: Condition, span: Span) -> streams.Stream:
        """Return the stream of a condition that is asked for at some ticks."""
        return self._wrap(node, self._build(node, span))

    def _build(self, node: Condition, span: Span) -> streams.Stream:
        match node:
            case nodes.Always() | nodes.Eventually():
                return self._ahead(node, span)
            case nodes.Historically() | nodes.Once():
                return self._back(node, span)
            case nodes.Until() | nodes.Since():
                return self._until(node, span)
            case nodes.Comparison() | nodes.StateIs() | nodes.Event() | nodes.Edge():
                self.asked.append(Asked(node, span))
                return streams.Atoms(self._atom(node))
            case _:
                return self._combined(node, span)

    def _combined(
        self,
        node: nodes.Not
        | nodes.All
        | nodes.Any
        | nodes.Implies
        | nodes.PreviousCondition
        | nodes.ConditionEdge,
        span: Span,
    ) -> streams.Stream:
        operands: tuple[Condition, ...]
        combine: Callable[..., values.Bounds]
        match node:
            case nodes.Not():
                operands, combine = (node.operand,), values.negate
            case nodes.All():
                operands, combine = node.operands, streams.all_of
            case nodes.Any():
                operands, combine = node.operands, streams.any_of
            case nodes.Implies():
                operands, combine = (node.trigger, node.response), self._trigger(node, span)
            case nodes.PreviousCondition():
                operands, combine, span = (node.operand,), streams.BoundsShift(), span.back(1, 1)
            case nodes.ConditionEdge():
                operands, combine = (node.operand,), streams.ConditionTurn(node.turn)
                span = span.back(0, 1)
        return streams.Combined([self.build(each, span) for each in operands], combine)

    def _trigger(self, node: nodes.Implies, span: Span) -> streams.Trigger:
        trigger = streams.Trigger(*span)
        self.triggers.append((node, trigger))
        return trigger

    def _ahead(self, node: nodes.Always | nodes.Eventually, span: Span) -> streams.Stream:
        start, end = window_ticks(node, node.window, self._tick_ns)
        extreme = np.minimum if isinstance(node, nodes.Always) else np.maximum
        child = self.build(node.operand, span.ahead(start, end))
        if end is None:
            return streams.AheadToEnd(child, extreme, start)
        return streams.Ahead(child, extreme, start, end)

    def _back(self, node: nodes.Historically | nodes.Once, span: Span) -> streams.Stream:
        start, end = window_ticks(node, node.window, self._tick_ns)
        extreme = np.minimum if isinstance(node, nodes.Historically) else np.maximum
        child = self.build(node.operand, span.back(start, end))
        if end is None:
            return streams.Combined([child], streams.BackToStart(extreme, start))
        return streams.Combined([child], streams.Back(extreme, start, end))

    def _until(self, node: nodes.Until | nodes.Since, span: Span) -> streams.Stream:
        start, end = window_ticks(node, node.window, self._tick_ns)
        if isinstance(node, nodes.Until):
            reach = span.ahead(0, end), span.ahead(start, end)
        else:
            reach = span.back(0, end), span.back(start, end)
        children = self.build(node.operand, reach[0]), self.build(node.goal, reach[1])
        if isinstance(node, nodes.Until):
            return streams.UntilAhead(children, start, end)
        since = streams.SinceStart() if end is None else streams.SinceBack(start, end)
        return streams.Combined(children, since)

    def _atom(
        self, node: nodes.Comparison | nodes.StateIs | nodes.Event | nodes.Edge
    ) -> Callable[[values.Block], values.Bounds]:
        match node:
            case nodes.Comparison():
                return values.ComparisonMargins(node, self._tick_ns)
            case nodes.StateIs():
                return partial(values.state_margins, node)
            case nodes.Event():
                return partial(values.event_margins, node)
            case nodes.Edge():
                return values.EdgeMargins(node, self._tick_ns)


# The monitor of a requirement.

Pair = tuple[float, float]
"""Lower and upper bound of the margin at the first tick."""

_UNKNOWN = (-math.inf, math.inf)


class Exercise(NamedTuple):
    """The number of times that the trigger of an implication became true.

    Attributes:
        node: the implication.
        times: how often.
    """

    node: nodes.Implies
    times: int


class _Summary(Protocol):
    """A condition at the first tick."""

    def push(self, block: Block) -> Pair:
        """Take the next ticks, and return what is known."""

    def finish(self) -> Pair:
        """Return the bounds known at the end of the run."""


class Monitor:
    """Judges one requirement while a run goes on.

    Args:
        requirement: the condition.
        tick_ns: time between two ticks [ns].
        wrap: what to put around each stream inside; for who explains the outcome.

    Attributes:
        margin: bounds of the margin, as a share of the scale of the comparison that decides.
    """

    def __init__(self, requirement: Condition, tick_ns: int, wrap: Wrap | None = None) -> None:
        self._builder = StreamBuilder(tick_ns, wrap)
        self._summary = _summarise(requirement, tick_ns, self._builder)
        self.margin: Pair = _UNKNOWN

    @property
    def is_failed(self) -> bool:
        """Return True if nothing can make the requirement hold any more."""
        return self.margin[1] < 0.0

    @property
    def is_met(self) -> bool:
        """Return True if nothing can violate the requirement any more."""
        return self.margin[0] > 0.0

    def push(self, columns: Mapping[str, Floats], count: int) -> None:
        """Take the next ticks.

        Args:
            columns: the values of each signal, shape (count,); NaN or infinite where unknown.
            count: how many ticks.
        """
        if count:
            self.margin = self._summary.push(Block(columns, count))

    def finish(self) -> None:
        """Take the end of the run; of one that was cut short, push what is missing as NaN first."""
        self.margin = self._summary.finish()

    @property
    def asked(self) -> Sequence[Asked]:
        """Its comparisons, states, events and edges, with the ticks at which it asks for them."""
        return self._builder.asked

    @property
    def exercises(self) -> tuple[Exercise, ...]:
        """The number of triggers of each implication."""
        return tuple(Exercise(node, trigger.times) for node, trigger in self._builder.triggers)


class _AtStart:
    """Any condition: the first margin of its stream."""

    def __init__(self, stream: Stream) -> None:
        self._stream = stream
        self._margin = _UNKNOWN
        self._is_decided = False

    def push(self, block: Block) -> Pair:
        return self._margin if self._is_decided else self._take(self._stream.push(block))

    def finish(self) -> Pair:
        return self._margin if self._is_decided else self._take(self._stream.finish())

    def _take(self, news: Bounds) -> Pair:
        if news.size:
            self._margin = float(news.low[0]), float(news.high[0])
            self._is_decided = True
        return self._margin


class _Throughout:
    """``always``: the lowest margin of the ticks in its window."""

    def __init__(self, stream: Stream, start: int, end: int | None) -> None:
        self._stream, self._start, self._end = stream, start, end
        self._tick = 0
        self._seen = 0
        self._low = self._high = math.inf

    def push(self, block: Block) -> Pair:
        self._take(self._stream.push(block))
        is_over = self._end is not None and self._tick > self._end
        return self._low if is_over else -math.inf, self._high

    def finish(self) -> Pair:
        self._take(self._stream.finish())
        is_short = self._end is not None and self._tick <= self._end
        is_known = self._seen and not is_short
        return self._low if is_known else -math.inf, self._high

    def _take(self, news: Bounds) -> None:
        first = self._tick
        self._tick += news.size
        start = max(0, self._start - first)
        end = None if self._end is None else max(0, self._end + 1 - first)
        part = news.cut(start, end)
        if not part.size:
            return
        self._seen += part.size
        self._low = min(self._low, float(part.low.min()))
        self._high = min(self._high, float(part.high.min()))


class _Contrary:
    """``not``."""

    def __init__(self, child: _Summary) -> None:
        self._child = child

    def push(self, block: Block) -> Pair:
        low, high = self._child.push(block)
        return -high, -low

    def finish(self) -> Pair:
        low, high = self._child.finish()
        return -high, -low


class _Sometime(_Contrary):
    """``eventually``: not always not."""

    def __init__(self, stream: Stream, start: int, end: int | None) -> None:
        super().__init__(_Throughout(Combined([stream], negate), start, end))


class _Both:
    """``and``."""

    def __init__(self, children: list[_Summary]) -> None:
        self._children = children

    def push(self, block: Block) -> Pair:
        return _lowest([child.push(block) for child in self._children])

    def finish(self) -> Pair:
        return _lowest([child.finish() for child in self._children])


def _lowest(pairs: list[Pair]) -> Pair:
    return min(low for low, _ in pairs), min(high for _, high in pairs)


def _summarise(node: Condition, tick_ns: int, builder: StreamBuilder) -> _Summary:
    match node:
        case nodes.All():
            return _Both([_summarise(each, tick_ns, builder) for each in node.operands])
        case nodes.Not():
            return _Contrary(_summarise(node.operand, tick_ns, builder))
        case nodes.Always() | nodes.Eventually():
            start, end = window_ticks(node, node.window, tick_ns)
            child = builder.build(node.operand, Span(start, end))
            if isinstance(node, nodes.Eventually):
                return _Sometime(child, start, end)
            return _Throughout(child, start, end)
        case _:
            return _AtStart(builder.build(node, AT_START))
