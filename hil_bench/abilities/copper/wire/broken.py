"""The end of a broken transmission: the stations that notice, and the time until the bus is free.

ISO 11898-1: who notices an error sends six bits, dominant ones where it is error-active. These
break the rule of stuffing, so that all others notice, and send six bits of their own. Eight
recessive bits end it, and the intermission follows.
"""

from collections.abc import Sequence
from enum import StrEnum
from typing import Final, NamedTuple

from hil_bench.outside.bits import ENDING, INTERMISSION

FLAG: Final = 6
"""Bits of an error flag."""

DELIMITER: Final = 8
"""Recessive bits after error flags."""

AFTER_FLAGS: Final = DELIMITER + INTERMISSION
"""Bits from the end of the error flags until the bus is free."""

ACK_SLOT: Final = 1
"""Place of the acknowledgement behind the CRC: the delimiter is before it."""


class ErrorKind(StrEnum):
    """The kind of an error on the bus."""

    BIT = "bit error"
    STUFF = "stuff error"
    ACK = "no acknowledge"
    DOMINANT = "stuck dominant"


class Broken(NamedTuple):
    """A transmission that failed.

    Attributes:
        kind: what was wrong.
        position: the disturbed bit, counted from the start of the frame, with stuff bits.
        length: bits from the start of the frame until the bus is free.
    """

    kind: ErrorKind
    position: int
    length: int


def disturbed(
    bits: Sequence[int], position: int, *, is_passive: bool, has_active_others: bool
) -> Broken:
    """Return the end of a transmission of which one bit is not on the bus as its sender meant it.

    Args:
        bits: those of the frame up to its CRC, with stuff bits.
        position: the bit that is wrong; it may be one of those behind the CRC.
        is_passive: whether the sender is error-passive.
        has_active_others: whether another station is error-active.
    """
    if position >= len(bits):  # a form error, which all see at once
        flags = FLAG
    else:
        level = 1 if is_passive else 0
        before = [*bits[:position], 1 - bits[position]]
        if _run(before, before[-1]) >= FLAG or not has_active_others:
            flags = FLAG
        else:
            flags = 2 * FLAG - _run(before, level)
    return Broken(ErrorKind.BIT, position, position + 1 + flags + AFTER_FLAGS)


def unacknowledged(bits: Sequence[int]) -> Broken:
    """Return the end of a transmission that nobody hears."""
    position = len(bits) + ACK_SLOT
    return Broken(ErrorKind.ACK, position, position + 1 + FLAG + AFTER_FLAGS)


def misread(bits: Sequence[int], position: int) -> Broken:
    """Return the end of a transmission that one error-active receiver alone takes for wrong.

    Its sender notices at the first recessive bit of its own, all others by the rule of stuffing.

    Args:
        bits: those of the frame up to its CRC, with stuff bits.
        position: the bit that the receiver takes for wrong.
    """
    position = min(position, len(bits) - 1)
    rest = [*bits[position + 1 :], 1]
    by_sender = rest.index(1) + 1 + FLAG
    by_others = 2 * FLAG - min(_run(bits[: position + 1], 0), FLAG)
    flags = max(by_sender, by_others)
    return Broken(ErrorKind.STUFF, position, position + 1 + flags + AFTER_FLAGS)


def length_on_bus(bits: Sequence[int]) -> int:
    """Return the bits in which a disturbance counts: all but the last of the end of frame."""
    return len(bits) + ENDING - 1


def _run(bits: Sequence[int], level: int) -> int:
    """Return the number of bits of a level at the end."""
    count = 0
    for bit in reversed(bits):
        if bit != level:
            break
        count += 1
    return count
