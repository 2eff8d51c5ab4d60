"""The search for the comparison that decides a requirement, and for its tick."""

from typing import NamedTuple

import numpy as np

from hil_bench.abilities.scenario import nodes
from hil_bench.abilities.scenario.bounds import Bounds, join
from hil_bench.abilities.scenario.build import window_ticks
from hil_bench.abilities.scenario.nodes import Atom, Condition, Window
from hil_bench.abilities.scenario.sliding import Floats
from hil_bench.abilities.scenario.streams import Stream
from hil_bench.abilities.scenario.values import Block


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
