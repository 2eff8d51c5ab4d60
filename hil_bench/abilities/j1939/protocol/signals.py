"""Identifiers and signals of J1939."""

import math
from collections.abc import Callable
from typing import Final, NamedTuple

# Signals in the data of parameter groups, with the special values of SAE J1939-71.


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


# Identifiers and NAMEs of SAE J1939.


# The 29-bit identifier of SAE J1939-21.
#
# It holds priority (3 bits), data page (2), PDU format PF (8), PDU specific PS (8) and source
# address (8). A PF below 240 is sent to the address PS, and the parameter group number (PGN) is
# data page and PF; from 240 on PS belongs to the PGN and all are meant.

GLOBAL: Final = 0xFF
"""The address of all."""

NULL: Final = 0xFE
"""The source address of a device that has none."""

ACKNOWLEDGEMENT: Final = 0xE800
REQUEST: Final = 0xEA00
TRANSPORT_DATA: Final = 0xEB00
TRANSPORT_CONNECTION: Final = 0xEC00
ADDRESS_CLAIMED: Final = 0xEE00
DM1: Final = 0xFECA
DM2: Final = 0xFECB
DM3: Final = 0xFECC
COMMANDED_ADDRESS: Final = 0xFED8
SOFTWARE: Final = 0xFEDA
COMPONENT: Final = 0xFEEB
VEHICLE: Final = 0xFEEC

HIGHEST_GROUP: Final = 0x3FFFF

_TO_ALL: Final = 240


class Identifier(NamedTuple):
    """The fields of a 29-bit identifier.

    Attributes:
        priority: 0, the highest, to 7.
        group: the PGN.
        source: address of the sender.
        destination: address of the receiver; `GLOBAL` for all.
    """

    priority: int
    group: int
    source: int
    destination: int


def split(can_id: int) -> Identifier:
    """Return the parts of a 29-bit identifier."""
    group, destination = can_id >> 8 & HIGHEST_GROUP, GLOBAL
    if not is_to_all(group):
        group, destination = group & ~0xFF, group & 0xFF
    return Identifier(can_id >> 26 & 7, group, can_id & 0xFF, destination)


def join(priority: int, group: int, source: int, destination: int = GLOBAL) -> int:
    """Return the identifier of these parts; a group that is sent to all has no destination."""
    specific = 0 if is_to_all(group) else destination
    return priority << 26 | (group | specific) << 8 | source


def is_to_all(group: int) -> bool:
    """Return True if a parameter group is sent to all (PDU 2)."""
    return (group >> 8 & 0xFF) >= _TO_ALL


# The 64-bit NAME of a device (SAE J1939-81): who it is, and who yields when addresses clash.

NAME_BYTES: Final = 8


class Name(NamedTuple):
    """The NAME of a device: function, manufacturer, identity; the smaller one wins an address.

    Attributes:
        identity: serial number of the manufacturer, 21 bits.
        manufacturer: its code, 11 bits.
        ecu_instance: 3 bits.
        function_instance: 5 bits.
        function: what it does, 8 bits.
        vehicle_system: 7 bits.
        vehicle_system_instance: 4 bits.
        industry_group: 3 bits: 0 global, 2 agriculture, 3 construction, 5 industrial.
        arbitrary_address: whether it takes another address where its own is taken.
    """

    identity: int = 0
    manufacturer: int = 0
    ecu_instance: int = 0
    function_instance: int = 0
    function: int = 0
    vehicle_system: int = 0
    vehicle_system_instance: int = 0
    industry_group: int = 0
    arbitrary_address: bool = False

    def __int__(self) -> int:
        return (
            self.identity
            | self.manufacturer << 21
            | self.ecu_instance << 32
            | self.function_instance << 35
            | self.function << 40
            | self.vehicle_system << 49  # bit 48 is reserved and 0
            | self.vehicle_system_instance << 56
            | self.industry_group << 60
            | self.arbitrary_address << 63
        )

    def __bytes__(self) -> bytes:
        return int(self).to_bytes(NAME_BYTES, "little")
