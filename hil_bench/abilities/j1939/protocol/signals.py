"""Signals in the data of parameter groups, with the special values of SAE J1939-71."""

import math
from collections.abc import Callable
from typing import Final, NamedTuple

_BYTE: Final = 8
_HIGHEST_VALID: Final = 0xFA
_ERROR: Final = 0xFE

NOT_AVAILABLE: Final = "not available"
"""The indicator of a signal that its sender does not have."""


def _highest(length: int) -> int:
    if length < _BYTE:
        return (1 << length) - 3
    return ((_HIGHEST_VALID + 1) << (length - _BYTE)) - 1


_HIGHEST: Final = tuple(_highest(length) for length in range(33))
"""The highest raw value that is a value, by the bits of a signal."""


class Signal(NamedTuple):
    """A number in a parameter group: value = raw × `resolution` + `offset`.

    Attributes:
        start: its lowest bit, counted from bit 0 of the first byte.
        length: bits, 2 to 32.
        resolution: of one increment; not 0.
        offset: value of raw 0.
    """

    start: int
    length: int
    resolution: float = 1.0
    offset: float = 0.0

    @property
    def not_available(self) -> int:
        """The raw value of "not available": all ones."""
        return (1 << self.length) - 1

    @property
    def error(self) -> int:
        """The raw value of the error indicator: the highest byte 0xFE, or the last but one."""
        if self.length % _BYTE:
            return self.not_available - 1
        return _ERROR << (self.length - _BYTE)

    @property
    def highest(self) -> int:
        """The highest raw value that is a value."""
        return _HIGHEST[self.length]

    def raw(self, value: float) -> int:
        """Return the raw value nearest to a value; that of the error indicator for NaN."""
        if math.isnan(value):
            return self.error
        steps = (value - self.offset) / self.resolution
        return round(min(max(steps, 0.0), float(self.highest)))

    def value(self, data: bytes) -> float:
        """Return the value in a message; NaN where it has none that is valid."""
        raw = self.raw_in(data)
        return math.nan if raw > self.highest else raw * self.resolution + self.offset

    def raw_in(self, data: bytes) -> int:
        """Return the raw value in a message; "not available" where it is too short."""
        if self.start + self.length > _BYTE * len(data):
            return self.not_available
        return int.from_bytes(data, "little") >> self.start & self.not_available

    def indicator_in(self, data: bytes) -> str:
        """Return the indicator that a message has in place of a value; empty where it has one.

        Where the signal has whole bytes, the highest one alone says so: 0xFE and 0xFF.
        """
        raw = self.raw_in(data)
        if raw <= _HIGHEST[self.length]:
            return ""
        whole = self.length >= _BYTE and self.length % _BYTE == 0
        low = self.length - _BYTE if whole else 0
        if raw >> low == self.not_available >> low:
            return NOT_AVAILABLE
        return "error" if raw >> low == self.error >> low else "reserved"

    def put(self, message: int, raw: int) -> int:
        """Return a message, as a number of the lowest byte first, with this raw value in it."""
        return message & ~(self.not_available << self.start) | raw << self.start


# The numbers of a J1939 device by name, for those who read and set them.


class EcuValue(NamedTuple):
    """A number that a J1939 device has, as its table gives it.

    Attributes:
        read: returns it; NaN where it shows no value.
        unit: symbol of its unit.
        takes: takes another one, from a test; None where the device itself has the say.
        low: the least that it can show.
        high: the largest.
    """

    read: Callable[[], float]
    unit: str
    takes: Callable[[float], None] | None = None
    low: float = -math.inf
    high: float = math.inf
