"""Messages of more than eight bytes, put together from the frames of a bus (SAE J1939-21)."""

from dataclasses import dataclass, field
from typing import Final

from hil_bench.abilities.j1939.protocol.identifier import GLOBAL, HIGHEST_GROUP
from hil_bench.abilities.j1939.protocol.transport_protocol import (
    LEAST_BYTES,
    MOST_BYTES,
    PACKET_BYTES,
    T3,
    AbortReason,
    Control,
)

LONGEST_PAUSE: Final = T3
"""Time without a frame after which a transfer is given up [ns]; T3 is the longest of all."""

_MOST: Final = 256
_REASONS: Final = {int(reason): reason.name.lower().replace("_", " ") for reason in AbortReason}

Key = tuple[int, int, int]
"""Bus, sender of the message, receiver of the message."""


@dataclass(slots=True)
class LongMessage:
    """A message on its way, or at its end.

    Attributes:
        key: whose it is.
        group: its PGN.
        size: bytes.
        begin: when it was announced [ns].
        last: when its last frame came [ns].
        packets: those that have come, by number.
        is_accepted: whether the receiver has sent a CTS; of one to all, yes.
        problem: why it did not arrive; empty while nothing is wrong.
    """

    key: Key
    group: int
    size: int
    begin: int
    last: int
    packets: dict[int, bytes] = field(default_factory=dict)
    is_accepted: bool = False
    problem: str = ""

    @property
    def count(self) -> int:
        """The number of packets of the message."""
        return -(-self.size // PACKET_BYTES)

    @property
    def is_to_all(self) -> bool:
        """True if the message is announced by BAM."""
        return self.key[2] == GLOBAL

    @property
    def is_whole(self) -> bool:
        """True if all packets have come."""
        return len(self.packets) == self.count

    @property
    def data(self) -> bytes:
        """The message, as far as its packets have come in order."""
        found = b"".join(self.packets.get(number, b"") for number in range(1, self.count + 1))
        return found[: self.size]


class LongMessages:
    """Follows the transfers of all buses."""

    def __init__(self) -> None:
        self._open: dict[Key, LongMessage] = {}

    def take_control(
        self, bus: int, way: tuple[int, int], data: bytes, now: int
    ) -> tuple[bool, list[LongMessage]]:
        """Take a TP.CM frame.

        Args:
            bus: its number.
            way: sender and receiver of the frame.
            data: of the frame.
            now: its time [ns].

        Returns:
            Whether the frame belongs to a transfer, and the transfers that have ended with it.
        """
        source, destination = way
        forth, back = (bus, source, destination), (bus, destination, source)
        control = data[0] if len(data) == 8 else None
        group = int.from_bytes(data[5:8], "little") if control is not None else 0
        if control in {Control.RTS, Control.BAM}:
            return self._begin(forth, group, data, now)
        if control in {Control.CTS, Control.END}:
            found = self._open.get(back)
            if found is None or found.group != group:
                return False, []
            found.is_accepted, found.last = True, now
            return True, self._end(found, "") if control == Control.END else []
        if control == Control.ABORT:
            for key, who in ((forth, source), (back, source)):
                found = self._open.get(key)
                if found is not None and found.group == group:
                    found.last = now
                    reason = f"reason {data[1]} {_REASONS.get(data[1], '')}".rstrip()
                    return True, self._end(found, f"aborted by {who}, {reason}")
        return False, []

    def take_packet(
        self, bus: int, way: tuple[int, int], data: bytes, now: int
    ) -> tuple[bool, list[LongMessage]]:
        """Take a TP.DT frame; see `take_control`."""
        found = self._open.get((bus, *way))
        if found is None or len(data) != 8 or not 1 <= data[0] <= found.count:
            return False, []
        found.packets[data[0]] = data[1:]
        found.last = now
        if not (found.is_to_all and data[0] == found.count):
            return True, []
        return True, self._end(found, _missing(found))

    def expire(self, now: int) -> list[LongMessage]:
        """End the transfers that nobody continues at `now` [ns], and return them."""
        late = [each for each in self._open.values() if now - each.last > LONGEST_PAUSE]
        return [ended for each in late for ended in self._end(each, _missing(each))]

    def finish(self) -> list[LongMessage]:
        """Return the transfers that the end of the log has interrupted."""
        found, self._open = list(self._open.values()), {}
        return found

    def _begin(self, key: Key, group: int, data: bytes, now: int) -> tuple[bool, list[LongMessage]]:
        size, packets = data[1] | data[2] << 8, data[3]
        is_to_all = data[0] == Control.BAM
        new = LongMessage(key, group, size, now, now, is_accepted=is_to_all)
        fits = LEAST_BYTES <= size <= MOST_BYTES and packets == new.count
        if not fits or is_to_all != (key[2] == GLOBAL) or group > HIGHEST_GROUP:
            return False, []
        before = self._open.get(key)
        ended = [] if before is None else self._end(before, f"{_missing(before)}, then a new one")
        if len(self._open) >= _MOST:
            ended += self._end(next(iter(self._open.values())), "not followed: too many at once")
        self._open[key] = new
        return True, ended

    def _end(self, message: LongMessage, problem: str) -> list[LongMessage]:
        del self._open[message.key]
        message.problem = problem
        if not problem and not message.is_whole:
            message.problem = _missing(message)
        return [message]


def _missing(message: LongMessage) -> str:
    if not message.is_accepted:
        return "not answered"
    if not message.is_whole:
        return f"not complete, {len(message.packets)} of {message.count} packets"
    return "" if message.is_to_all else "not acknowledged"
