"""Mapping of objects into PDOs by the EDS, and decoding of their bytes.

A received PDO is kept as it came, with its time of reception, and decoded only where a value is
asked for: a controller reads few of the values that a bus brings.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple, Self

from canopen.objectdictionary import ODVariable, datatypes

from hil_drivers.errors import DeviceMismatchError
from hil_drivers.node import Node, object_name

if TYPE_CHECKING:
    from hil_drivers.protection import Protection

INVALID = 1 << 31
"""Bit of a PDO's COB-ID entry that says: this PDO does not exist."""

EXTENDED = 1 << 29


class PdoKind(Enum):
    """RPDO and TPDO as the device sees them: first communication and first mapping index."""

    RPDO = (0x1400, 0x1600)
    TPDO = (0x1800, 0x1A00)


ObjectKey = tuple[int, int]
"""Index and sub-index of an object."""


class MappedObject(NamedTuple):
    """One entry of a PDO mapping: which object, and its length [bit]."""

    key: ObjectKey
    bits: int

    @classmethod
    def from_entry(cls, entry: int) -> Self:
        """Return the mapped object of a mapping entry, such as 0x60410010."""
        return cls((entry >> 16, entry >> 8 & 0xFF), entry & 0xFF)

    def __str__(self) -> str:
        return f"{object_name(*self.key)} ({self.bits} bit)"


@dataclass(frozen=True, slots=True)
class PdoMapping:
    """One PDO of a device.

    Attributes:
        kind: RPDO or TPDO.
        number: counted from 1.
        cob_id: its COB-ID entry, with the bits that say whether the PDO exists.
        objects: what it carries, in order.
    """

    kind: PdoKind
    number: int
    cob_id: int
    objects: tuple[MappedObject, ...]

    def __str__(self) -> str:
        return f"{self.kind.name}{self.number}"

    @property
    def communication_index(self) -> int:
        """Index of its communication parameter."""
        return self.kind.value[0] + self.number - 1

    @property
    def mapping_index(self) -> int:
        """Index of its mapping parameter."""
        return self.kind.value[1] + self.number - 1

    @property
    def length(self) -> int:
        """Its length [byte]."""
        return (sum(mapped.bits for mapped in self.objects) + 7) // 8

    def __contains__(self, key: ObjectKey) -> bool:
        return any(mapped.key == key for mapped in self.objects)


class Signal:
    """One object inside the bytes of a PDO.

    Attributes:
        key: which object.
        start: its first byte.
        end: the byte after its last.
        is_real: it is a real number, not an integer.
        lowest: the least value of its type, NaN for a real number.

    Raises:
        DeviceMismatchError: it is no number, not as long as its type, or not on a byte boundary.
    """

    def __init__(self, mapping: PdoMapping, key: ObjectKey, variable: ODVariable) -> None:
        place = [mapped.key for mapped in mapping.objects].index(key)
        start = sum(mapped.bits for mapped in mapping.objects[:place])
        bits = mapping.objects[place].bits
        if variable.data_type not in datatypes.NUMBER_TYPES or bits != len(variable) or start % 8:
            raise DeviceMismatchError(
                f"{mapping} maps {bits} bit of {object_name(*key)} ({variable.qualname}) at bit "
                f"{start}; "
                f"a number of {len(variable)} bit on a byte boundary is right by the EDS"
            )
        self.key = key
        self.start = start // 8
        self.end = self.start + bits // 8
        self.is_real = variable.data_type in datatypes.FLOAT_TYPES
        signed = variable.data_type in datatypes.SIGNED_TYPES
        self.lowest = math.nan if self.is_real else -(1 << bits - 1) if signed else 0
        self._codec = ODVariable.STRUCT_TYPES[variable.data_type]

    def decode(self, data: bytes) -> int | float:
        """Return the object's value."""
        value: int | float = self._codec.unpack(data[self.start : self.end])[0]
        return value

    def encode(self, data: bytearray, value: float) -> None:
        """Put the object's value into a PDO."""
        data[self.start : self.end] = self._codec.pack(value)


class ReceivedPdo:
    """The last TPDO that came from a device.

    Attributes:
        mapping: which one, and what it carries.
        cob_id: CAN identifier; that of the EDS until the device has been asked.
        data: its bytes.
        received_at: when it came, on the network's clock [s].
        protection: the check of its counter and checksum; None where it has none.
    """

    __slots__ = ("_length", "cob_id", "data", "mapping", "protection", "received_at")

    def __init__(self, mapping: PdoMapping) -> None:
        self.mapping = mapping
        self.cob_id = mapping.cob_id & 0x7FF
        self.data = b""
        self.received_at = -float("inf")
        self.protection: Protection | None = None
        self._length = mapping.length

    def receive(self, data: bytes, now: float) -> bool:
        """Take a frame; False refuses one of another length than the mapping's.

        What the protection refuses changes nothing, so that the value grows old.
        """
        if self.protection is not None:
            opened = self.protection.open(data)
            if opened is None:
                return True
            data = opened
        if len(data) != self._length:
            return False
        self.data = data
        self.received_at = now
        return True


