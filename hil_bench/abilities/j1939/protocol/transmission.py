"""Long messages, sent in packets."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from hil_bench.abilities.j1939.protocol.signals import GLOBAL, HIGHEST_GROUP
from hil_bench.canopen_device.agenda import MILLISECOND, NEVER

# Common parts of both ways of the transport protocol of SAE J1939-21: sizes, times, words.


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


class Line:
    """Sends the frames of connection management.

    Args:
        put: sends TP.CM.
    """

    def __init__(self, put: Put) -> None:
        self._put = put

    def control(self, destination: int, group: int, head: bytes) -> None:
        """Send a frame of connection management: its first five bytes, and the PGN."""
        self._put(destination, head + group.to_bytes(3, "little"))

    def refuse(self, partner: int, group: int, reason: AbortReason) -> None:
        """End a session, or refuse to begin one."""
        self.control(partner, group, bytes((Control.ABORT, reason, 0xFF, 0xFF, 0xFF)))


def fits(group: int, size: int, packets: int) -> bool:
    """Return True if an announcement is that of a possible message."""
    is_possible = LEAST_BYTES <= size <= MOST_BYTES and group <= HIGHEST_GROUP
    return is_possible and packets == -(-size // PACKET_BYTES)


# Long messages that a device sends (SAE J1939-21): by RTS and CTS to one, by BAM to all.


MOST_WAITING: Final = 16
"""Messages that wait for an earlier one to the same device."""


@dataclass(slots=True)
class _Outgoing:
    """A message on its way to one device or all.

    Attributes:
        group: its PGN.
        data: the message.
        packets: as frames carry them.
        deadline: when the other one must have answered, or the next packet to all is due [ns].
        following: number of the packet that is sent next.
        reached: the highest packet that was sent.
        repeats: how often packets were asked for again.
    """

    group: int
    data: bytes
    packets: list[bytes]
    deadline: int
    following: int = 1
    reached: int = 0
    repeats: int = 0


class Transmission:
    """The sessions in which one device sends.

    Args:
        line: announces and ends messages, and counts.
        put_data: sends TP.DT.

    Attributes:
        due: when `serve` has something to do [ns]; it may be earlier than need be.
    """

    def __init__(self, line: Line, put_data: Put) -> None:
        self.due = NEVER
        self._line, self._put_data = line, put_data
        self._outgoing: dict[int, _Outgoing] = {}
        self._waiting: deque[tuple[int, bytes, int]] = deque()

    def reset(self) -> None:
        """Forget all sessions, and what waits."""
        self._outgoing, self.due = {}, NEVER
        self._waiting.clear()

    def send(self, group: int, data: bytes, destination: int, now: int) -> bool:
        """Send a message of 9 to 1785 bytes; False where it has no room to wait in.

        Raises:
            ValueError: it has another length.
        """
        if not LEAST_BYTES <= len(data) <= MOST_BYTES:
            raise ValueError(f"{len(data)} bytes; {LEAST_BYTES} to {MOST_BYTES} can be transported")
        if destination in self._outgoing:
            if len(self._waiting) >= MOST_WAITING:
                return False
            self._waiting.append((group, data, destination))
            return True
        self._open(group, data, destination, now)
        return True

    def take_cts(self, source: int, group: int, data: bytes, now: int) -> None:
        """Take what a receiver asks for."""
        sent = self._outgoing.get(source)
        if sent is None or sent.group != group:
            return
        count, first = data[1], data[2]
        if not count:
            sent.deadline = self._wait(now + T4)
            return
        if not 0 < first <= sent.reached + 1 or first > len(sent.packets):
            self._fail(source, AbortReason.BAD_SEQUENCE, now)
            return
        if first <= sent.reached:
            sent.repeats += 1
            if sent.repeats > RETRANSMISSIONS:
                self._fail(source, AbortReason.RETRANSMISSIONS, now)
                return
        last = min(first + min(count, MOST_AT_ONCE) - 1, len(sent.packets))
        for packet in sent.packets[first - 1 : last]:
            self._put_data(source, packet)
        sent.reached = max(sent.reached, last)
        sent.deadline = self._wait(now + T3)

    def take_end(self, source: int, group: int, data: bytes, now: int) -> None:
        """Take the acknowledgement of a whole message."""
        sent = self._outgoing.get(source)
        if sent is None or sent.group != group:
            return
        is_whole = sent.reached == len(sent.packets) and data[1] | data[2] << 8 == len(sent.data)
        if not is_whole:
            self._fail(source, AbortReason.OTHER, now)
            return
        del self._outgoing[source]
        self._open_waiting(source, now)

    def end(self, destination: int, group: int, now: int) -> None:
        """End a session that its receiver has ended, if there is one."""
        sent = self._outgoing.get(destination)
        if sent is not None and sent.group == group:
            del self._outgoing[destination]
            self._open_waiting(destination, now)

    def serve(self, now: int) -> None:
        """End the sessions whose time is over, and send packets to all that are due."""
        if now < self.due:
            return
        for address in [each for each, sent in self._outgoing.items() if now >= sent.deadline]:
            if address == GLOBAL:
                self._send_to_all(self._outgoing[address], now)
            else:
                self._fail(address, AbortReason.TIMEOUT, now)
        self.due = min((each.deadline for each in self._outgoing.values()), default=NEVER)

    def _open(self, group: int, data: bytes, destination: int, now: int) -> None:
        chunks = [data[at : at + PACKET_BYTES] for at in range(0, len(data), PACKET_BYTES)]
        packets = [
            bytes((number,)) + chunk.ljust(PACKET_BYTES, b"\xff")
            for number, chunk in enumerate(chunks, 1)
        ]
        size, count = len(data).to_bytes(2, "little"), len(packets)
        wait = BAM_GAP if destination == GLOBAL else T3
        self._outgoing[destination] = _Outgoing(group, data, packets, self._wait(now + wait))
        if destination == GLOBAL:
            self._line.control(GLOBAL, group, bytes((Control.BAM, *size, count, 0xFF)))
        else:
            most = min(MOST_AT_ONCE, count)
            self._line.control(destination, group, bytes((Control.RTS, *size, count, most)))

    def _open_waiting(self, destination: int, now: int) -> None:
        """Begin the next message to a device, if one waits."""
        for place, (group, data, address) in enumerate(self._waiting):
            if address == destination:
                del self._waiting[place]
                self._open(group, data, destination, now)
                return

    def _send_to_all(self, sent: _Outgoing, now: int) -> None:
        self._put_data(GLOBAL, sent.packets[sent.following - 1])
        sent.following += 1
        sent.deadline = self._wait(now + BAM_GAP)
        if sent.following > len(sent.packets):
            del self._outgoing[GLOBAL]
            self._open_waiting(GLOBAL, now)

    def _fail(self, destination: int, reason: AbortReason, now: int) -> None:
        sent = self._outgoing.pop(destination)
        self._line.refuse(destination, sent.group, reason)
        self._open_waiting(destination, now)

    def _wait(self, deadline: int) -> int:
        self.due = min(self.due, deadline)
        return deadline
