"""PDO mapping: which variables a process data object carries, bit by bit (CiA 301, PDO mapping)."""

import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final, NamedTuple

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.abort_codes import AbortCode
from hil_bench.canopen_device.datatypes import BOOLEAN, DATA_TYPES, DataType
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable

PDO_BITS: Final = 64
BITS_OF_A_BYTE: Final = 8
"""Length of a BOOLEAN in a PDO of a device whose mapping has the granularity of a byte."""
_DUMMIES: Final = range(0x0001, 0x0008)


class Direction(Enum):
    """The direction of a PDO, as the device sees it."""

    RPDO = "RPDO"
    TPDO = "TPDO"


@dataclass(frozen=True, slots=True)
class MappingEntry:
    """One mapped object: what a mapping parameter's sub-index 1 to 64 holds."""

    index: int
    subindex: int
    bits: int

    @classmethod
    def parse(cls, raw: int) -> "MappingEntry":
        """Return the entry of an UNSIGNED32 0xIIIISSLL: index, sub-index, length [bit]."""
        return cls(raw >> 16, raw >> 8 & 0xFF, raw & 0xFF)

    def __str__(self) -> str:
        return f"0x{self.index:04X}.{self.subindex:02X} ({self.bits} bit)"


class Refusal(NamedTuple):
    """Why an object cannot be mapped: the abort code for the bus, and a line for people."""

    abort: AbortCode
    reason: str


def find_refusal(
    object_dictionary: ObjectDictionary, entry: MappingEntry, direction: Direction
) -> Refusal | None:
    """Return why `entry` cannot be mapped into a PDO of that direction, None where it can."""
    dummy = _dummy_type(entry)
    if dummy is not None:
        if direction is Direction.TPDO:
            return Refusal(abort_codes.NOT_MAPPABLE, "is a dummy, which only an RPDO may carry")
        return _length_refusal(entry, dummy)
    variable = object_dictionary.find(entry.index, entry.subindex)
    if variable is None:
        missing = abort_codes.NO_SUBINDEX
        if entry.index not in object_dictionary:
            missing = abort_codes.NO_OBJECT
        return Refusal(missing, "does not exist")
    if not variable.is_carried and (reason := reason_not_to_carry(variable, direction)):
        return Refusal(abort_codes.NOT_MAPPABLE, reason)
    return _length_refusal(entry, variable.data_type)


def reason_not_to_carry(variable: Variable, direction: Direction) -> str | None:
    """Return why the EDS lets no PDO of that direction carry `variable`, None where it does."""
    if not variable.mappable:
        return "has PDOMapping=0"
    access = variable.access
    if access.in_rpdo if direction is Direction.RPDO else access.in_tpdo:
        return None
    return f"has AccessType={access.value}, which no {direction.value} may carry"


def _dummy_type(entry: MappingEntry) -> DataType | None:
    """The data type of a dummy entry (CiA 301, dummy mapping): its index is the type's code."""
    if entry.index in _DUMMIES and entry.subindex == 0:
        return DATA_TYPES[entry.index]
    return None


def _length_refusal(entry: MappingEntry, data_type: DataType) -> Refusal | None:
    if data_type.bits and entry.bits == data_type.bits:
        return None
    if data_type is BOOLEAN and entry.bits == BITS_OF_A_BYTE:
        return None
    length = f"{data_type.bits} bit" if data_type.bits else "no fixed length"
    return Refusal(abort_codes.NOT_MAPPABLE, f"is {data_type.name}, which has {length}")


class _Field(NamedTuple):
    """The position of a variable in the PDO, read as one little-endian integer."""

    variable: Variable
    shift: int
    mask: int


class PdoMapping:
    """A checked mapping, ready to move values between a PDO and the object dictionary.

    Byte-aligned entries of standard types go through one precompiled `struct`; all others
    (BOOLEAN, 24 bit and the like) through shifts and masks.

    Attributes:
        length: of the PDO [byte].
        variables: mapped variables in order, dummies left out.
    """

    __slots__ = ("_fields", "_pack", "_unpack", "length", "variables")

    def __init__(
        self,
        object_dictionary: ObjectDictionary,
        entries: Sequence[MappingEntry],
        direction: Direction,
    ) -> None:
        """Check and compile.

        Raises:
            SdoAbort: an entry cannot be mapped (0602 0000, 0609 0011, 0604 0041), or the sum of
                lengths is over 64 bit (0604 0042).
        """
        for entry in entries:
            refusal = find_refusal(object_dictionary, entry, direction)
            if refusal is not None:
                raise SdoAbort(*refusal.abort)
        bits = sum(entry.bits for entry in entries)
        if bits > PDO_BITS:
            raise SdoAbort(*abort_codes.PDO_LENGTH)
        self.length = (bits + 7) // 8
        self._fields = tuple(_place(object_dictionary, entries))
        self.variables = tuple(field.variable for field in self._fields)
        packed = _compile(object_dictionary, entries)
        self._pack: Callable[..., bytes] | None = None if packed is None else packed.pack
        self._unpack: Callable[[bytes], tuple[Any, ...]] | None = (
            None if packed is None else packed.unpack_from
        )

    def read(self) -> bytes:
        """Return the PDO's bytes from the variables' present values."""
        pack = self._pack
        if pack is None:
            return self._read_bits()
        variables = self.variables
        if len(variables) == 2:  # as most have; the general call costs three times as much
            return pack(variables[0].value, variables[1].value)
        return pack(*[variable.value for variable in variables])

    def write(self, data: bytes) -> int:
        """Set the variables from at least `length` bytes.

        Returns:
            How many values the variables refused (limits, checks); a refused value leaves the old
            one in place.
        """
        unpack = self._unpack
        if unpack is None:
            return self._write_bits(data)
        refused = 0
        for number, value in enumerate(unpack(data)):
            variable = self.variables[number]
            if variable.is_plain:
                variable.value = value
                continue
            try:
                variable.write(value)
            except SdoAbort:
                refused += 1
        return refused

    def _read_bits(self) -> bytes:
        word = 0
        for variable, shift, mask in self._fields:
            raw = int.from_bytes(variable.data_type.encode(variable.value), "little")
            word |= (raw & mask) << shift
        return word.to_bytes(self.length, "little")

    def _write_bits(self, data: bytes) -> int:
        word = int.from_bytes(data, "little")
        refused = 0
        for variable, shift, mask in self._fields:
            data_type = variable.data_type
            raw = (word >> shift & mask).to_bytes(data_type.size, "little")
            refused += _is_refused(variable, data_type.decode(raw))
        return refused


def _is_refused(variable: Variable, value: Any) -> bool:  # noqa: ANN401 - of any data type
    try:
        variable.write(value)
    except SdoAbort:
        return True
    return False


def _place(
    object_dictionary: ObjectDictionary, entries: Iterable[MappingEntry]
) -> Iterable[_Field]:
    shift = 0
    for entry in entries:
        if _dummy_type(entry) is None:
            variable = object_dictionary.variable(entry.index, entry.subindex)
            yield _Field(variable, shift, (1 << entry.bits) - 1)
        shift += entry.bits


def _compile(
    object_dictionary: ObjectDictionary, entries: Iterable[MappingEntry]
) -> struct.Struct | None:
    """The `struct` of the whole PDO, None where an entry has no letter there (24 bit, dummy)."""
    letters = []
    for entry in entries:
        variable = object_dictionary.find(entry.index, entry.subindex)
        if variable is None or not variable.data_type.format:
            return None
        letters.append(variable.data_type.format)
    return struct.Struct("<" + "".join(letters))