class SentPdo:
    """An RPDO that is sent to a device.

    Attributes:
        mapping: which one, and what it carries.
        cob_id: CAN identifier.
        data: its bytes.
    """

    __slots__ = ("cob_id", "data", "mapping")

    def __init__(self, mapping: PdoMapping) -> None:
        self.mapping = mapping
        self.cob_id = mapping.cob_id & 0x7FF
        self.data = bytearray(mapping.length)


def eds_mappings(node: Node, kind: PdoKind) -> list[PdoMapping]:
    """Return the PDOs that a node's EDS describes."""
    communication, mapping = kind.value
    return [
        PdoMapping(
            kind,
            number,
            # A PDO whose EDS gives no COB-ID does not exist until one is set (CiA 301).
            node.default(communication + number - 1, 1, otherwise=INVALID),
            tuple(
                MappedObject.from_entry(node.default(mapping + number - 1, place, otherwise=0))
                for place in range(1, node.default(mapping + number - 1, otherwise=0) + 1)
            ),
        )
        for number in range(1, 513)
        if communication + number - 1 in node.object_dictionary
    ]


def choose_carriers(
    mappings: Sequence[PdoMapping], keys: Sequence[ObjectKey]
) -> dict[ObjectKey, PdoMapping]:
    """Return for each object the PDO to use for it; objects that none carries are left out.

    One PDO with all of them comes before several, one that exists before one to be enabled.
    """
    ranked = sorted(
        mappings,
        key=lambda mapping: (-sum(key in mapping for key in keys), mapping.cob_id & INVALID != 0),
    )
    return {
        key: next(mapping for mapping in ranked if key in mapping)
        for key in keys
        if any(key in mapping for mapping in ranked)
    }


def verify_mapping(node: Node, mapping: PdoMapping) -> None:
    """Compare a PDO mapping of the EDS with what the device holds.

    Raises:
        DeviceMismatchError: they differ.
    """
    index = mapping.mapping_index
    count = node.read_integer(index)
    if count != len(mapping.objects):
        raise DeviceMismatchError(
            f"{node}: {object_name(index)}.00 ({mapping}) maps {count} objects; "
            f"{len(mapping.objects)} are right by {node.eds}"
        )
    for place, expected in enumerate(mapping.objects, 1):
        found = MappedObject.from_entry(node.read_integer(index, place))
        if found != expected:
            raise DeviceMismatchError(
                f"{node}: {object_name(index, place)} ({mapping}) maps {found}; "
                f"{expected} is right by {node.eds}"
            )


def configure_pdo(
    node: Node, mapping: PdoMapping, *, transmission_type: int | None, event_timer: float
) -> int:
    """Return the CAN identifier of a PDO after setting how it is sent; write only what differs.

    Follows CiA 301's order: the PDO is disabled, changed and enabled again.

    Args:
        node: the device.
        mapping: the PDO.
        transmission_type: 0 to 240 with SYNC, 254 or 255 by event; None leaves it as it is.
        event_timer: longest time between two TPDOs, or receive time-out of an RPDO [s]; 0 is none.

    Raises:
        DeviceMismatchError: the PDO has a 29-bit identifier or none, or no event timer.
    """
    index = mapping.communication_index
    cob_id = node.read_integer(index, 1)
    if cob_id & EXTENDED or not cob_id & 0x7FF:
        raise DeviceMismatchError(
            f"{node}: {object_name(index, 1)} ({mapping}) is 0x{cob_id:08X}; "
            "an 11-bit CAN identifier is right"
        )
    changes = _changes(node, index, transmission_type, round(event_timer * 1000))
    if changes:
        node.write(index, 1, cob_id | INVALID)
        for subindex, value in changes.items():
            node.write(index, subindex, value)
    if changes or cob_id & INVALID:
        node.write(index, 1, cob_id & ~INVALID)
    return cob_id & 0x7FF


def _changes(
    node: Node, index: int, transmission_type: int | None, event_timer_ms: int
) -> dict[int, int]:
    """Return the sub-indices to write and their values."""
    wanted = {} if transmission_type is None else {2: transmission_type}
    if event_timer_ms or node.has(index, 5):
        wanted[5] = event_timer_ms
    return {
        subindex: value
        for subindex, value in wanted.items()
        if node.read_integer(index, subindex) != value
    }
