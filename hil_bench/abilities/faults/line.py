"""A node's connection to the bus, on copper too, and what may happen to frames on it."""

import heapq
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple, Protocol

from hil_bench.abilities.faults.checks import FaultDirection
from hil_bench.canopen_device.frame import Emit, Frame, Handler

if TYPE_CHECKING:
    from numpy.random import Generator


Disturbance = Callable[[Frame], float | None]
"""Where in a frame a bit is disturbed, as a share of its bits below 1; None for nowhere."""


class WirePoint(Protocol):
    """The point at which a fault acts on a node on a bus of copper; all times in ns."""

    def disturb(self, rule: Disturbance, *, is_sent: bool) -> None:
        """Have a rule disturb what the node sends, or what it reads."""

    def spare(self, rule: Disturbance, *, is_sent: bool) -> None:
        """Take the rule back."""

    def force_off(self, now: int) -> None:
        """Make the node bus-off."""

    def let_recover(self, now: int) -> None:
        """Let it recover."""

    def stick(self, now: int) -> None:
        """Let it hold the bus dominant."""

    def unstick(self, now: int) -> None:
        """Let it leave the bus."""

    def pull(self, now: int) -> None:
        """Pull its plug: it is alone on its end of the cable."""

    def plug(self, now: int) -> None:
        """Plug it in again."""


class Passage(NamedTuple):
    """The passage of a frame: the frame and its delay.

    Attributes:
        frame: what arrives.
        delay: how much later [ns].
    """

    frame: Frame
    delay: int = 0


Rule = Callable[[Frame], Passage | None]
"""What one fault does to a frame that it meets: how that gets through, None where it is lost."""


@dataclass(eq=False)
class Meeting:
    """The frames that a rule meets.

    Attributes:
        rule: what happens to them.
        direction: seen from the node.
        can_id: their identifier, None for any.
        has_acted: whether one of them was lost, late or another one.
    """

    rule: Rule
    direction: FaultDirection = FaultDirection.BOTH
    can_id: int | None = None
    has_acted: bool = False

    def concerns(self, frame: Frame, direction: FaultDirection) -> bool:
        """Return True if the rule meets a frame that goes in this direction."""
        return self.direction in {FaultDirection.BOTH, direction} and self.can_id in {
            None,
            frame.can_id,
        }


class Receiver(Protocol):
    """The receiver at the end of a line."""

    def receive(self, frame: Frame, now: int) -> None:
        """Take a frame from the bus at `now` [ns]."""


class Line:
    """The connection of one node.

    Attributes:
        meetings: the faults of this line, in the order in which a frame meets them.
        may_delay: True: a fault may hold frames back.
    """

    may_delay: ClassVar[bool] = True

    def __init__(self, node: Receiver) -> None:
        self.meetings: list[Meeting] = []
        self._node = node
        self._now = 0
        self._late: dict[FaultDirection, list[tuple[int, int, Frame]]] = {
            FaultDirection.SENT: [],
            FaultDirection.RECEIVED: [],
        }
        self._number = 0  # of late frames: those of one time keep their order

    def sender(self, emit: Emit) -> Emit:
        """Return a callable that sends the node's frames; `emit` gets those not lost or late."""

        def send(frame: Frame) -> None:
            passed = self._pass(frame, FaultDirection.SENT, self._now)
            if passed is not None:
                emit(passed)

        return send

    def release(self, emit: Emit) -> None:
        """Emit the frames that the node has sent and that were late until now."""
        for frame in self._due(FaultDirection.SENT, self._now):
            emit(frame)

    def guard(self, handle: Handler) -> Handler:
        """Wrap a handler of the node so that received frames pass the line first."""

        def take(frame: Frame, now: int) -> None:
            passed = self._pass(frame, FaultDirection.RECEIVED, now)
            if passed is not None:
                handle(passed, now)

        return take

    def deliver(self, now: int) -> None:
        """Begin a round at `now` [ns]: hand the node the frames that were late until then."""
        self._now = now
        for frame in self._due(FaultDirection.RECEIVED, now):
            self._node.receive(frame, now)

    def _pass(self, frame: Frame, direction: FaultDirection, now: int) -> Frame | None:
        """Return the frame that passes at once; a late one waits."""
        late = 0
        for meeting in self.meetings:
            if meeting.concerns(frame, direction):
                passage = meeting.rule(frame)
                meeting.has_acted |= passage != (frame, 0)
                if passage is None:
                    return None
                frame, delay = passage
                late += delay
        if not late:
            return frame
        heapq.heappush(self._late[direction], (now + late, self._number, frame))
        self._number += 1
        return None

    def _due(self, direction: FaultDirection, now: int) -> list[Frame]:
        late, due = self._late[direction], []
        while late and late[0][0] <= now:
            due.append(heapq.heappop(late)[2])
        return due


