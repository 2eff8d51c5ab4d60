"""Common parts of both ends of a long message (SAE J1939-21): sizes, times, control frames."""

from enum import IntEnum
from typing import Final

LEAST_BYTES: Final = 9
MOST_BYTES: Final = 1785
PACKET_BYTES: Final = 7

MOST_AT_ONCE: Final = 16
"""Packets for one CTS, asked for and offered."""

T1: Final = 0.75
"""Longest time between two packets, of the receiver [s]."""
T2: Final = 1.25
"""Longest time from a CTS to its first packet, of the receiver [s]."""
T3: Final = 1.25
"""Longest time from RTS or last packet to the answer, of the sender [s]."""
T4: Final = 1.05
"""Longest time from a CTS that says wait to the next one, of the sender [s]."""
BAM_GAP: Final = 0.05
"""Time between two packets to all [s]."""


class Control(IntEnum):
    """First byte of a frame of connection management."""

    RTS = 16
    CTS = 17
    END = 19
    BAM = 32
    ABORT = 255


class AbortReason(IntEnum):
    """Why a message is ended before its end."""

    BUSY = 1
    RESOURCES = 2
    TIMEOUT = 3
    CTS_WHILE_SENDING = 4
    RETRANSMISSIONS = 5
    UNEXPECTED_DATA = 6
    BAD_SEQUENCE = 7
    DUPLICATE = 8
    TOO_LONG = 9
    OTHER = 250


def packets_of(size: int) -> int:
    """Return the number of packets of a message of `size` bytes."""
    return -(-size // PACKET_BYTES)


def connection(control: Control, head: bytes, group: int) -> bytes:
    """Return a frame of connection management: four bytes after the control byte, and the PGN."""
    return bytes((control,)) + head + group.to_bytes(3, "little")


def abort(reason: AbortReason, group: int) -> bytes:
    """Return the frame that ends a message."""
    return connection(Control.ABORT, bytes((reason, 0xFF, 0xFF, 0xFF)), group)
