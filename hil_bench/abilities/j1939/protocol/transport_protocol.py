"""Common parts of both ways of the transport protocol of SAE J1939-21: sizes, times, words."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final

from hil_bench.abilities.j1939.protocol.identifier import HIGHEST_GROUP
from hil_bench.canopen_device.agenda import MILLISECOND

LEAST_BYTES: Final = 9
MOST_BYTES: Final = 1785
PACKET_BYTES: Final = 7
MOST_AT_ONCE: Final = 16
"""Packets that a receiver may ask for with one CTS, and that this one asks for."""
RETRANSMISSIONS: Final = 2
"""How often packets may be asked for again."""

T1: Final = 750 * MILLISECOND
"""Between two packets, of the receiver [ns]."""
T2: Final = 1250 * MILLISECOND
"""From CTS to the first packet, of the receiver [ns]."""
T3: Final = 1250 * MILLISECOND
"""From the last packet to CTS or end of message, of the sender [ns]."""
T4: Final = 1050 * MILLISECOND
"""From a CTS that says wait to the next CTS, of the sender [ns]."""
BAM_GAP: Final = 50 * MILLISECOND
"""Between two packets to all [ns]."""

Put = Callable[[int, bytes], None]
"""Sends eight bytes to an address."""


class Control(IntEnum):
    """First byte of a connection management message."""

    RTS = 16
    CTS = 17
    END = 19
    BAM = 32
    ABORT = 255


class AbortReason(IntEnum):
    """Why a session was ended."""

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


@dataclass(slots=True)
class TransportCounters:
    """The counters of transport sessions.

    Attributes:
        received: whole messages.
        sent: messages that arrived, or were sent to all.
        aborted: sessions that this device ended, by the reason.
        ended: sessions that the other device ended, by its reason.
        lost: messages to all that stayed incomplete.
        ignored: frames that belong to no session or say nothing.
    """

    received: int = 0
    sent: int = 0
    aborted: Counter[int] = field(default_factory=Counter)
    ended: Counter[int] = field(default_factory=Counter)
    lost: int = 0
    ignored: int = 0


class Line:
    """Sends the frames of connection management, and counts what happens to sessions.

    Args:
        put: sends TP.CM.

    Attributes:
        counters: what has happened so far.
    """

    def __init__(self, put: Put) -> None:
        self.counters = TransportCounters()
        self._put = put

    def control(self, destination: int, group: int, head: bytes) -> None:
        """Send a frame of connection management: its first five bytes, and the PGN."""
        self._put(destination, head + group.to_bytes(3, "little"))

    def refuse(self, partner: int, group: int, reason: AbortReason) -> None:
        """End a session, or refuse to begin one."""
        self.counters.aborted[reason] += 1
        self.control(partner, group, bytes((Control.ABORT, reason, 0xFF, 0xFF, 0xFF)))


def fits(group: int, size: int, packets: int) -> bool:
    """Return True if an announcement is that of a possible message."""
    is_possible = LEAST_BYTES <= size <= MOST_BYTES and group <= HIGHEST_GROUP
    return is_possible and packets == -(-size // PACKET_BYTES)
