"""Reception by the transport protocol of SAE J1939-21: 9 to 1785 bytes, to us or to all."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from hil_drivers.j1939.identifier import GLOBAL, HIGHEST_GROUP
from hil_drivers.j1939.transport_protocol import (
    LEAST_BYTES,
    MOST_AT_ONCE,
    MOST_BYTES,
    PACKET_BYTES,
    T1,
    T2,
    AbortReason,
    Control,
    abort,
    connection,
    packets_of,
)

MOST_SESSIONS: Final = 32

Key = tuple[int, int]
"""Source and destination of a session."""


@dataclass(slots=True)
class _Session:
    """A message on its way.

    Attributes:
        group: its parameter group.
        size: bytes.
        window: most packets for one CTS.
        deadline: when the next packet must be there [s].
        last: number of the last packet that was asked for.
        data: what has come.
    """

    group: int
    size: int
    window: int
    deadline: float
    last: int = 0
    data: bytearray = field(default_factory=bytearray)

    @property
    def packets(self) -> int:
        return packets_of(self.size)

    @property
    def following(self) -> int:
        """Number of the packet that is to come."""
        return len(self.data) // PACKET_BYTES + 1


class Reception:
    """Long messages that come.

    Args:
        control: sends eight bytes of connection management to an address.
        deliver: takes whole messages: group, source, data.

    Attributes:
        lost: messages that stayed incomplete.
    """

    def __init__(
        self, control: Callable[[int, bytes], None], deliver: Callable[[int, int, bytes], bool]
    ) -> None:
        self.lost = 0
        self._control, self._deliver = control, deliver
        self._sessions: dict[Key, _Session] = {}

    def take_control(self, source: int, destination: int, data: bytes, now: float) -> bool:
        """Take a frame of connection management; False where it is malformed."""
        if len(data) != 8:
            return False
        kind, key, group = data[0], (source, destination), int.from_bytes(data[5:], "little")
        if kind == Control.ABORT:
            self.lost += self._sessions.pop(key, None) is not None
        elif kind in {Control.RTS, Control.BAM} and (kind == Control.BAM) == (
            destination == GLOBAL
        ):
            return self._open(key, group, data, now)
        return True

    def take_packet(self, source: int, destination: int, data: bytes, now: float) -> bool:
        """Take a packet; False where it is malformed or belongs to no message."""
        key = (source, destination)
        session = self._sessions.get(key)
        if session is None or len(data) != 8:
            return False
        if data[0] != session.following:
            self._end(key, AbortReason.BAD_SEQUENCE)
            return False
        session.data += data[1:]
        session.deadline = now + T1
        if len(session.data) >= session.size:
            del self._sessions[key]
            if destination != GLOBAL:
                size = session.size.to_bytes(2, "little")
                head = bytes((*size, session.packets, 0xFF))
                self._control(source, connection(Control.END, head, session.group))
            return self._deliver(session.group, source, bytes(session.data[: session.size]))
        if destination != GLOBAL and session.following > session.last:
            self._ask(source, session, now)
        return True

    def forget(self) -> None:
        """Give up all messages, and say nothing."""
        self.lost += len(self._sessions)
        self._sessions.clear()

    def serve(self, now: float) -> float:
        """Give up what is too late; return when to be asked next [s]."""
        for key in [key for key, each in self._sessions.items() if now >= each.deadline]:
            self._end(key, AbortReason.TIMEOUT)
        return min((each.deadline for each in self._sessions.values()), default=float("inf"))

    def _open(self, key: Key, group: int, data: bytes, now: float) -> bool:
        size, packets = data[1] | data[2] << 8, data[3]
        session = _Session(group, size, min(data[4] or MOST_AT_ONCE, MOST_AT_ONCE), now + T1)
        if (
            not LEAST_BYTES <= size <= MOST_BYTES
            or packets != session.packets
            or group > HIGHEST_GROUP
        ):
            return False
        self.lost += self._sessions.pop(key, None) is not None
        if len(self._sessions) >= MOST_SESSIONS:
            if key[1] != GLOBAL:
                self._control(key[0], abort(AbortReason.RESOURCES, group))
            return True
        self._sessions[key] = session
        if key[1] != GLOBAL:
            self._ask(key[0], session, now)
        return True

    def _ask(self, source: int, session: _Session, now: float) -> None:
        count = min(session.window, session.packets - session.following + 1)
        session.last = session.following + count - 1
        session.deadline = now + T2
        head = bytes((count, session.following, 0xFF, 0xFF))
        self._control(source, connection(Control.CTS, head, session.group))

    def _end(self, key: Key, reason: AbortReason) -> None:
        session = self._sessions.pop(key)
        self.lost += 1
        if key[1] != GLOBAL:
            self._control(key[0], abort(reason, session.group))
