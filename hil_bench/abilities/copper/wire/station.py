"""One participant of a bus: its configuration, its buffer, its error counters (ISO 11898-1)."""

import heapq
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, NamedTuple

from hil_bench.canopen_device.frame import Frame
from hil_bench.frame import priority

# One participant of a bus: its transmission buffer and its error counters (ISO 11898-1).

PASSIVE_FROM: Final = 128
BUS_OFF_FROM: Final = 256
_MOST_RECEIVE_ERRORS: Final = 255
_AFTER_PASSIVE: Final = 127


class Order(StrEnum):
    """The order in which a buffer's frames go to arbitration."""

    PRIORITY = "priority"
    FIFO = "fifo"


class CanState(StrEnum):
    """The error state of a station."""

    ACTIVE = "error-active"
    PASSIVE = "error-passive"
    BUS_OFF = "bus-off"


class Pending(NamedTuple):
    """A frame that waits for the bus.

    Attributes:
        priority: the lower, the earlier; see `priority`.
        number: in the order of arrival.
        released: when its sender wanted to send it [ns].
        frame: the frame.
    """

    priority: int
    number: int
    released: int
    frame: Frame


Rule = Callable[[Frame], float | None]
"""Where in a frame a bit is disturbed, as a share of its bits below 1; None for nowhere."""


class Station:
    """A CAN controller with its transmission buffer.

    Args:
        name: for people.
        depth: frames that the buffer holds, with the one that is on the bus.
        order: which of them goes to arbitration.

    Attributes:
        name: as passed in.
        tec: transmit error counter.
        rec: receive error counter.
        sent: frames that have passed the bus.
        refused: frames that found the buffer full, and are lost.
        errors: transmissions that failed, and were repeated.
        missed: frames that passed the bus and that this station could not read.
        ready_at: earliest time of its next transmission [ns].
        sending: its frame that is on the bus.
        has_overrun: whether a frame was refused since the buffer was empty.
        send_rules: what disturbs the frames that it sends.
        receive_rules: what disturbs its reading of the frames of others.
    """

    __slots__ = (
        "_fifo",
        "_heap",
        "_number",
        "depth",
        "errors",
        "has_overrun",
        "held_off",
        "is_off",
        "missed",
        "name",
        "order",
        "ready_at",
        "rec",
        "receive_rules",
        "refused",
        "send_rules",
        "sending",
        "sent",
        "tec",
    )

    def __init__(self, name: str, depth: int, order: Order = Order.PRIORITY) -> None:
        self.name = name
        self.depth = depth
        self.order = order
        self.tec = 0
        self.rec = 0
        self.sent = 0
        self.refused = 0
        self.errors = 0
        self.missed = 0
        self.ready_at = 0
        self.is_off = False
        self.held_off = 0
        self.has_overrun = False
        self.sending: Pending | None = None
        self.send_rules: list[Rule] = []
        self.receive_rules: list[Rule] = []
        self._heap: list[Pending] = []
        self._fifo: deque[Pending] = deque()
        self._number = 0

    @property
    def state(self) -> CanState:
        """The error state of the station."""
        if self.is_off:
            return CanState.BUS_OFF
        return CanState.PASSIVE if self.is_passive else CanState.ACTIVE

    @property
    def is_passive(self) -> bool:
        """Return True if one of its counters is at 128 or above."""
        return self.tec >= PASSIVE_FROM or self.rec >= PASSIVE_FROM

    @property
    def waiting(self) -> int:
        """Frames in the buffer, with the one that is on the bus."""
        return len(self._heap) + len(self._fifo) + (self.sending is not None)

    @property
    def head(self) -> Pending | None:
        """The frame that goes to arbitration next."""
        if self._heap:
            return self._heap[0]
        return self._fifo[0] if self._fifo else None

    def put(self, frame: Frame, now: int) -> bool:
        """Take a frame into the buffer at `now` [ns]; return whether none is lost.

        A sorted buffer that is full drops the frame that would be sent last, another the new one.
        """
        key = priority(frame)
        has_room = self.waiting < self.depth
        if not has_room:
            self.refused += 1
            if not self._make_room(key):
                return False
        self._number += 1
        pending = Pending(key, self._number, now, frame)
        if self.order is Order.FIFO:
            self._fifo.append(pending)
        else:
            heapq.heappush(self._heap, pending)
        return has_room

    def _make_room(self, key: int) -> bool:
        """Drop a frame of lower priority; return whether there was one."""
        last = max(self._heap, default=None)
        if last is None or last.priority <= key:
            return False
        self._heap.remove(last)
        heapq.heapify(self._heap)
        return True

    def begin(self) -> Pending:
        """Put the head on the bus."""
        self.sending = heapq.heappop(self._heap) if self._heap else self._fifo.popleft()
        return self.sending

    def succeed(self) -> None:
        """Take note that the frame on the bus has passed."""
        self.sending = None
        self.sent += 1
        if self.tec:
            self.tec -= 1

    def take_back(self) -> None:
        """Put the frame on the bus back to the head of the buffer: it will be repeated."""
        if self.sending is not None:
            if self.order is Order.FIFO:
                self._fifo.appendleft(self.sending)
            else:
                heapq.heappush(self._heap, self.sending)
            self.sending = None
            self.errors += 1

    def fail(self, errors: int) -> None:
        """Count errors of a transmission that failed; it will be repeated."""
        self.take_back()
        self.tec += errors

    def count_to(self, tec: int, rec: int) -> None:
        """Set both counters, up to the most that they can be."""
        self.tec = min(tec, BUS_OFF_FROM)
        self.rec = min(rec, _MOST_RECEIVE_ERRORS)

    @property
    def released(self) -> int:
        """When it wanted to send what is on the bus [ns]."""
        return self.sending.released if self.sending else 0

    def receive(self) -> None:
        """Count a frame that was read without error (ISO 11898-1, rule h)."""
        if self.rec >= PASSIVE_FROM:
            self.rec = _AFTER_PASSIVE
        elif self.rec:
            self.rec -= 1

    def fail_to_receive(self, count: int) -> None:
        """Count errors of a receiver."""
        self.rec = min(self.rec + count, _MOST_RECEIVE_ERRORS)


# The configuration of a simulated bus in `bench.toml`.

CONTROLLER: Final = "controller"
"""Name of the station that sends what comes from outside the bench."""


@dataclass(frozen=True, slots=True)
class BufferConfig:
    """The transmission buffer of a station.

    Attributes:
        depth: frames that it holds.
        order: which of them goes to arbitration.
    """

    depth: int
    order: Order


@dataclass(frozen=True, slots=True)
class WireConfig:
    """A bus of copper.

    Attributes:
        buffer: of the stations that have none of their own.
        buffers: of stations, by their names.
        bit_error_rate: chance of each bit on the bus to be disturbed.
        recovery: time from bus-off until the software of a node asks for its recovery [s].
    """

    buffer: BufferConfig
    buffers: Mapping[str, BufferConfig] = field(default_factory=dict)
    bit_error_rate: float = 0.0
    recovery: float = 0.0

    def buffer_of(self, name: str) -> BufferConfig:
        """Return the buffer of a station."""
        return self.buffers.get(name, self.buffer)
