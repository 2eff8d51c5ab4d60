"""The monitor of a requirement: it decides as early as the run allows.

A requirement is its condition at the first tick. What spans the run, as in ``always ...``, is not
kept: a monitor holds the worst margin so far. So a violation is known a block after it is decided,
and the memory is that of the windows inside.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

from hil_bench.abilities.scenario import build, nodes
from hil_bench.abilities.scenario.nodes import Condition
from hil_bench.abilities.scenario.streams import Combined, Stream
from hil_bench.abilities.scenario.values import Block, Bounds, Floats, negate

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

    def __init__(
        self, requirement: Condition, tick_ns: int, wrap: build.Wrap | None = None
    ) -> None:
        self._builder = build.StreamBuilder(tick_ns, wrap)
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
    def asked(self) -> Sequence[build.Asked]:
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


def _summarise(node: Condition, tick_ns: int, builder: build.StreamBuilder) -> _Summary:
    match node:
        case nodes.All():
            return _Both([_summarise(each, tick_ns, builder) for each in node.operands])
        case nodes.Not():
            return _Contrary(_summarise(node.operand, tick_ns, builder))
        case nodes.Always() | nodes.Eventually():
            start, end = build.window_ticks(node, node.window, tick_ns)
            child = builder.build(node.operand, build.Span(start, end))
            if isinstance(node, nodes.Eventually):
                return _Sometime(child, start, end)
            return _Throughout(child, start, end)
        case _:
            return _AtStart(builder.build(node, build.AT_START))
