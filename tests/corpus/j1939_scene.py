"""Who sends what in a sound J1939 log, for the faults that are put into it."""

import itertools
from collections.abc import Callable
from functools import wraps

from corpus.faults import MS, Found, Nowhere, Scene, fault_of_j1939, merged
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.abilities.j1939.protocol.signals import join
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import LoggedFrame

CLAIMED, REQUEST, CONTROL, PACKET = 0xEE00, 0xEA00, 0xEC00, 0xEB00
PROPRIETARY = 0xEF00
ALL, NOBODY = 255, 254
_TRANSPORT = frozenset({0xEB, 0xEC})
_SERVICES = frozenset({0xE8, 0xEA, 0xEB, 0xEC, 0xEE})

Added = list[tuple[int, Frame]]

Blamed = int | str
"""The address of who is to blame, or a pattern of several."""

Act = Callable[[Scene, "Session"], Blamed]


def frame(group: int, source: int, data: bytes, destination: int = ALL, priority: int = 6) -> Frame:
    """Return a frame of a parameter group."""
    return Frame(join(priority, group, source, destination), data, is_extended=True)


def is_from(each: LoggedFrame, address: int) -> bool:
    """Return True for a J1939 frame of an address."""
    return each.frame.is_extended and each.frame.can_id & 0xFF == address


def pdu_format(each: LoggedFrame) -> int:
    """Return the PDU format of a frame; -1 for one with an 11-bit identifier."""
    return each.frame.can_id >> 16 & 0xFF if each.frame.is_extended else -1


def is_of(each: LoggedFrame, group: int, source: int) -> bool:
    """Return True for a frame of a group below 0xF000 and of its sender."""
    return pdu_format(each) == group >> 8 and is_from(each, source)


def group_of(can_id: int) -> int:
    """Return the number of a group that is sent to all."""
    return can_id >> 8 & 0x3FFFF


