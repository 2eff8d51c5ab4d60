"""Communication and mapping parameters of one PDO, and the rules for writing them (CiA 301).

Identifier, inhibit time and mapping change only while the PDO is disabled (bit 31 of its COB-ID).
A new mapping is written with sub-index 0 at 0: first the entries, each checked by itself, then the
number of them, which checks the whole.
"""

import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final, NamedTuple

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.abort_codes import AbortCode
from hil_bench.canopen_device.agenda import INHIBIT_UNIT, MILLISECOND
from hil_bench.canopen_device.datatypes import BOOLEAN, DATA_TYPES, DataType
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.frame import BIT_30, DISABLED, can_id, check_change
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable

# PDO mapping: which variables a process data object carries, bit by bit (CiA 301, PDO mapping).


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


COMMUNICATION_INDICES: Final = {
    Direction.RPDO: range(0x1400, 0x1600),
    Direction.TPDO: range(0x1800, 0x1A00),
}
_TO_MAPPING: Final = 0x200

SYNCHRONOUS_ACYCLIC: Final = 0
SYNCHRONOUS: Final = range(241)
SYNCHRONOUS_REMOTE: Final = 252
"""Sampled with each SYNC, sent on a remote request."""
EVENT_DRIVEN_REMOTE: Final = 253
"""Sampled and sent on a remote request."""
EVENT_DRIVEN: Final = range(254, 256)
_REMOTE: Final = frozenset({SYNCHRONOUS_REMOTE, EVENT_DRIVEN_REMOTE})

_COB_ID: Final = 1
_TRANSMISSION_TYPE: Final = 2
_INHIBIT_TIME: Final = 3
_EVENT_TIMER: Final = 5
_SYNC_START: Final = 6


class PdoParameters:
    """The objects 0x1400, 0x1600 (RPDO) or 0x1800, 0x1A00 (TPDO) and following of one PDO.

    Attributes:
        number: of the PDO, 1 to 512.
    """

    def __init__(
        self, object_dictionary: ObjectDictionary, index: int, direction: Direction
    ) -> None:
        self.number = index - COMMUNICATION_INDICES[direction].start + 1
        self._object_dictionary = object_dictionary
        self._index = index
        self._mapping_index = index + _TO_MAPPING
        self._direction = direction
        self._add_checks()

    @property
    def can_id(self) -> int | None:
        """The PDO's identifier, None while it is disabled."""
        return can_id(self._object_dictionary.number(self._index, _COB_ID, absent=DISABLED))

    @property
    def allows_remote(self) -> bool:
        """True if the TPDO answers remote requests: bit 30 of the COB-ID is clear."""
        return not self._object_dictionary.number(self._index, _COB_ID) & BIT_30

    @property
    def transmission_type(self) -> int:
        """0 to 240 synchronous, 252 and 253 on remote request, 254 and 255 event driven.

        Of a PDO that does not tell its type, 255.
        """
        number = self._object_dictionary.number
        return number(self._index, _TRANSMISSION_TYPE, absent=EVENT_DRIVEN[-1])

    @property
    def inhibit_time(self) -> int:
        """Shortest time between two transmissions [ns]."""
        return self._object_dictionary.number(self._index, _INHIBIT_TIME) * INHIBIT_UNIT

    @property
    def event_time(self) -> int:
        """TPDO: longest time between two transmissions, RPDO: time-out; 0 for none [ns]."""
        return self._object_dictionary.number(self._index, _EVENT_TIMER) * MILLISECOND

    @property
    def sync_start(self) -> int:
        """Counter of the SYNC that counts as the first; 0 where every SYNC does."""
        return self._object_dictionary.number(self._index, _SYNC_START)

    def mapping(self) -> PdoMapping | None:
        """Return the compiled mapping, None where nothing is mapped."""
        count = self._object_dictionary.number(self._mapping_index)
        return self._compile(count) if count else None

    def add_hook(self, hook: Callable[[Any], None]) -> None:
        """Tell `hook` whenever one of these parameters was written."""
        for variable in self._object_dictionary:
            if variable.index in {self._index, self._mapping_index}:
                variable.add_hook(hook)

    def _compile(self, count: int) -> PdoMapping:
        entries = [
            MappingEntry.parse(self._object_dictionary.variable(self._mapping_index, sub).value)
            for sub in range(1, count + 1)
        ]
        return PdoMapping(self._object_dictionary, entries, self._direction)

    def _add_checks(self) -> None:
        checks = {
            _COB_ID: self._check_cob_id,
            _TRANSMISSION_TYPE: self._check_transmission_type,
            _INHIBIT_TIME: self._check_disabled,
            _SYNC_START: self._check_disabled,
        }
        for subindex, check in checks.items():
            variable = self._object_dictionary.find(self._index, subindex)
            if variable is not None:
                variable.add_check(check)
        for variable in self._object_dictionary:
            if variable.index == self._mapping_index:
                variable.add_check(self._check_entry if variable.subindex else self._check_count)

    def _check_cob_id(self, cob_id: int) -> None:
        check_change(self._object_dictionary.variable(self._index, _COB_ID), cob_id)

    def _check_transmission_type(self, value: int) -> None:
        """Refuse 241 to 251, which are reserved, and for an RPDO 252 and 253.

        Raises:
            SdoAbort: 0609 0030.
        """
        is_remote = value in _REMOTE and self._direction is Direction.TPDO
        if value not in SYNCHRONOUS and value not in EVENT_DRIVEN and not is_remote:
            raise SdoAbort(*abort_codes.VALUE)

    def _check_disabled(self, _value: int) -> None:
        if self.can_id is not None:
            raise SdoAbort(*abort_codes.VALUE)

    def _check_mapping_access(self) -> None:
        if self.can_id is not None:
            raise SdoAbort(*abort_codes.UNSUPPORTED_ACCESS)

    def _check_entry(self, raw: int) -> None:
        self._check_mapping_access()
        if self._object_dictionary.number(self._mapping_index):
            raise SdoAbort(*abort_codes.UNSUPPORTED_ACCESS)
        if not raw:
            return
        entry = MappingEntry.parse(raw)
        refusal = find_refusal(self._object_dictionary, entry, self._direction)
        if refusal is not None:
            raise SdoAbort(*refusal.abort)

    def _check_count(self, count: int) -> None:
        self._check_mapping_access()
        if count and self._object_dictionary.find(self._mapping_index, count) is None:
            raise SdoAbort(*abort_codes.VALUE)
        self._compile(count)


