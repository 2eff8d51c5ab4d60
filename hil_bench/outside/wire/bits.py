"""How long a frame is on the bus, to the bit (ISO 11898-1).

A classical frame has a start bit, the identifier with its control bits, the data and a CRC of 15
bits; after five equal bits of these comes one of the other value. Ten bits end the frame without
stuffing, and three stand between two frames.
"""

from functools import lru_cache
from typing import Final

from hil_bench.canopen_device.frame import Frame

INTERMISSION: Final = 3
"""Bits between two frames."""

_ENDING: Final = 10
"""CRC delimiter, acknowledgement with its delimiter, end of frame."""

_CRC_BITS: Final = 15
_POLYNOMIAL: Final = 0x4599
_CRC_MASK: Final = 0x7FFF
_STUFFED_AFTER: Final = 5
_HEAD: Final = 34
_EXTENDED_HEAD: Final = 54
_KEPT: Final = 8192


def worst_bits(length: int, *, is_extended: bool = False) -> int:
    """Return the bits of a data frame with the most stuff bits, and of the intermission after it.

    Of the bits that are stuffed, at most one follows each four but the first (Davis, Burns, Bril
    and Lukkien 2007, equation 1).

    Args:
        length: data bytes.
        is_extended: whether the identifier has 29 bits.
    """
    stuffed = (_EXTENDED_HEAD if is_extended else _HEAD) + 8 * length
    return stuffed + _ENDING + INTERMISSION + (stuffed - 1) // 4


def exact_bits(frame: Frame) -> int:
    """Return the bits of a frame with its stuff bits, and of the intermission after it."""
    return _count(frame.can_id, frame.data, frame.is_remote, frame.is_extended)


@lru_cache(maxsize=_KEPT)
def _count(can_id: int, data: bytes, is_remote: bool, is_extended: bool) -> int:
    word, length = _unstuffed(can_id, data, is_remote=is_remote, is_extended=is_extended)
    word, length = word << _CRC_BITS | _crc(word, length), length + _CRC_BITS
    return length + _stuff_bits(word, length) + _ENDING + INTERMISSION


def _unstuffed(can_id: int, data: bytes, *, is_remote: bool, is_extended: bool) -> tuple[int, int]:
    """Return start bit to data as one number, and how many bits it has."""
    if is_extended:  # 11 bits, SRR and IDE recessive, 18 bits, RTR, two reserved bits
        word = (can_id >> 18) << 2 | 0b11
        word = ((word << 18 | can_id & 0x3FFFF) << 1 | is_remote) << 2
        length = 35
    else:  # 11 bits, RTR, IDE and a reserved bit dominant
        word, length = (can_id << 1 | is_remote) << 2, 15
    word, length = word << 4 | len(data), length + 4
    return word << 8 * len(data) | int.from_bytes(data, "big"), length + 8 * len(data)


def _crc(word: int, length: int) -> int:
    crc = 0
    for place in range(length - 1, -1, -1):
        is_odd = (crc >> 14 ^ word >> place) & 1
        crc = crc << 1 & _CRC_MASK
        if is_odd:
            crc ^= _POLYNOMIAL
    return crc


def _stuff_bits(word: int, length: int) -> int:
    stuffed, last, run = 0, -1, 0
    for place in range(length - 1, -1, -1):
        bit = word >> place & 1
        run = run + 1 if bit == last else 1
        last = bit
        if run == _STUFFED_AFTER:  # the stuff bit begins the next run
            stuffed, last, run = stuffed + 1, 1 - bit, 1
    return stuffed
