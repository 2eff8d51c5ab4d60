"""The margin of a condition as a lower and an upper bound, tick by tick.

A margin is how far a condition is from changing: positive where it holds, negative where it does
not, never 0. Where nothing is known, the bounds are -inf and +inf. Where both bounds are the same
array, the margins are exact, and nothing is computed twice.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from hil_bench.abilities.scenario.sliding import Floats


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
