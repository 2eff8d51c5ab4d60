"""Long messages that come to a device (SAE J1939-21): RTS answered by CTS, and BAM.

What comes from the bus is bounded: a number of sessions at once, each of at most 1785 bytes and of
a time-out.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from hil_bench.abilities.j1939.protocol import transmission
from hil_bench.abilities.j1939.protocol.signals import GLOBAL
from hil_bench.canopen_device.agenda import NEVER

MOST_SESSIONS: Final = 8
"""Sessions from others at once, to this device; and as many messages to all."""

Deliver = Callable[[int, int, bytes], None]
"""Takes a whole message: PGN, source, data."""


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


class Reception:
    """The sessions in which one device receives.

    Args:
        line: answers the senders, and counts.
        deliver: takes the messages that have come.

    Attributes:
        due: when `serve` has something to do [ns]; it may be earlier than need be.
    """

    def __init__(self, line: transmission.Line, deliver: Deliver) -> None:
        self.due = NEVER
        self._line, self._deliver = line, deliver
        self._incoming: dict[int, _Incoming] = {}
        self._broadcasts: dict[int, _Incoming] = {}

    def reset(self) -> None:
        """Forget all sessions."""
        self._incoming, self._broadcasts, self.due = {}, {}, NEVER

    def take_rts(self, source: int, group: int, data: bytes, now: int) -> None:
        """Take an announcement to this device."""
        size, packets, most = data[1] | data[2] << 8, data[3], data[4]
        open_one = self._incoming.get(source)
        if open_one is not None and open_one.group != group:
            self._line.refuse(source, group, transmission.AbortReason.BUSY)
        elif size > transmission.MOST_BYTES:
            self._line.refuse(source, group, transmission.AbortReason.TOO_LONG)
        elif not transmission.fits(group, size, packets) or not most:
            self._line.refuse(source, group, transmission.AbortReason.OTHER)
        elif open_one is None and len(self._incoming) >= MOST_SESSIONS:
            self._line.refuse(source, group, transmission.AbortReason.RESOURCES)
        else:
            window = min(most, transmission.MOST_AT_ONCE)
            session = self._incoming[source] = _Incoming(group, size, packets, window, now)
            self._ask(source, session, now)

    def take_bam(self, source: int, group: int, data: bytes, now: int) -> None:
        """Take an announcement to all."""
        size, packets = data[1] | data[2] << 8, data[3]
        self._broadcasts.pop(source, None)
        if transmission.fits(group, size, packets) and len(self._broadcasts) < MOST_SESSIONS:
            deadline = self._wait(now + transmission.T1)
            self._broadcasts[source] = _Incoming(group, size, packets, packets, deadline)

    def take_data(self, source: int, destination: int, data: bytes, now: int) -> None:
        """Take a TP.DT message."""
        sessions = self._broadcasts if destination == GLOBAL else self._incoming
        session = sessions.get(source)
        if session is None or len(data) != 8:
            return
        if destination == GLOBAL:
            self._take_broadcast_packet(source, session, data, now)
        else:
            self._take_packet(source, session, data, now)

    def end(self, source: int, group: int) -> None:
        """End a session that its sender has ended, if there is one."""
        session = self._incoming.get(source)
        if session is not None and session.group == group:
            del self._incoming[source]

    def serve(self, now: int) -> None:
        """End the sessions whose time is over."""
        if now < self.due:
            return
        for source in [each for each, open_ in self._broadcasts.items() if now >= open_.deadline]:
            del self._broadcasts[source]
        for source in [each for each, session in self._incoming.items() if now >= session.deadline]:
            session = self._incoming[source]
            if session.has_gap:
                self._ask_again(source, session, now)
            else:
                self._abort(source, transmission.AbortReason.TIMEOUT)
        sessions = (self._broadcasts, self._incoming)
        self.due = min(
            (each.deadline for all_ in sessions for each in all_.values()), default=NEVER
        )

    def _take_broadcast_packet(
        self, source: int, session: _Incoming, data: bytes, now: int
    ) -> None:
        if data[0] != session.following:
            del self._broadcasts[source]
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
                end = bytes((transmission.Control.END, *size, session.packets, 0xFF))
                self._line.control(source, session.group, end)
                self._finish(source, session)
            elif number == session.last:
                self._ask(source, session, now)
        elif not session.following <= number <= session.last:
            self._abort(source, _why_wrong(number, session))
        elif number == session.last:
            self._ask_again(source, session, now)
        else:
            session.has_gap = True
            session.deadline = self._wait(now + transmission.T1)

    def _keep(self, session: _Incoming, data: bytes, now: int) -> None:
        session.data += data[1:]
        session.following += 1
        session.deadline = self._wait(now + transmission.T1)

    def _finish(self, source: int, session: _Incoming) -> None:
        self._deliver(session.group, source, bytes(session.data[: session.size]))

    def _ask(self, source: int, session: _Incoming, now: int) -> None:
        """Send the CTS for the next packets."""
        count = min(session.window, session.packets - session.following + 1)
        session.last = session.following + count - 1
        session.has_gap = False
        session.deadline = self._wait(now + transmission.T2)
        cts = bytes((transmission.Control.CTS, count, session.following, 0xFF, 0xFF))
        self._line.control(source, session.group, cts)

    def _ask_again(self, source: int, session: _Incoming, now: int) -> None:
        session.repeats += 1
        if session.repeats > transmission.RETRANSMISSIONS:
            self._abort(source, transmission.AbortReason.RETRANSMISSIONS)
        else:
            self._ask(source, session, now)

    def _abort(self, source: int, reason: transmission.AbortReason) -> None:
        session = self._incoming.pop(source)
        self._line.refuse(source, session.group, reason)

    def _wait(self, deadline: int) -> int:
        self.due = min(self.due, deadline)
        return deadline


def _why_wrong(number: int, session: _Incoming) -> transmission.AbortReason:
    """Return the reason to abort for a packet that was not asked for."""
    if not 0 < number <= session.packets:
        return transmission.AbortReason.BAD_SEQUENCE
    is_old = number < session.following
    return (
        transmission.AbortReason.DUPLICATE if is_old else transmission.AbortReason.UNEXPECTED_DATA
    )