class Cyclic:
    """A message that comes regularly.

    Attributes:
        can_id: its identifier.
        source: address of its sender.
        period: the median interval [ns].
        times: when it came [ns].
    """

    def __init__(self, can_id: int, times: list[int]) -> None:
        self.can_id, self.times, self.source = can_id, times, can_id & 0xFF
        gaps = sorted(b - a for a, b in itertools.pairwise(times))
        self.period = gaps[len(gaps) // 2]
        self.is_regular = gaps[-1] < 1.6 * self.period and gaps[0] > 0.4 * self.period


def cyclic(scene: Scene, fewest: int = 14) -> list[Cyclic]:
    """Return the regular messages to all, in the order of their identifiers."""
    found: dict[int, list[int]] = {}
    for each in scene.frames:
        if pdu_format(each) >= 0xF0:
            found.setdefault(each.frame.can_id, []).append(each.now)
    messages = [Cyclic(can_id, times) for can_id, times in sorted(found.items()) if len(times) > 3]
    return [each for each in messages if each.is_regular and len(each.times) >= fewest]


def drawn(scene: Scene, fewest: int = 14) -> Cyclic:
    """Draw a regular message; `Nowhere` where there are too few."""
    return scene.choose(cyclic(scene, fewest))


def senders(scene: Scene) -> list[int]:
    """Return the addresses that send at least ten frames that are no transport."""
    count: dict[int, int] = {}
    for each in scene.frames:
        if pdu_format(each) >= 0 and pdu_format(each) not in _SERVICES:
            count[each.frame.can_id & 0xFF] = count.get(each.frame.can_id & 0xFF, 0) + 1
    return sorted(a for a, n in count.items() if n >= 10 and a < NOBODY)


def claims(scene: Scene) -> dict[int, LoggedFrame]:
    """Return the first claim of each address."""
    found: dict[int, LoggedFrame] = {}
    for each in scene.frames:
        if pdu_format(each) == 0xEE and each.frame.can_id & 0xFF < NOBODY:
            found.setdefault(each.frame.can_id & 0xFF, each)
    return found


def name_of(scene: Scene, address: int) -> bytes:
    """Return the NAME that an address has claimed; one of its own where the log has no claim."""
    claim = claims(scene).get(address)
    return bytes([address, 7, 0x40, 0x0C, 0, address, 0, 0]) if claim is None else claim.frame.data


def pair(scene: Scene, lasts: int) -> tuple[int, int, int]:
    """Draw two senders without a transfer between them, and a time with `lasts` [ns] after it.

    Raises:
        Nowhere: there are none.
    """
    found = senders(scene)
    busy = {
        frozenset((each.frame.can_id & 0xFF, each.frame.can_id >> 8 & 0xFF))
        for each in scene.frames
        if pdu_format(each) in _TRANSPORT
    }
    pairs = [(a, b) for a, b in itertools.permutations(found, 2) if frozenset((a, b)) not in busy]
    if scene.end < lasts + 2000 * MS:
        raise Nowhere
    at = int(scene.end * scene.share(0.2, 0.5))
    return (*scene.choose(pairs), min(at, scene.end - lasts))


def one_of_several(scene: Scene, longest: int) -> int:
    """Draw a sender beside others on a log of some length [ns].

    Raises:
        Nowhere: there is none.
    """
    found = senders(scene)
    if len(found) < 2 or scene.end < longest:
        raise Nowhere
    return scene.random.choice(
        [each for each in found if any(c.source == each for c in cyclic(scene))] or found
    )


class Session:
    """Builds the frames of a transfer between two.

    Args:
        source: sender of the message.
        destination: its receiver, or `ALL`.
        size: bytes.
        now: when it begins [ns].
        group: of the message.
    """

    def __init__(
        self, source: int, destination: int, size: int, now: int, group: int = PROPRIETARY
    ) -> None:
        self.a, self.b, self.size, self.now = source, destination, size, now
        self.count = -(-size // 7)
        self.frames: Added = []
        self._group = group.to_bytes(3, "little")

    def wait(self, milliseconds: float) -> "Session":
        """Let some time pass."""
        self.now += int(milliseconds * MS)
        return self

    def announce(self) -> "Session":
        """Send the RTS, or the BAM."""
        head = bytes([32 if self.b == ALL else 16, *self.size.to_bytes(2, "little"), self.count])
        return self._control(self.a, self.b, head + bytes([0xFF]))

    def clear(self, count: int, first: int) -> "Session":
        """Send a CTS of the receiver; 0 packets for hold."""
        return self._control(self.b, self.a, bytes([17, count, first, 0xFF, 0xFF]))

    def packet(self, number: int) -> "Session":
        """Send a packet."""
        data = bytes([number, *((number * 7 + k) & 0xFF for k in range(7))])
        self.frames.append((self.now, frame(PACKET, self.a, data, self.b, 7)))
        return self

    def packets(self, numbers: range, every: float) -> "Session":
        """Send packets, `every` ms one."""
        for number in numbers:
            self.wait(every).packet(number)
        return self

    def end(self) -> "Session":
        """Send the end of message of the receiver."""
        head = bytes([19, *self.size.to_bytes(2, "little"), self.count, 0xFF])
        return self._control(self.b, self.a, head)

    def abort(self, source: int, reason: int) -> "Session":
        """Send an abort of one of the two."""
        other = self.b if source == self.a else self.a
        return self._control(source, other, bytes([255, reason, 0xFF, 0xFF, 0xFF]))

    def _control(self, source: int, destination: int, head: bytes) -> "Session":
        self.frames.append((self.now, frame(CONTROL, source, head + self._group, destination, 7)))
        return self


def fault_of_a_transfer(lasts: int = 4000, shortest: int = 30) -> Callable[[Act], Act]:
    """Register a function as a fault of a transfer between two devices that have none.

    The function acts the transfer, and returns who is to blame.

    Args:
        lasts: the longest that the transfer takes [ms].
        shortest: its fewest bytes.
    """

    def register(act: Act) -> Act:
        @wraps(act)
        def make(scene: Scene) -> Found:
            source, destination, at = pair(scene, lasts * MS)
            session = Session(source, destination, int(scene.share(shortest, 300)), at)
            blamed = act(scene, session)
            return merged(scene.frames, session.frames), f"{blamed}"

        fault_of_j1939(Cause.J1939_TRANSFER)(make)
        return act

    return register
