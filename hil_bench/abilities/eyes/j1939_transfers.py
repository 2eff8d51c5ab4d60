"""Messages of more than eight bytes, put together from the frames of a bus (SAE J1939-21)."""

from dataclasses import dataclass, field
from statistics import median
from typing import Final

from hil_bench.abilities.j1939.protocol import transmission
from hil_bench.abilities.j1939.protocol.signals import GLOBAL, HIGHEST_GROUP

LONGEST_PAUSE: Final = transmission.T3
"""Time without a frame after which a transfer is given up [ns]; T3 is the longest of all."""

_PAUSE_OF_BAM: Final = transmission.T1 + transmission.T1 // 5
"""The same of a message to all, of which receivers wait T1 for a packet [ns]."""

_MS: Final = 1_000_000
_SHORTEST: Final = 9 * _MS
_LONGEST: Final = 220 * _MS
"""Median times between packets to all that are too short and too long [ns], a tenth beyond 10 ms
to 200 ms: J1939-21 has 50 ms to 200 ms, ISO 11783-3 from 10 ms on, as public stacks cite them."""

_FEWEST: Final = 3
_MOST: Final = 256
_REASONS: Final = {
    int(reason): reason.name.lower().replace("_", " ") for reason in transmission.AbortReason
}
_OF_SENDER: Final = frozenset(
    {
        transmission.AbortReason.UNEXPECTED_DATA,
        transmission.AbortReason.BAD_SEQUENCE,
        transmission.AbortReason.DUPLICATE,
        transmission.AbortReason.TOO_LONG,
    }
)
"""Reasons of a receiver that the sender of the message has given it."""

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
        culprit: the address that did not do what was due; None for nobody.
        pace: what is wrong with the times between its packets; empty for nothing.
        due: number of the packet that is due.
        misplaced: the first packet that came in place of another, in words.
        is_held: whether the last CTS said wait.
        is_new: whether no packet has come since the last CTS.
        gaps: times between its packets to all [ns].
    """

    key: Key
    group: int
    size: int
    begin: int
    last: int
    packets: dict[int, bytes] = field(default_factory=dict)
    is_accepted: bool = False
    problem: str = ""
    culprit: int | None = None
    pace: str = ""
    due: int = 1
    misplaced: str = ""
    is_held: bool = False
    is_new: bool = True
    gaps: list[int] = field(default_factory=list)

    @property
    def count(self) -> int:
        """The number of packets of the message."""
        return -(-self.size // transmission.PACKET_BYTES)

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

    def add(self, number: int, data: bytes, now: int) -> None:
        """Take a packet."""
        if number != self.due and not self.misplaced:
            self.misplaced = f"packet {number} came in place of {self.due}"
        if self.is_to_all and len(self.gaps) < _MOST:  # one may come again and again
            self.gaps.append(now - self.last)
        self.packets[number] = data
        self.due, self.is_new, self.last = number + 1, False, now

    def clear(self, count: int, first: int, now: int) -> None:
        """Take a CTS, which may ask for packets again."""
        self.is_accepted, self.is_held, self.is_new, self.last = True, not count, True, now
        if count:
            self.due, self.misplaced = first, ""

    def stage(self) -> tuple[str, int]:
        """Return the frame that is due and did not come, and the address that it is due from."""
        _, source, destination = self.key
        if not self.is_accepted:
            return "no CTS of the receiver (T3)", destination
        if self.is_held:
            return "no CTS after the one that says wait (T4)", destination
        if self.is_whole and not self.is_to_all and not self.misplaced:
            return "no end of message of the receiver (T3)", destination
        return self._lack(), source

    def _lack(self) -> str:
        """Return the packet that did not come when its sender was to send it, in words."""
        missing = [n for n in range(1, max(self.packets, default=0)) if n not in self.packets]
        if self.misplaced or missing:
            return self.misplaced or f"packet {missing[0]} is missing"
        if self.packets and not self.is_new:
            return f"no packet after number {self.due - 1} (T1)"
        if self.is_to_all:
            return "no packet after the announcement (T1)"
        return "no packet after the CTS (T2)"

    def judge_pace(self) -> None:
        """Say whether the packets to all came too fast or too slowly."""
        if len(self.gaps) >= _FEWEST and not _SHORTEST <= median(self.gaps) <= _LONGEST:
            self.pace = f"{median(self.gaps) / _MS:.3g} ms between its packets, 10 ms to 200 ms"
            self.pace += " are right"


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
        if control in {transmission.Control.RTS, transmission.Control.BAM}:
            return self._begin(forth, group, data, now)
        if control in {transmission.Control.CTS, transmission.Control.END}:
            found = self._open.get(back)
            if found is None or found.group != group:
                return False, []
            if control == transmission.Control.CTS:
                found.clear(data[1], data[2], now)
                return True, []
            found.is_accepted, found.is_held, found.last = True, False, now
            return True, self._end(found)
        if control == transmission.Control.ABORT:
            both = [each for key in (forth, back) if (each := self._open.get(key)) is not None]
            ended = [each for each in both if each.group == group]
            if ended:  # of two messages of one group to and fro, the one that was last at work
                found = max(ended, key=lambda each: each.last)
                self._abort(found, source, data[1])
                found.last = now
                return True, self._end(found)
        return False, []

    def _abort(self, message: LongMessage, by: int, reason: int) -> None:
        """Note who has ended a message, and whose fault that is."""
        what, culprit = message.stage()
        words = f"aborted by {by}, reason {reason} {_REASONS.get(reason, '')}".rstrip()
        is_of_sender = by != message.key[1] and reason in _OF_SENDER
        if reason == transmission.AbortReason.TIMEOUT or (is_of_sender and message.misplaced):
            message.problem, message.culprit = f"{words}: {what}", culprit
        else:
            message.problem, message.culprit = words, message.key[1]

    def take_packet(
        self, bus: int, way: tuple[int, int], data: bytes, now: int
    ) -> tuple[bool, list[LongMessage]]:
        """Take a TP.DT frame; see `take_control`."""
        found = self._open.get((bus, *way))
        if found is None or len(data) != 8 or not 1 <= data[0] <= found.count:
            return False, []
        found.add(data[0], data[1:], now)
        if not (found.is_to_all and data[0] == found.count):
            return True, []
        return True, self._end(found)

    def expire(self, now: int) -> list[LongMessage]:
        """End the transfers that nobody continues at `now` [ns], and return them."""
        late = [
            each
            for each in self._open.values()
            if now - each.last > (_PAUSE_OF_BAM if each.is_to_all else LONGEST_PAUSE)
        ]
        for each in late:
            each.problem, each.culprit = _missing(each)
        return [ended for each in late for ended in self._end(each)]

    def finish(self) -> list[LongMessage]:
        """Return the transfers that the end of the log has interrupted."""
        found, self._open = list(self._open.values()), {}
        return found

    def _begin(self, key: Key, group: int, data: bytes, now: int) -> tuple[bool, list[LongMessage]]:
        size, packets = data[1] | data[2] << 8, data[3]
        is_to_all = data[0] == transmission.Control.BAM
        new = LongMessage(key, group, size, now, now, is_accepted=is_to_all)
        if size < transmission.LEAST_BYTES or group > HIGHEST_GROUP:
            return False, []
        new.problem = _contradiction(new, packets, is_to_all=is_to_all)
        if new.problem:
            new.culprit = key[1]
            return False, [new]
        before = self._open.get(key)
        ended = []
        if before is not None:
            missing, before.culprit = _missing(before)
            before.problem = f"{missing}, then a new one"
            ended = self._end(before)
        if len(self._open) >= _MOST:
            oldest = next(iter(self._open.values()))
            oldest.problem = "not followed: too many at once"
            ended += self._end(oldest)
        self._open[key] = new
        return True, ended

    def _end(self, message: LongMessage) -> list[LongMessage]:
        """End a message; it is one that did not arrive where nobody has said so, and it is not."""
        del self._open[message.key]
        message.judge_pace()
        if not message.problem and not message.is_whole:
            message.problem, message.culprit = _missing(message)
        elif not message.problem and message.is_to_all and message.misplaced:
            message.problem, message.culprit = message.misplaced, message.key[1]
        return [message]


def _contradiction(message: LongMessage, packets: int, *, is_to_all: bool) -> str:
    """Return the contradiction in an announcement, in words; empty for a right one."""
    if is_to_all != message.is_to_all:
        return "BAM to one address" if is_to_all else "RTS to all"
    if message.size > transmission.MOST_BYTES:
        return f"announced with {message.size} bytes, {transmission.MOST_BYTES} at most are right"
    if packets != message.count:
        return f"announced with {packets} packets, {message.count} are right"
    return ""


def _missing(message: LongMessage) -> tuple[str, int]:
    """Return why a message that nobody continues did not arrive, and whose fault that is."""
    what, culprit = message.stage()
    if not message.is_accepted:
        return f"not answered, {what}", culprit
    if message.is_whole:
        return f"not acknowledged, {what}", culprit
    return f"not complete, {len(message.packets)} of {message.count} packets, {what}", culprit


# Fast packets of NMEA 2000: up to 223 bytes, one frame of one identifier behind the other.

_FAST: Final = range(0x1ED00, 0x20000)
"""The parameter groups that can be sent so; those of J1939 are below."""

_COUNT_BITS: Final = 0x1F
_IN_ONE_FRAME: Final = 8
_IN_FIRST, _IN_NEXT, _MOST_OF_FAST = 6, 7, 223
_BEHIND: Final = 50 * _MS
"""Time within which the next frame follows [ns]."""


class FastPackets:
    """Knows the frames that go on a fast packet.

    The upper three bits of the first byte number the message, the lower five its frames from 0; the
    second byte of the first one is the length. Other messages of one frame can look like a first
    one; what follows in time and number is no message of its own.
    """

    def __init__(self) -> None:
        self._open: dict[tuple[Key, int], tuple[int, int, int]] = {}

    def part_of(self, key: Key, group: int, data: bytes, now: int) -> tuple[int, int] | None:
        """Return number and count of a frame that goes on a fast packet; None for any other.

        Args:
            key: bus, sender and receiver.
            group: its PGN.
            data: of the frame.
            now: when it came [ns].
        """
        if group not in _FAST or len(data) != _IN_ONE_FRAME:
            return None
        before = self._open.pop((key, group), None)
        if data[0] & _COUNT_BITS == 0:
            if _IN_ONE_FRAME < data[1] <= _MOST_OF_FAST and len(self._open) < _MOST:
                frames = 1 - -(data[1] - _IN_FIRST) // _IN_NEXT
                self._open[key, group] = data[0], frames, now
            return None
        if before is None or data[0] != before[0] + 1 or now - before[2] > _BEHIND:
            return None
        number = (data[0] & _COUNT_BITS) + 1
        if number < before[1]:
            self._open[key, group] = data[0], before[1], now
        return number, before[1]