# TPDOs with a rolling counter and a checksum, so that a receiver sees what went wrong before it.
#
# Behind the mapped bytes come a counter, 0 to 255 and round, and a CRC-8 of SAE J1850 (polynomial
# 0x1D, initial value 0xFF, inverted at the end) of the identifier (two bytes, the low one first),
# the mapped bytes and the counter. Six mapped bytes are the most. By the identifier a frame that
# was sent under another one does not pass; by the counter one that is repeated or lost shows.
#
# The scheme is that of end-to-end protection on vehicle buses; where the two bytes stand and that
# the identifier counts is this device's own. No device profile prescribes it.

MOST_BYTES: Final = 6
"""Mapped bytes of a protected TPDO."""

SEAL_BYTES: Final = 2
"""Counter and checksum."""

_POLYNOMIAL: Final = 0x1D
_MAPPING: Final = 0x1A00
_BITS_OF_A_BYTE: Final = 8


def _shift(value: int) -> int:
    for _ in range(_BITS_OF_A_BYTE):
        value = (value << 1 ^ (_POLYNOMIAL if value & 0x80 else 0)) & 0xFF
    return value


_TABLE: Final = bytes(_shift(value) for value in range(256))


def crc8(data: bytes) -> int:
    """Return the CRC-8 of SAE J1850."""
    crc = 0xFF
    for byte in data:
        crc = _TABLE[crc ^ byte]
    return crc ^ 0xFF


def checksum(can_id: int, data: bytes) -> int:
    """Return the checksum of mapped bytes and counter under an identifier."""
    return crc8(can_id.to_bytes(2, "little") + data)


class Seal:
    """The counter of one TPDO."""

    def __init__(self) -> None:
        self._counter = 0

    def close(self, can_id: int, data: bytes) -> bytes:
        """Return mapped bytes with counter and checksum behind them."""
        sealed = data + bytes((self._counter,))
        self._counter = (self._counter + 1) & 0xFF
        return sealed + bytes((checksum(can_id, sealed),))


def mapped_bytes(object_dictionary: ObjectDictionary, number: int) -> int:
    """Return the length of what TPDO `number` maps at present."""
    index = _MAPPING + number - 1
    count = object_dictionary.number(index)
    bits = sum(object_dictionary.number(index, sub) & 0xFF for sub in range(1, count + 1))
    return (bits + _BITS_OF_A_BYTE - 1) // _BITS_OF_A_BYTE


def limit_mapping(object_dictionary: ObjectDictionary, number: int) -> None:
    """Let TPDO `number` refuse (0604 0042) to map more than leaves room for the seal."""
    index = _MAPPING + number - 1

    def check(count: int) -> None:
        bits = sum(object_dictionary.number(index, sub) & 0xFF for sub in range(1, count + 1))
        if bits > MOST_BYTES * _BITS_OF_A_BYTE:
            raise SdoAbort(*abort_codes.PDO_LENGTH)

    count = object_dictionary.find(index)
    if count is not None:
        count.add_check(check)
