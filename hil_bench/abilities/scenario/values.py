"""Values, comparisons, states, events and edges of an expectation as arrays, tick by tick."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.scenario import nodes

# Sliding minimum and maximum, and `until`, over whole arrays.
#
# The extreme of a window is that of two shorter ones that overlap, so their length doubles with
# each pass. A window of 2^k samples takes k passes; up to the length of a whole run that is
# faster than the algorithm of van Herk, Gil and Werman with its running extremes, which numpy
# cannot vectorise.

Floats = npt.NDArray[np.float64]


def slide(extreme: np.ufunc, values: Floats, width: int) -> Floats:
    """Return the extreme of each whole window.

    Args:
        extreme: ``np.minimum`` or ``np.maximum``.
        values: shape (n,).
        width: of the window, in samples, 1 or more.

    Returns:
        Of shape (n - width + 1,), empty where no window is whole.
    """
    count = len(values) - width + 1
    if count <= 0:
        return values[:0]
    reach, found = 1, values
    while 2 * reach <= width:
        found = extreme(found[:-reach], found[reach:])
        reach *= 2
    return np.asarray(extreme(found[:count], found[width - reach : width - reach + count]))


def until(held: Floats, goal: Floats) -> Floats:
    """Return `u` with ``u[k] = max(goal[k], min(held[k], u[k + 1]))``, and -inf behind the end.

    Each step maps the later value by ``max(a, min(b, u))``, and so do steps in a row. The array is
    cut into rows: first the map of each row, then the value behind each row, then all values.
    """
    columns = math.isqrt(len(held)) + 1
    rows = -(-len(held) // columns)
    holds, goals = np.full((2, rows * columns), math.inf)
    holds[: len(held)] = held
    goals[:] = -math.inf
    goals[: len(goal)] = goal
    by_column = np.ascontiguousarray(holds.reshape(rows, columns).T)
    goal_by_column = np.ascontiguousarray(goals.reshape(rows, columns).T)
    low, high = np.full(rows, -math.inf), np.full(rows, math.inf)
    for bound, aim in zip(by_column[::-1], goal_by_column[::-1], strict=True):
        low = np.maximum(aim, np.minimum(bound, low))
        high = np.minimum(bound, high)
    later = np.empty(rows)
    value = -math.inf
    for row in range(rows - 1, -1, -1):
        later[row] = value
        value = max(low[row], min(high[row], value))
    found = np.empty((columns, rows))
    for column in range(columns - 1, -1, -1):
        later = np.maximum(goal_by_column[column], np.minimum(by_column[column], later))
        found[column] = later
    return np.ascontiguousarray(found.T).ravel()[: len(held)]


# Values of signals, tick by tick: what stands on either side of a comparison.


class Block(NamedTuple):
    """Consecutive ticks of a run.

    Attributes:
        columns: the values of each signal, state and event, shape (size,); NaN or infinite
            where unknown.
        size: how many ticks, 1 or more.
    """

    columns: Mapping[str, Floats]
    size: int


Values = Callable[[Block], Floats]
"""Gives the values of the next ticks; it remembers what it needs of the ticks before."""


def _known(values: Floats) -> Floats:
    """Return readings with NaN for each that is infinite: no sensor shows that."""
    return np.where(np.isinf(values), np.nan, values) if np.isinf(values).any() else values


def _divide(left: Floats, right: Floats) -> Floats:
    """Return quotients; one by 0 is unknown: the sign of an infinity would be that of the zero."""
    return np.asarray(np.divide(left, np.where(right == 0.0, np.nan, right)))


_OPERATIONS: dict[nodes.Operation, Callable[[Floats, Floats], Floats]] = {
    nodes.Operation.ADD: np.add,
    nodes.Operation.SUBTRACT: np.subtract,
    nodes.Operation.MULTIPLY: np.multiply,
    nodes.Operation.DIVIDE: _divide,
}


class Shift:
    """Values one tick late; at the first tick, the present one."""

    def __init__(self) -> None:
        self._last: float | None = None

    def __call__(self, values: Floats) -> Floats:
        """Return the values of the ticks before these."""
        shifted = np.empty_like(values)
        shifted[1:] = values[:-1]
        shifted[0] = values[0] if self._last is None else self._last
        self._last = values[-1]
        return shifted


def build_values(node: nodes.Value, tick_ns: int) -> Values:
    """Build the function that computes a value.

    Args:
        node: the value.
        tick_ns: time between two ticks [ns].
    """
    match node:
        case nodes.Number():
            number = node.value
            return lambda block: np.full(block.size, number)
        case nodes.Reading():
            name = node.name
            return lambda block: _known(block.columns[name])
        case nodes.Magnitude():
            inner = build_values(node.operand, tick_ns)
            return lambda block: np.abs(inner(block))
        case nodes.PreviousValue():
            inner, shift = build_values(node.operand, tick_ns), Shift()
            return lambda block: shift(inner(block))
        case nodes.Rate():
            return _rate(build_values(node.operand, tick_ns), 1e9 / tick_ns)
        case nodes.Arithmetic():
            return _arithmetic(node, tick_ns)


def _rate(inner: Values, ticks_a_second: float) -> Values:
    shift = Shift()

    def rate(block: Block) -> Floats:
        values = inner(block)
        return (values - shift(values)) * ticks_a_second

    return rate


def _arithmetic(node: nodes.Arithmetic, tick_ns: int) -> Values:
    operation = _OPERATIONS[node.operation]
    left, right = build_values(node.left, tick_ns), build_values(node.right, tick_ns)

    def arithmetic(block: Block) -> Floats:
        # An overflow gives infinity or NaN, which is right: large, or unknown.
        with np.errstate(all="ignore"):
            return operation(left(block), right(block))

    return arithmetic


# The margin of a condition as a lower and an upper bound, tick by tick.
#
# A margin is how far a condition is from changing: positive where it holds, negative where it
# does not, never 0. Where nothing is known, the bounds are -inf and +inf. Where both bounds are
# the same array, the margins are exact, and nothing is computed twice.


class Bounds(NamedTuple):
    """Bounds of the margins of consecutive ticks.

    Attributes:
        low: shape (ticks,).
        high: likewise; the same object where the margins are exact.
    """

    low: Floats
    high: Floats

    @property
    def size(self) -> int:
        """The number of ticks."""
        return len(self.low)

    @property
    def is_exact(self) -> bool:
        """Return True if both bounds are the same."""
        return self.high is self.low

    def cut(self, start: int, end: int | None = None) -> "Bounds":
        """Return the bounds of some of the ticks."""
        low = self.low[start:end]
        return Bounds(low, low if self.is_exact else self.high[start:end])


def exact(margins: Floats) -> Bounds:
    """Return margins that are known."""
    return Bounds(margins, margins)


def constant(low: float, high: float, count: int) -> Bounds:
    """Return the same bounds for some ticks."""
    if low == high:
        return exact(np.full(count, low))
    return Bounds(np.full(count, low), np.full(count, high))


def unknown(count: int) -> Bounds:
    """Return the bounds of ticks of which nothing is known."""
    return constant(-math.inf, math.inf, count)


NOTHING = exact(np.empty(0))


def join(parts: Sequence[Bounds]) -> Bounds:
    """Return bounds one behind the other."""
    parts = [part for part in parts if part.size]
    if not parts:
        return NOTHING
    if len(parts) == 1:
        return parts[0]
    low = np.concatenate([part.low for part in parts])
    if all(part.is_exact for part in parts):
        return exact(low)
    return Bounds(low, np.concatenate([part.high for part in parts]))


def map_bounds(function: Callable[..., Floats], *operands: Bounds) -> Bounds:
    """Return a function of margins that grows with each of them."""
    low = function(*(operand.low for operand in operands))
    if all(operand.is_exact for operand in operands):
        return exact(low)
    return Bounds(low, function(*(operand.high for operand in operands)))


def negate(operand: Bounds) -> Bounds:
    """Return the margins of the contrary."""
    low = -operand.high
    return exact(low) if operand.is_exact else Bounds(low, -operand.low)


# The margins of comparisons, states, events and edges.

_TINY = 5e-324  # the smallest margin: 0 would be neither true nor false
_RELATIONS = {
    nodes.Relation.LESS: np.less,
    nodes.Relation.LESS_EQUAL: np.less_equal,
    nodes.Relation.GREATER: np.greater,
    nodes.Relation.GREATER_EQUAL: np.greater_equal,
    nodes.Relation.EQUAL: np.equal,
    nodes.Relation.UNEQUAL: np.not_equal,
}
_SIGNS = {
    nodes.Relation.LESS: -1.0,
    nodes.Relation.LESS_EQUAL: -1.0,
    nodes.Relation.GREATER: 1.0,
    nodes.Relation.GREATER_EQUAL: 1.0,
}
_TURNS = {nodes.Turn.RISES: np.greater, nodes.Turn.FALLS: np.less, nodes.Turn.CHANGES: np.not_equal}

Truths = npt.NDArray[np.bool_]


def signed(is_true: Truths, sizes: Floats | float, is_unknown: Truths) -> Bounds:
    """Return margins of some size: positive where true, and unknown where that is so."""
    margins = np.copysign(sizes, is_true - 0.5)
    if not is_unknown.any():
        return exact(margins)
    return Bounds(np.where(is_unknown, -math.inf, margins), np.where(is_unknown, math.inf, margins))


class ComparisonMargins:
    """The margins of a comparison: the difference of both sides, as a share of the scale."""

    def __init__(self, node: nodes.Comparison, tick_ns: int) -> None:
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


def state_margins(node: nodes.StateIs, block: Block) -> Bounds:
    """Return the margins of a state: without size."""
    codes = block.columns[node.name]
    return signed(codes == node.code, math.inf, ~np.isfinite(codes))


def event_margins(node: nodes.Event, block: Block) -> Bounds:
    """Return the margins of an event: without size."""
    happened = block.columns[node.name]
    return signed(happened > 0.0, math.inf, ~np.isfinite(happened))


class EdgeMargins:
    """The margins of an edge: without size."""

    def __init__(self, node: nodes.Edge, tick_ns: int) -> None:
        self._values = build_values(node.operand, tick_ns)
        self._turn = _TURNS[node.turn]
        self._shift = Shift()

    def __call__(self, block: Block) -> Bounds:
        """Return the margins of the next ticks."""
        values = self._values(block)
        before = self._shift(values)
        return signed(self._turn(values, before), math.inf, np.isnan(values) | np.isnan(before))


def turn_margins(turn: nodes.Turn, now: Bounds, before: Bounds) -> Bounds:
    """Return the margins of an edge of a condition: without size."""
    is_unknown = np.zeros(now.size, dtype=np.bool_)
    for bounds in (now, before):
        if not bounds.is_exact:
            is_unknown |= (bounds.low < 0.0) & (bounds.high > 0.0)
    one, other = now.low > 0.0, before.low > 0.0
    found = {
        nodes.Turn.RISES: one & ~other,
        nodes.Turn.FALLS: ~one & other,
        nodes.Turn.CHANGES: one != other,
    }
    return signed(found[turn], math.inf, is_unknown)
