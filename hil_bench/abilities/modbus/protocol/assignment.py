"""An assignment: a part of a write request, in the form that the loop takes."""

from typing import NamedTuple


class Assignment(NamedTuple):
    """A value that a client wrote.

    Attributes:
        position: of the value in the row of all values.
        value: in SI, or as the object counts it; for a mask, AND mask << 16 | OR mask.
        is_mask: whether it changes some bits of a register only (function 22).
    """

    position: int
    value: float
    is_mask: bool = False
