"""Checks of an object dictionary before its device goes on a bus (CiA 301, CiA 306)."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from hil_bench.canopen_device.datatypes import UNSIGNED8, UNSIGNED16, UNSIGNED32, DataType
from hil_bench.canopen_device.frame import DISABLED, can_id
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.pdo_parameters import PDO_BITS, Direction, MappingEntry, find_refusal


@dataclass(frozen=True, slots=True)
class Flaw:
    """A flaw of an object.

    Attributes:
        index: of the object.
        subindex: of the entry, None for the object as a whole.
        text: what is wrong, and what would be right.
    """

    index: int
    subindex: int | None
    text: str


_MANDATORY: Final = ((0x1000, 0), (0x1001, 0), (0x1018, 0), (0x1018, 1))

_VAR_TYPES: Final[dict[int, DataType]] = {
    **dict.fromkeys((0x1001, 0x100D, 0x1019, 0x1029), UNSIGNED8),
    **dict.fromkeys((0x100C, 0x1015, 0x1017), UNSIGNED16),
    **dict.fromkeys((0x1000, 0x1003, 0x1005, 0x1006, 0x1007, 0x1010, 0x1011), UNSIGNED32),
    **dict.fromkeys((0x1012, 0x1014, 0x1016, 0x1018, 0x1F80), UNSIGNED32),
}
"""Data types of the objects that the services read; of an array, that of its entries."""

_ARRAYS: Final = frozenset({0x1003, 0x1010, 0x1011, 0x1016, 0x1018, 0x1029})
_SDO_SERVERS: Final = range(0x1200, 0x1280)
_SDO_SERVER_TYPES: Final = (UNSIGNED8, UNSIGNED32, UNSIGNED32, UNSIGNED8)
_COMMUNICATION: Final = (range(0x1400, 0x1600), range(0x1800, 0x1A00))
_MAPPING: Final = (range(0x1600, 0x1800), range(0x1A00, 0x1C00))
_COMMUNICATION_TYPES: Final = (
    UNSIGNED8,
    UNSIGNED32,
    UNSIGNED8,
    UNSIGNED16,
    UNSIGNED8,
    UNSIGNED16,
    UNSIGNED8,
)


def find_faults(object_dictionary: ObjectDictionary) -> Iterator[Flaw]:
    """Yield what keeps a device with this object dictionary off the bus."""
    for index, subindex in _MANDATORY:
        if object_dictionary.find(index, subindex) is None:
            yield Flaw(index, subindex or None, "is missing; CiA 301 makes it mandatory")
    for variable in object_dictionary:
        data_type = required_type(variable.index, variable.subindex)
        if data_type is not None and variable.data_type is not data_type:
            text = f"has DataType {variable.data_type}; CiA 301 says {data_type}"
            yield Flaw(variable.index, variable.subindex, text)
    for direction, communication, mapping in zip(Direction, _COMMUNICATION, _MAPPING, strict=True):
        for index in object_dictionary.indices(communication):
            offset = mapping.start - communication.start
            yield from _pdo_faults(object_dictionary, index, index + offset, direction)


def required_type(index: int, subindex: int) -> DataType | None:
    """Return the data type of an entry that the services read, None for any other."""
    if any(index in indices for indices in _COMMUNICATION):
        return _among(_COMMUNICATION_TYPES, subindex)
    if index in _SDO_SERVERS:
        return _among(_SDO_SERVER_TYPES, subindex)
    is_mapping = any(index in indices for indices in _MAPPING)
    if subindex == 0 and (is_mapping or index in _ARRAYS):
        return UNSIGNED8
    return UNSIGNED32 if is_mapping else _VAR_TYPES.get(index)


def _among(data_types: tuple[DataType, ...], subindex: int) -> DataType | None:
    return data_types[subindex] if subindex < len(data_types) else None


def _pdo_faults(
    object_dictionary: ObjectDictionary, index: int, mapping: int, direction: Direction
) -> Iterator[Flaw]:
    """Yield what is wrong with a PDO; where it has no identifier and no mapping, nothing is."""
    if object_dictionary.find(mapping, 0) is None:
        if can_id(object_dictionary.number(index, 1, absent=DISABLED)) is not None:
            yield Flaw(mapping, 0, f"is missing; 0x{index:04X} needs its mapping there")
        return
    yield from find_mapping_faults(object_dictionary, mapping, direction)


def find_mapping_faults(
    object_dictionary: ObjectDictionary, mapping: int, direction: Direction
) -> Iterator[Flaw]:
    """Yield what is wrong with the mapping parameters at index `mapping`."""
    count = object_dictionary.number(mapping)
    bits = 0
    for subindex in range(1, count + 1):
        variable = object_dictionary.find(mapping, subindex)
        if variable is None:
            text = f"is missing; 0x{mapping:04X}.00 says {count} mapped objects"
            yield Flaw(mapping, subindex, text)
            continue
        entry = MappingEntry.parse(variable.value)
        bits += entry.bits
        refusal = find_refusal(object_dictionary, entry, direction)
        if refusal is not None:
            yield Flaw(mapping, subindex, f"maps {entry}, which {refusal.reason}")
    if bits > PDO_BITS:
        yield Flaw(mapping, None, f"maps {bits} bit; a PDO carries at most {PDO_BITS}")
