"""The encoding of numbers in 16-bit registers.

Each register is sent high byte first (MODBUS Application Protocol V1.1b3, 4.2). In which order the
two registers of a 32-bit value come is left open there, and real devices differ: `WordOrder`.

A value that a type cannot hold stands at its nearest end. What is no number is NaN in a float32, in
a signed integer the lowest value and in an unsigned one the highest.
"""

import math
import struct
from collections.abc import Mapping, Sequence
from enum import StrEnum
from types import MappingProxyType
from typing import Final, NamedTuple

_LARGEST_FLOAT32: Final = struct.unpack(">f", bytes.fromhex("7f7fffff"))[0]


class WordOrder(StrEnum):
    """The order of the two registers of a 32-bit value."""

    BIG = "big"
    """The high word, as in ABCD."""
    LITTLE = "little"
    """The low word, as in CDAB."""


class DataType(NamedTuple):
    """One type of value.

    Attributes:
        name: as in a register map.
        letter: its letter in a `struct` format.
        size: registers that it takes; 0 for a bit.
        low: lowest value.
        high: highest value.
    """

    name: str
    letter: str
    size: int
    low: float
    high: float

    @property
    def is_real(self) -> bool:
        """Return True if it holds fractions."""
        return self.letter == "f"

    @property
    def no_value(self) -> float:
        """The number that stands for an invalid value."""
        if self.is_real:
            return math.nan
        return self.low if self.low < 0 else self.high

    def encode(self, value: float, order: WordOrder) -> Sequence[int]:
        """Return the registers of a value, saturated."""
        value = self.no_value if math.isnan(value) else min(max(value, self.low), self.high)
        raw = struct.pack(f">{self.letter}", value if self.is_real else round(value))
        words = struct.unpack(f">{self.size}H", raw)
        return words if order is WordOrder.BIG else words[::-1]

    def decode(self, words: Sequence[int], order: WordOrder) -> float:
        """Return the value of its registers."""
        ordered = words if order is WordOrder.BIG else words[::-1]
        raw = struct.pack(f">{self.size}H", *ordered)
        return float(struct.unpack(f">{self.letter}", raw)[0])


BIT: Final = DataType("bit", "", 0, 0, 1)

DATA_TYPES: Final[Mapping[str, DataType]] = MappingProxyType(
    {
        data_type.name: data_type
        for data_type in (
            DataType("int16", "h", 1, -(2**15), 2**15 - 1),
            DataType("uint16", "H", 1, 0, 2**16 - 1),
            DataType("int32", "i", 2, -(2**31), 2**31 - 1),
            DataType("uint32", "I", 2, 0, 2**32 - 1),
            DataType("float32", "f", 2, -_LARGEST_FLOAT32, _LARGEST_FLOAT32),
        )
    }
)
"""The types of a register, by name."""
