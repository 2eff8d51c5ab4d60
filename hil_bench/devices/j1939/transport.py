"""The transport protocol of SAE J1939-21: 9 to 1785 bytes, to one (RTS/CTS) or to all (BAM).

What comes from the bus is bounded: a number of sessions at once, each of at most 1785 bytes and of
a time-out. What breaks the rules ends its session, with an abort where it has one partner.
"""

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final

from hil_bench.canopen_device.agenda import MILLISECOND, NEVER
from hil_bench.devices.j1939.identifier import GLOBAL, HIGHEST_GROUP, NULL

LEAST_BYTES: Final = 9
MOST_BYTES: Final = 1785
PACKET_BYTES: Final = 7
MOST_SESSIONS: Final = 8
"""Sessions from others at once, to this device; and as many messages to all."""
MOST_WAITING: Final = 16
"""Messages that wait for an earlier one to the same device."""
MOST_AT_ONCE: Final = 16
"""Packets that a receiver may ask for with one CTS, and that this one asks for."""

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

_RETRANSMISSIONS: Final = 2


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
    """What has happened to sessions.

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


@dataclass(slots=True)
class _Incoming:
    """A message on its way to this device.

    Attributes:
        group: its PGN.
        size: bytes.
        packets: of seven bytes.
        window: the most packets for one CTS.
        deadline: when the next packet must be there [ns].
        following: number of the packet that is to come.
        last: number of the last packet that was asked for.
        has_gap: whether packets of this window are missing.
        repeats: how often packets were asked for again.
        data: what has come.
    """

    group: int
    size: int
    packets: int
    window: int
    deadline: int
    following: int = 1
    last: int = 0
    has_gap: bool = False
    repeats: int = 0
    data: bytearray = field(default_factory=bytearray)


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


Put = Callable[[int, bytes], None]
"""Sends eight bytes to an address."""

Deliver = Callable[[int, int, bytes], None]
"""Takes a whole message: PGN, source, data."""


class Transport:
    """The sessions of one device.

    Args:
        put_control: sends TP.CM.
        put_data: sends TP.DT.
        deliver: takes the messages that have come.

    Attributes:
        counters: what has happened so far.
    """

    def __init__(self, put_control: Put, put_data: Put, deliver: Deliver) -> None:
        self.counters = TransportCounters()
        self._put_control, self._put_data, self._deliver = put_control, put_data, deliver
        self._incoming: dict[int, _Incoming] = {}
        self._broadcasts: dict[int, _Incoming] = {}
        self._outgoing: dict[int, _Outgoing] = {}
        self._waiting: deque[tuple[int, bytes, int]] = deque()
        self._due = NEVER

    @property
    def due(self) -> int:
        """When `serve` has something to do [ns]; it may be earlier than need be."""
        return self._due

    def reset(self) -> None:
        """Forget all sessions."""
        self._incoming, self._broadcasts, self._outgoing = {}, {}, {}
        self._waiting.clear()
        self._due = NEVER

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

    def take_control(self, source: int, destination: int, data: bytes, now: int) -> None:
        """Take a TP.CM message."""
        if len(data) != 8 or source >= NULL:
            self.counters.ignored += 1
            return
        group = int.from_bytes(data[5:8], "little")
        control = data[0]
        if destination == GLOBAL:
            if control == Control.BAM:
                self._take_bam(source, group, data, now)
            else:
                self.counters.ignored += 1
        elif control == Control.RTS:
            self._take_rts(source, group, data, now)
        elif control == Control.CTS:
            self._take_cts(source, group, data, now)
        elif control == Control.END:
            self._take_end(source, group, data, now)
        elif control == Control.ABORT:
            self._take_abort(source, group, data[1], now)
        else:
            self.counters.ignored += 1

    def take_data(self, source: int, destination: int, data: bytes, now: int) -> None:
        """Take a TP.DT message."""
        sessions = self._broadcasts if destination == GLOBAL else self._incoming
        session = sessions.get(source)
        if session is None or len(data) != 8:
            self.counters.ignored += 1
        elif destination == GLOBAL:
            self._take_broadcast_packet(source, session, data, now)
        else:
            self._take_packet(source, session, data, now)

    def serve(self, now: int) -> None:
        """End the sessions whose time is over, and send packets to all that are due."""
        if now < self._due:
            return
        for source in [
            each for each, session in self._broadcasts.items() if now >= session.deadline
        ]:
            del self._broadcasts[source]
            self.counters.lost += 1
        for source in [each for each, session in self._incoming.items() if now >= session.deadline]:
            session = self._incoming[source]
            if session.has_gap:
                self._ask_again(source, session, now)
            else:
                self._abort(self._incoming, source, AbortReason.TIMEOUT)
        for address in [each for each, sent in self._outgoing.items() if now >= sent.deadline]:
            if address == GLOBAL:
                self._send_to_all(self._outgoing[address], now)
            else:
                self._abort(self._outgoing, address, AbortReason.TIMEOUT)
                self._open_waiting(address, now)
        sessions = (self._broadcasts, self._incoming, self._outgoing)
        self._due = min(
            (each.deadline for all_ in sessions for each in all_.values()), default=NEVER
        )

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
            self._control(GLOBAL, group, bytes((Control.BAM, *size, count, 0xFF)))
        else:
            most = min(MOST_AT_ONCE, count)
            self._control(destination, group, bytes((Control.RTS, *size, count, most)))

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
            self.counters.sent += 1
            self._open_waiting(GLOBAL, now)

    def _take_rts(self, source: int, group: int, data: bytes, now: int) -> None:
        size, packets, most = data[1] | data[2] << 8, data[3], data[4]
        open_one = self._incoming.get(source)
        if open_one is not None and open_one.group != group:
            self._refuse(source, group, AbortReason.BUSY)
        elif size > MOST_BYTES:
            self._refuse(source, group, AbortReason.TOO_LONG)
        elif not _fits(group, size, packets) or not most:
            self._refuse(source, group, AbortReason.OTHER)
        elif open_one is None and len(self._incoming) >= MOST_SESSIONS:
            self._refuse(source, group, AbortReason.RESOURCES)
        else:
            window = min(most, MOST_AT_ONCE)
            session = self._incoming[source] = _Incoming(group, size, packets, window, now)
            self._ask(source, session, now)

    def _take_bam(self, source: int, group: int, data: bytes, now: int) -> None:
        size, packets = data[1] | data[2] << 8, data[3]
        if self._broadcasts.pop(source, None) is not None:
            self.counters.lost += 1
        if not _fits(group, size, packets) or len(self._broadcasts) >= MOST_SESSIONS:
            self.counters.ignored += 1
            return
        deadline = self._wait(now + T1)
        self._broadcasts[source] = _Incoming(group, size, packets, packets, deadline)

    def _take_broadcast_packet(
        self, source: int, session: _Incoming, data: bytes, now: int
    ) -> None:
        if data[0] != session.following:
            del self._broadcasts[source]
            self.counters.lost += 1
            return
        self._keep(session, data, now)
        if session.following > session.packets:
            del self._broadcasts[source]
            self._finish(source, session)

    def _take_packet(self, source: int, session: _Incoming, data: bytes, now: int) -> None:
        number = data[0]
        if number == session.following and not session.has_gap and number <= session.last:
            self._keep(session, data, now)
            if number == session.packets:
                del self._incoming[source]
                size = session.size.to_bytes(2, "little")
                end = bytes((Control.END, *size, session.packets, 0xFF))
                self._control(source, session.group, end)
                self._finish(source, session)
            elif number == session.last:
                self._ask(source, session, now)
        elif not session.following <= number <= session.last:
            self._abort(self._incoming, source, _why_wrong(number, session))
        elif number == session.last:
            self._ask_again(source, session, now)
        else:
            session.has_gap = True
            session.deadline = self._wait(now + T1)

    def _keep(self, session: _Incoming, data: bytes, now: int) -> None:
        session.data += data[1:]
        session.following += 1
        session.deadline = self._wait(now + T1)

    def _finish(self, source: int, session: _Incoming) -> None:
        self.counters.received += 1
        self._deliver(session.group, source, bytes(session.data[: session.size]))

    def _ask(self, source: int, session: _Incoming, now: int) -> None:
        """Send the CTS for the next packets."""
        count = min(session.window, session.packets - session.following + 1)
        session.last = session.following + count - 1
        session.has_gap = False
        session.deadline = self._wait(now + T2)
        cts = bytes((Control.CTS, count, session.following, 0xFF, 0xFF))
        self._control(source, session.group, cts)

    def _ask_again(self, source: int, session: _Incoming, now: int) -> None:
        session.repeats += 1
        if session.repeats > _RETRANSMISSIONS:
            self._abort(self._incoming, source, AbortReason.RETRANSMISSIONS)
        else:
            self._ask(source, session, now)

    def _take_cts(self, source: int, group: int, data: bytes, now: int) -> None:
        sent = self._outgoing.get(source)
        if sent is None or sent.group != group:
            self.counters.ignored += 1
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
            if sent.repeats > _RETRANSMISSIONS:
                self._fail(source, AbortReason.RETRANSMISSIONS, now)
                return
        last = min(first + min(count, MOST_AT_ONCE) - 1, len(sent.packets))
        for packet in sent.packets[first - 1 : last]:
            self._put_data(source, packet)
        sent.reached = max(sent.reached, last)
        sent.deadline = self._wait(now + T3)

    def _take_end(self, source: int, group: int, data: bytes, now: int) -> None:
        sent = self._outgoing.get(source)
        if sent is None or sent.group != group:
            self.counters.ignored += 1
            return
        is_whole = sent.reached == len(sent.packets) and data[1] | data[2] << 8 == len(sent.data)
        if not is_whole:
            self._fail(source, AbortReason.OTHER, now)
            return
        del self._outgoing[source]
        self.counters.sent += 1
        self._open_waiting(source, now)

    def _take_abort(self, source: int, group: int, reason: int, now: int) -> None:
        found = False
        sent, session = self._outgoing.get(source), self._incoming.get(source)
        if session is not None and session.group == group:
            del self._incoming[source]
            found = True
        if sent is not None and sent.group == group:
            del self._outgoing[source]
            found = True
            self._open_waiting(source, now)
        if found:
            self.counters.ended[reason] += 1
        else:
            self.counters.ignored += 1

    def _fail(self, destination: int, reason: AbortReason, now: int) -> None:
        self._abort(self._outgoing, destination, reason)
        self._open_waiting(destination, now)

    def _abort(
        self,
        sessions: dict[int, _Incoming] | dict[int, _Outgoing],
        partner: int,
        reason: AbortReason,
    ) -> None:
        session = sessions.pop(partner)
        self._refuse(partner, session.group, reason)

    def _refuse(self, partner: int, group: int, reason: AbortReason) -> None:
        self.counters.aborted[reason] += 1
        self._control(partner, group, bytes((Control.ABORT, reason, 0xFF, 0xFF, 0xFF)))

    def _control(self, destination: int, group: int, head: bytes) -> None:
        self._put_control(destination, head + group.to_bytes(3, "little"))

    def _wait(self, deadline: int) -> int:
        self._due = min(self._due, deadline)
        return deadline


def _why_wrong(number: int, session: _Incoming) -> AbortReason:
    """Return the reason to abort for a packet that was not asked for."""
    if not 0 < number <= session.packets:
        return AbortReason.BAD_SEQUENCE
    is_old = number < session.following
    return AbortReason.DUPLICATE if is_old else AbortReason.UNEXPECTED_DATA


def _fits(group: int, size: int, packets: int) -> bool:
    """Return whether an announcement is one of a message that can be."""
    is_possible = LEAST_BYTES <= size <= MOST_BYTES and group <= HIGHEST_GROUP
    return is_possible and packets == -(-size // PACKET_BYTES)
