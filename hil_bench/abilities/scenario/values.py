"""Values of signals, tick by tick: what stands on either side of a comparison."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from hil_bench.abilities.scenario.nodes import (
    Arithmetic,
    Magnitude,
    Number,
    Operation,
    PreviousValue,
    Rate,
    Reading,
    Value,
)
from hil_bench.abilities.scenario.sliding import Floats


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


_OPERATIONS: dict[Operation, Callable[[Floats, Floats], Floats]] = {
    Operation.ADD: np.add,
    Operation.SUBTRACT: np.subtract,
    Operation.MULTIPLY: np.multiply,
    Operation.DIVIDE: _divide,
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


def build_values(node: Value, tick_ns: int) -> Values:
    """Build the function that computes a value.

    Args:
        node: the value.
        tick_ns: time between two ticks [ns].
    """
    match node:
        case Number():
            number = node.value
            return lambda block: np.full(block.size, number)
        case Reading():
            name = node.name
            return lambda block: _known(block.columns[name])
        case Magnitude():
            inner = build_values(node.operand, tick_ns)
            return lambda block: np.abs(inner(block))
        case PreviousValue():
            inner, shift = build_values(node.operand, tick_ns), Shift()
            return lambda block: shift(inner(block))
        case Rate():
            return _rate(build_values(node.operand, tick_ns), 1e9 / tick_ns)
        case Arithmetic():
            return _arithmetic(node, tick_ns)


def _rate(inner: Values, ticks_a_second: float) -> Values:
    shift = Shift()

    def rate(block: Block) -> Floats:
        values = inner(block)
        return (values - shift(values)) * ticks_a_second

    return rate


def _arithmetic(node: Arithmetic, tick_ns: int) -> Values:
    operation = _OPERATIONS[node.operation]
    left, right = build_values(node.left, tick_ns), build_values(node.right, tick_ns)

    def arithmetic(block: Block) -> Floats:
        # An overflow gives infinity or NaN, which is right: large, or unknown.
        with np.errstate(all="ignore"):
            return operation(left(block), right(block))

    return arithmetic
