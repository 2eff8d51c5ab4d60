"""Reception by the transport protocol of SAE J1939-21: 9 to 1785 bytes, to us or to all."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from hil_drivers.j1939.identifier import GLOBAL, HIGHEST_GROUP

T1: Final = 0.75
"""Longest time between two packets [s]."""
T2: Final = 1.25
"""Longest time from a CTS to its first packet [s]."""

MOST_SESSIONS: Final = 32

_RTS, _CTS, _END, _BAM, _ABORT = 16, 17, 19, 32, 255
_BUSY, _TIMEOUT, _BAD_SEQUENCE = 2, 3, 7
_PACKET, _LEAST, _MOST = 7, 9, 1785
_WINDOW = 16

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
        return -(-self.size // _PACKET)

    @property
    def following(self) -> int:
        """Number of the packet that is to come."""
        return len(self.data) // _PACKET + 1


class Transport:
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
        if kind == _ABORT:
            self.lost += self._sessions.pop(key, None) is not None
        elif kind in {_RTS, _BAM} and (kind == _BAM) == (destination == GLOBAL):
            return self._open(key, group, data, now)
        return True

    def take_packet(self, source: int, destination: int, data: bytes, now: float) -> bool:
        """Take a packet; False where it is malformed or belongs to no message."""
        key = (source, destination)
        session = self._sessions.get(key)
        if session is None or len(data) != 8:
            return False
        if data[0] != session.following:
            self._end(key, _BAD_SEQUENCE)
            return False
        session.data += data[1:]
        session.deadline = now + T1
        if len(session.data) >= session.size:
            del self._sessions[key]
            if destination != GLOBAL:
                size = session.size.to_bytes(2, "little")
                self._say(source, bytes((_END, *size, session.packets, 0xFF)), session.group)
            return self._deliver(session.group, source, bytes(session.data[: session.size]))
        if destination != GLOBAL and session.following > session.last:
            self._ask(source, session, now)
        return True

    def serve(self, now: float) -> float:
        """Give up what is too late; return when to be asked next [s]."""
        for key in [key for key, each in self._sessions.items() if now >= each.deadline]:
            self._end(key, _TIMEOUT)
        return min((each.deadline for each in self._sessions.values()), default=float("inf"))

    def _open(self, key: Key, group: int, data: bytes, now: float) -> bool:
        size, packets = data[1] | data[2] << 8, data[3]
        session = _Session(group, size, min(data[4] or _WINDOW, _WINDOW), now + T1)
        if not _LEAST <= size <= _MOST or packets != session.packets or group > HIGHEST_GROUP:
            return False
        self.lost += self._sessions.pop(key, None) is not None
        if len(self._sessions) >= MOST_SESSIONS:
            if key[1] != GLOBAL:
                self._say(key[0], bytes((_ABORT, _BUSY, 0xFF, 0xFF, 0xFF)), group)
            return True
        self._sessions[key] = session
        if key[1] != GLOBAL:
            self._ask(key[0], session, now)
        return True

    def _ask(self, source: int, session: _Session, now: float) -> None:
        count = min(session.window, session.packets - session.following + 1)
        session.last = session.following + count - 1
        session.deadline = now + T2
        self._say(source, bytes((_CTS, count, session.following, 0xFF, 0xFF)), session.group)

    def _end(self, key: Key, reason: int) -> None:
        session = self._sessions.pop(key)
        self.lost += 1
        if key[1] != GLOBAL:
            self._say(key[0], bytes((_ABORT, reason, 0xFF, 0xFF, 0xFF)), session.group)

    def _say(self, destination: int, head: bytes, group: int) -> None:
        self._control(destination, head + group.to_bytes(3, "little"))
