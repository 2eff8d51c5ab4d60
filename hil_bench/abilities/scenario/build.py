"""The typed tree to streams."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hil_bench.abilities.scenario import nodes, streams, values
from hil_bench.abilities.scenario.nodes import Atom, Condition, Window
from hil_bench.abilities.scenario.syntax import ExpectationError


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
                return values.StateMargins(node)
            case nodes.Event():
                return values.EventMargins(node)
            case nodes.Edge():
                return values.EdgeMargins(node, self._tick_ns)
