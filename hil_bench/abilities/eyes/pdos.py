"""The PDOs of a node as its object dictionary has them now, and what a frame of one carries."""

import struct
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field

from hil_bench.abilities.eyes.values import Reader, Reading, Scale, number_in
from hil_bench.canopen_device.datatypes import BOOLEAN, DataType
from hil_bench.canopen_device.frame import DISABLED, can_id
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.pdo_parameters import (
    BITS_OF_A_BYTE,
    COMMUNICATION_INDICES,
    SEAL_BYTES,
    Direction,
    MappingEntry,
    checksum,
)

_TO_MAPPING = 0x200
_LARGEST_DUMMY = 7
_MOST_ENTRIES = 64
_MULTIPLEXED = frozenset({0xFE, 0xFF})
"""Sub-index 0 of the mapping of an MPDO, with source and with destination addressing."""
_MPDO_BITS = 64


@dataclass(frozen=True, slots=True)
class PdoField:
    """One object in a PDO.

    Attributes:
        reader: of the object.
        shift: its first bit in the PDO.
        bits: its length.
        problem: why the mapping does not go with the EDS; empty where it does.
    """

    reader: Reader
    shift: int
    bits: int
    problem: str = ""


@dataclass(slots=True)
class Pdo:
    """One PDO that exists.

    Attributes:
        direction: as the device sees it.
        number: 1 to 512.
        can_id: its identifier.
        transmission_type: 0 to 240 synchronous, 252 and 253 on remote request, 254 and 255 on
            event.
        event_time_ms: TPDO: longest time between two, RPDO: time-out; 0 for none [ms].
        inhibit_time_100us: shortest time between two [100 us].
        fields: what it carries, in order.
        bits: of its mapping; None where the mapping is unknown.
        is_protected: whether counter and checksum stand behind what it maps; None where nobody
            says so, and a frame with a right checksum shows it.
        is_multiplexed: whether each frame names the object that it carries (MPDO).
    """

    direction: Direction
    number: int
    can_id: int
    transmission_type: int
    event_time_ms: int
    inhibit_time_100us: int
    fields: tuple[PdoField, ...]
    bits: int | None
    is_protected: bool | None = None
    is_multiplexed: bool = False
    _struct: struct.Struct | None = None
    _last: bytes | None = None
    _readings: tuple[Reading, ...] = field(default=())

    @property
    def name(self) -> str:
        """As in ``TPDO1``."""
        return f"{self.direction.value}{self.number}"

    @property
    def length(self) -> int | None:
        """Bytes of its mapping; None where the mapping is unknown."""
        return None if self.bits is None else (self.bits + 7) // 8

    def read(self, data: bytes) -> tuple[Reading, ...]:
        """Return the values of a frame; nothing where it is too short or the mapping unknown."""
        if data == self._last:
            return self._readings
        if self.bits is None or len(data) < (self.length or 0):
            return ()
        if self._struct is not None:
            values = self._struct.unpack_from(data)
            readings = tuple(
                [each.reader.tell(value) for each, value in zip(self.fields, values, strict=True)]
            )
        else:
            word = int.from_bytes(data, "little")
            readings = tuple(each.reader.read(_cut(word, each)) for each in self.fields)
        self._last, self._readings = data, readings
        return readings

    def problem(self, data: bytes) -> str:
        """Return the fault of a frame's length or checksum; empty where there is no fault."""
        length = self.length
        if length is None:
            return ""
        if self.is_sealed(data):
            right = checksum(self.can_id, data[:-1])
            if data[-1] == right:
                return ""
            return f"checksum 0x{data[-1]:02X}, and 0x{right:02X} is right"
        if self.is_protected:
            return f"{len(data)} bytes, and its mapping with counter and checksum has {length + 2}"
        return "" if len(data) == length else f"{len(data)} bytes, and its mapping has {length}"

    def is_sealed(self, data: bytes) -> bool:
        """Return True if a frame has counter and checksum behind the objects that the PDO maps."""
        if self.direction is not Direction.TPDO or len(data) != (self.length or 0) + SEAL_BYTES:
            return False
        if self.is_protected is None:
            return data[-1] == checksum(self.can_id, data[:-1])
        return self.is_protected


