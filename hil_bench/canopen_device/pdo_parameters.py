"""Communication and mapping parameters of one PDO, and the rules for writing them (CiA 301).

Identifier, inhibit time and mapping change only while the PDO is disabled (bit 31 of its COB-ID).
A new mapping is written with sub-index 0 at 0: first the entries, each checked by itself, then the
number of them, which checks the whole.
"""

from collections.abc import Callable
from typing import Any, Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.agenda import INHIBIT_UNIT, MILLISECOND
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.frame import BIT_30, DISABLED, can_id, check_change
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.pdo_mapping import Direction, MappingEntry, PdoMapping, find_refusal

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
