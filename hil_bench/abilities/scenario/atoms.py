"""The margins of comparisons, states, events and edges."""

import math

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.scenario.bounds import Bounds, exact
from hil_bench.abilities.scenario.nodes import Comparison, Edge, Event, Relation, StateIs, Turn
from hil_bench.abilities.scenario.sliding import Floats
from hil_bench.abilities.scenario.values import Block, Shift, build_values

_TINY = 5e-324  # the smallest margin: 0 would be neither true nor false
_RELATIONS = {
    Relation.LESS: np.less,
    Relation.LESS_EQUAL: np.less_equal,
    Relation.GREATER: np.greater,
    Relation.GREATER_EQUAL: np.greater_equal,
    Relation.EQUAL: np.equal,
    Relation.UNEQUAL: np.not_equal,
}
_SIGNS = {
    Relation.LESS: -1.0,
    Relation.LESS_EQUAL: -1.0,
    Relation.GREATER: 1.0,
    Relation.GREATER_EQUAL: 1.0,
}
_TURNS = {Turn.RISES: np.greater, Turn.FALLS: np.less, Turn.CHANGES: np.not_equal}

Truths = npt.NDArray[np.bool_]


def signed(is_true: Truths, sizes: Floats | float, is_unknown: Truths) -> Bounds:
    """Return margins of some size: positive where true, and unknown where that is so."""
    margins = np.copysign(sizes, is_true - 0.5)
    if not is_unknown.any():
        return exact(margins)
    return Bounds(np.where(is_unknown, -math.inf, margins), np.where(is_unknown, math.inf, margins))


class ComparisonMargins:
    """The margins of a comparison: the difference of both sides, as a share of the scale."""

    def __init__(self, node: Comparison, tick_ns: int) -> None:
        self._left = build_values(node.left, tick_ns)
        self._right = build_values(node.right, tick_ns)
        self._relation = _RELATIONS[node.relation]
        self._scale = node.scale
        self._sign = _SIGNS.get(node.relation, 0.0)

    def __call__(self, block: Block) -> Bounds:
        """Return the margins of the next ticks."""
        left, right = self._left(block), self._right(block)
        if self._sign:  # where all differ, a third of the work
            with np.errstate(invalid="ignore", over="ignore"):
                margins = (left - right) / (self._sign * self._scale)
            if margins.all() and not np.isnan(margins).any():
                return exact(margins)
        with np.errstate(invalid="ignore", over="ignore"):
            sizes = np.abs(left - right) / self._scale
        sizes = np.fmax(sizes, _TINY)  # equal infinities differ by NaN, and by nothing
        return signed(self._relation(left, right), sizes, np.isnan(left) | np.isnan(right))


class StateMargins:
    """The margins of a state: without size."""

    def __init__(self, node: StateIs) -> None:
        self._node = node

    def __call__(self, block: Block) -> Bounds:
        """Return the margins of the next ticks."""
        codes = block.columns[self._node.name]
        return signed(codes == self._node.code, math.inf, ~np.isfinite(codes))


class EventMargins:
    """The margins of an event: without size."""

    def __init__(self, node: Event) -> None:
        self._name = node.name

    def __call__(self, block: Block) -> Bounds:
        """Return the margins of the next ticks."""
        happened = block.columns[self._name]
        return signed(happened > 0.0, math.inf, ~np.isfinite(happened))


class EdgeMargins:
    """The margins of an edge: without size."""

    def __init__(self, node: Edge, tick_ns: int) -> None:
        self._values = build_values(node.operand, tick_ns)
        self._turn = _TURNS[node.turn]
        self._shift = Shift()

    def __call__(self, block: Block) -> Bounds:
        """Return the margins of the next ticks."""
        values = self._values(block)
        before = self._shift(values)
        return signed(self._turn(values, before), math.inf, np.isnan(values) | np.isnan(before))


def turn_margins(turn: Turn, now: Bounds, before: Bounds) -> Bounds:
    """Return the margins of an edge of a condition: without size."""
    is_unknown = np.zeros(now.size, dtype=np.bool_)
    for bounds in (now, before):
        if not bounds.is_exact:
            is_unknown |= (bounds.low < 0.0) & (bounds.high > 0.0)
    one, other = now.low > 0.0, before.low > 0.0
    found = {Turn.RISES: one & ~other, Turn.FALLS: ~one & other, Turn.CHANGES: one != other}
    return signed(found[turn], math.inf, is_unknown)
