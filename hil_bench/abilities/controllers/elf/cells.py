"""Registers that a core reads and writes without a call of their peripheral's model."""

from array import array
from collections.abc import Mapping
from typing import Final, NamedTuple

READ: Final = 1
"""It reads as its word."""
WRITTEN: Final = 2
"""Its word keeps what is written, and nothing comes of it."""
COUNTED: Final = 4
"""It reads as a ramp."""
KEPT: Final = 8
"""A write of what its word is changes nothing."""


class Cells(NamedTuple):
    """Registers that a core reads, and some that it writes, without a call of their model.

    Attributes:
        words: their values, by number.
        kinds: of each, bits of `READ`, `WRITTEN`, `COUNTED` and `KEPT`.
        ramp: of a `COUNTED` one: when it was at 0 [ns], then it counts the second number in so
            many ns as the third, up to the fourth; while the third is 0 it reads as its word.
    """

    words: "array[int]"
    kinds: bytearray
    ramp: "array[int]"


def make_cells(count: int, kinds: Mapping[int, int]) -> Cells:
    """Return registers, all at 0.

    Args:
        count: of them.
        kinds: by offset; the others are the model's alone.
    """
    each = bytearray(kinds.get(4 * number, 0) for number in range(count))
    return Cells(array("I", bytes(4 * count)), each, array("q", bytes(32)))