def silence(_frame: Frame) -> Passage | None:
    """Return None: no frame gets through."""
    return None


def loss(share: float, stream: "Generator") -> Rule:
    """Return the rule by which a share of the frames is lost."""

    def lose(frame: Frame) -> Passage | None:
        return None if stream.random() < share else Passage(frame)

    return lose


def delay(time: int) -> Rule:
    """Return the rule by which frames are late by `time` [ns]."""
    return lambda frame: Passage(frame, time)


def truncation(length: int) -> Rule:
    """Return the rule by which data frames have `length` bytes: cut off, or filled with zeros."""

    def truncate(frame: Frame) -> Passage:
        if frame.is_remote:
            return Passage(frame)
        return Passage(frame._replace(data=frame.data[:length].ljust(length, b"\0")))

    return truncate


def corruption(share: float, stream: "Generator") -> Rule:
    """Return the rule by which a share of the data frames has one bit turned round."""

    def corrupt(frame: Frame) -> Passage:
        if frame.is_remote or not frame.data or stream.random() >= share:
            return Passage(frame)
        byte, bit = divmod(int(stream.integers(8 * len(frame.data))), 8)
        data = bytearray(frame.data)
        data[byte] ^= 1 << bit
        return Passage(frame._replace(data=bytes(data)))

    return corrupt


def repetition() -> Rule:
    """Return the rule by which each data frame has the bytes of the first one that it meets."""
    first: dict[int, bytes] = {}

    def repeat(frame: Frame) -> Passage:
        if frame.is_remote:
            return Passage(frame)
        return Passage(frame._replace(data=first.setdefault(frame.can_id, frame.data)))

    return repeat


class BitErrors:
    """The `Disturbance` by which a share of the frames of an identifier has a wrong bit, anywhere.

    Args:
        share: 0 to 1.
        can_id: the identifier, None for any.
        stream: of random numbers.

    Attributes:
        has_acted: whether it has disturbed a frame.
    """

    def __init__(self, share: float, can_id: int | None, stream: "Generator") -> None:
        self.has_acted = False
        self._share, self._can_id, self._stream = share, can_id, stream

    def __call__(self, frame: Frame) -> float | None:
        """Return the place of the wrong bit of a frame; None for nowhere."""
        if self._can_id not in {None, frame.can_id} or self._stream.random() >= self._share:
            return None
        self.has_acted = True
        return float(self._stream.random())


_HIGHEST_STANDARD: Final = 0x7FF

Babble = Callable[[Emit], None]
"""Sends what a babbling node sends in one tick."""


def babble(can_id: int, count: int, bus: int = 0) -> Babble:
    """Return a callable that sends `count` frames of eight bytes each tick on a numbered bus."""
    data = bytes.fromhex("5555555555555555")
    frames = (Frame(can_id, data, is_extended=can_id > _HIGHEST_STANDARD, bus=bus),) * count

    def send(emit: Emit) -> None:
        for frame in frames:
            emit(frame)

    return send