def find_pdos(
    objects: ObjectDictionary,
    scales: Mapping[tuple[int, int], Scale],
    protected_tpdos: Collection[int] | None = None,
) -> Iterator[Pdo]:
    """Yield the PDOs that exist now.

    Args:
        objects: of the node.
        scales: what the numbers of bound objects stand for.
        protected_tpdos: numbers of the TPDOs that have a counter and a checksum; None for not
            known.
    """
    for direction, indices in COMMUNICATION_INDICES.items():
        for index in objects.indices(indices):
            identifier = can_id(number_in(objects, index, 1, DISABLED))
            if identifier is not None:
                pdo = _read_pdo(objects, scales, index, direction, identifier)
                if protected_tpdos is not None and direction is Direction.TPDO:
                    pdo.is_protected = pdo.number in protected_tpdos
                yield pdo


def _read_pdo(
    objects: ObjectDictionary,
    scales: Mapping[tuple[int, int], Scale],
    index: int,
    direction: Direction,
    identifier: int,
) -> Pdo:
    fields, bits = _read_mapping(objects, scales, index + _TO_MAPPING)
    is_multiplexed = number_in(objects, index + _TO_MAPPING, 0, 0) in _MULTIPLEXED
    return Pdo(
        direction,
        index - COMMUNICATION_INDICES[direction].start + 1,
        identifier,
        number_in(objects, index, 2, 255),
        number_in(objects, index, 5, 0),
        number_in(objects, index, 3, 0),
        fields,
        bits,
        is_multiplexed=is_multiplexed,
        _struct=_compile(fields, bits),
    )


def _read_mapping(
    objects: ObjectDictionary, scales: Mapping[tuple[int, int], Scale], index: int
) -> tuple[tuple[PdoField, ...], int | None]:
    """Return the mapped fields and their bits; None for the bits of an unknown mapping."""
    if objects.find(index, 0) is None:
        return (), None
    fields, shift, count = [], 0, number_in(objects, index, 0, 0)
    if count in _MULTIPLEXED:
        return (), _MPDO_BITS
    for subindex in range(1, min(count, _MOST_ENTRIES) + 1):
        entry = MappingEntry.parse(number_in(objects, index, subindex, 0))
        if entry.index > _LARGEST_DUMMY:
            reader = Reader(objects, entry.index, entry.subindex, scales)
            problem = _why_not(reader.data_type, entry)
            if problem:
                reader.data_type = None
            fields.append(PdoField(reader, shift, entry.bits, problem))
        shift += entry.bits
    return tuple(fields), shift


def _why_not(data_type: DataType | None, entry: MappingEntry) -> str:
    if data_type is None or data_type.bits == entry.bits:
        return ""
    if data_type is BOOLEAN and entry.bits == BITS_OF_A_BYTE:
        return ""
    return f"{entry} is {data_type.name} in the EDS"


def _cut(word: int, each: PdoField) -> bytes:
    raw = word >> each.shift & (1 << each.bits) - 1
    data_type = each.reader.data_type
    size = (each.bits + 7) // 8 if data_type is None else data_type.size
    return raw.to_bytes(size, "little")


def _compile(fields: tuple[PdoField, ...], bits: int | None) -> struct.Struct | None:
    """Return the `struct` of a PDO without gaps whose types all have a letter there."""
    letters = []
    for each in fields:
        data_type = each.reader.data_type
        if data_type is None or not data_type.format:
            return None
        letters.append(data_type.format)
    return struct.Struct("<" + "".join(letters)) if sum(f.bits for f in fields) == bits else None
