"""TPDOs with a rolling counter and a checksum, so that a receiver sees what went wrong before it.

Behind the mapped bytes come a counter, 0 to 255 and round, and a CRC-8 of SAE J1850 (polynomial
0x1D, initial value 0xFF, inverted at the end) of the identifier (two bytes, the low one first),
the mapped bytes and the counter. Six mapped bytes are the most. By the identifier a frame that was
sent under another one does not pass; by the counter one that is repeated or lost shows.

The scheme is that of end-to-end protection on vehicle buses; where the two bytes stand and that
the identifier counts is this device's own. No device profile prescribes it.
"""

from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.object_dictionary import ObjectDictionary

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
