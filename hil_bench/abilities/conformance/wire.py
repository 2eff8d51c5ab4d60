"""The bus as the checks see it: raw frames out, raw frames in, on one clock."""

from collections.abc import Callable
from typing import NamedTuple

import can

from hil_bench.abilities.common.stamps import SteadyStamps
from hil_bench.abilities.conformance.verdicts import NotApplicable
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import BusError, first_line
from hil_bench.outside.messages import frame_of, message_of

Matches = Callable[[Frame], bool]
"""Whether a frame is the one that is waited for."""

_RESOLUTION = 1e-6
"""A wait shorter than this [s] is over: some buses and clocks cannot tell it from none."""

_LONGEST_INBOX = 100_000

BACKLOG = 1000
"""Frames taken when a wait is over: those that had come by then, and no flood that goes on."""


class Arrival(NamedTuple):
    """A frame that came.

    Attributes:
        frame: the frame.
        time: when it came [s]; only differences mean something.
    """

    frame: Frame
    time: float


class Wire:
    """One end of a bus.

    What arrives stays in the inbox until somebody takes it, so that an answer, an emergency message
    and a PDO may come in any order.

    Args:
        bus: any open python-can bus; it stays the caller's to shut down.
        clock: seconds on a clock that never steps back; the bus's own where its time is virtual.
    """

    def __init__(self, bus: can.BusABC, clock: Callable[[], float]) -> None:
        self.now = clock
        self._bus = bus
        self._inbox: list[Arrival] = []
        self._stamps = SteadyStamps()

    def send(self, *frames: Frame) -> None:
        """Send frames.

        Raises:
            BusError: the bus is lost.
            NotApplicable: a remote frame is among them, and the bus has none.
        """
        if not getattr(self._bus, "carries_remote", True) and any(
            each.is_remote for each in frames
        ):
            raise NotApplicable(f"{self._bus.channel_info}: this bus has no remote frames")
        try:
            for frame in frames:
                self._bus.send(message_of(frame))
        except (can.CanError, OSError) as error:
            raise BusError(f"{self._bus.channel_info}: {first_line(error)}") from error

    def take(self, matches: Matches, timeout: float) -> Arrival | None:
        """Return the first frame that matches, and remove it; None where none came in time [s]."""
        deadline = self.now() + timeout
        seen = late = 0
        while True:
            for position in range(seen, len(self._inbox)):
                if matches(self._inbox[position].frame):
                    return self._inbox.pop(position)
            seen = len(self._inbox)
            remaining = deadline - self.now()
            if remaining > _RESOLUTION:
                self._receive(remaining)
            elif late >= BACKLOG or not self._receive(0.0):
                return None
            else:
                late += 1

    def take_all(self, matches: Matches, duration: float) -> list[Arrival]:
        """Return, and remove, all that match, after waiting for the whole time [s]."""
        self.wait(duration)
        taken = [arrival for arrival in self._inbox if matches(arrival.frame)]
        self._inbox = [arrival for arrival in self._inbox if not matches(arrival.frame)]
        return taken

    def wait(self, duration: float) -> None:
        """Receive for some time [s]."""
        deadline = self.now() + duration
        while (remaining := deadline - self.now()) > _RESOLUTION:
            self._receive(remaining)
        for _ in range(BACKLOG):
            if not self._receive(0.0):
                return

    def forget(self) -> None:
        """Throw away all that has arrived."""
        self.wait(0.0)
        self._inbox.clear()

    def _receive(self, timeout: float) -> bool:
        """Put one message into the inbox; whether one came.

        Raises:
            BusError: the bus is lost.
        """
        try:
            message = self._bus.recv(timeout)
        except (can.CanError, OSError) as error:
            raise BusError(f"{self._bus.channel_info}: {first_line(error)}") from error
        if message is None:
            return False
        self._stamps.straighten(message)
        frame = frame_of(message)
        if frame is not None and not frame.fd:
            self._inbox.append(Arrival(frame, message.timestamp))
            del self._inbox[:-_LONGEST_INBOX]
        return True
