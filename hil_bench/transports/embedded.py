"""A bus inside the process with the bench at its other end, for the demo and for tests."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, NoReturn, Protocol

import can

from hil_bench.canopen_device.frame import Frame
from hil_bench.transports.python_can import frame_of, message_of

Tick = Callable[[Sequence[Frame], int], Sequence[Frame]]
"""The bench: received frames and the time [ns] in, frames to send out."""

FrameHook = Callable[[Frame, int], None]
"""Told each frame on the bus and its time [ns]."""

LONGEST_WAIT = 60_000_000_000
"""Bench time [ns] after which `recv(None)` gives up."""

_NS_PER_S = 1_000_000_000


class Pace(Protocol):
    """What holds the ticks back to real time: `hil_bench.realtime.pacer.Pacer`."""

    def wait(self) -> int:
        """Return when the next tick may start."""

    def done(self) -> None:
        """Take note that the tick is over."""


class EmbeddedBus(can.BusABC):
    """A `can.BusABC` whose other end is a bench in the same thread.

    Bench time advances only while the user waits in `recv`: each wait runs ticks, at
    start + k * period for k = 1, 2, ..., until a frame is there or the time-out has passed. Sent
    frames reach the bench with the next tick. Nothing runs beside the user, so nothing races, and
    the same calls give the same frames at the same bench times, paced or not.

    Args:
        tick: the bench's tick.
        period_ns: time between ticks [ns].
        start_ns: bench time [ns] at which the bus begins.
        pacer: holds each tick back until it is due; without one, ticks follow at once.
        on_frame: told every frame, both ways, in the order of their bench times.
        can_filters: as for every python-can bus.
        description: the bus in words, for messages.

    Raises:
        ValueError: the period is not positive.
    """

    def __init__(
        self,
        tick: Tick,
        period_ns: int = 1_000_000,
        *,
        start_ns: int = 0,
        pacer: Pace | None = None,
        on_frame: FrameHook | None = None,
        can_filters: can.typechecking.CanFilters | None = None,
        description: str = "embedded bench",
    ) -> None:
        if period_ns <= 0:
            raise ValueError(f"tick period {period_ns} ns: a positive number is right")
        self.channel_info = description
        self._tick = tick
        self._period = period_ns
        self._pacer = pacer
        self._on_frame = on_frame
        self._now = start_ns
        self._next_tick = start_ns + period_ns
        self._to_bench: list[Frame] = []
        self._to_reader: deque[Frame] = deque()
        super().__init__(channel="embedded", can_filters=can_filters)

    def now(self) -> float:
        """Return the bench time [s]."""
        return self._now / _NS_PER_S

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 - BusABC's
        """Queue a message for the next tick.

        Raises:
            can.CanOperationError: the bus is shut down, or this is no classical CAN frame.
        """
        if self._is_shutdown:
            raise can.CanOperationError("the embedded bus is shut down")
        frame = frame_of(msg)
        if frame is None:
            raise can.CanOperationError(f"no classical CAN data or remote frame: {msg}")
        self._to_bench.append(frame)
        if self._on_frame is not None:
            self._on_frame(frame, self._now)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next message, letting bench time pass until there is one.

        Overridden as a whole, since `BusABC.recv` measures its time-out on the wall clock.

        Args:
            timeout: bench time [s] to wait; 0 takes what is there, without a tick.

        Returns:
            The message, its time stamp in bench time [s], or None when the time-out has passed.

        Raises:
            can.CanOperationError: the bus is shut down.
            can.CanTimeoutError: `timeout` is None and no frame came for `LONGEST_WAIT`.
        """
        if self._is_shutdown:
            raise can.CanOperationError("the embedded bus is shut down")
        # Rounded up: a wait that is not over must move the time, or a caller's loop never ends.
        wait = LONGEST_WAIT if timeout is None else math.ceil(timeout * _NS_PER_S)
        if not self._to_reader and not self._run_until(self._now + wait):
            if timeout is None:
                raise can.CanTimeoutError(f"no frame in {wait // _NS_PER_S} s of bench time")
            return None
        message = message_of(self._to_reader.popleft())
        message.timestamp = self._now / _NS_PER_S
        message.channel = "embedded"
        return message

    def advance(self, duration: float) -> None:
        """Let bench time pass; what arrives meanwhile waits for `recv`.

        Args:
            duration: bench time [s].

        Raises:
            can.CanOperationError: the bus is shut down.
        """
        if self._is_shutdown:
            raise can.CanOperationError("the embedded bus is shut down")
        deadline = self._now + round(duration * _NS_PER_S)
        while self._next_tick <= deadline:
            self._run_tick()
        self._now = max(self._now, deadline)

    def shutdown(self) -> None:
        """End the use of the bus; a second call does nothing."""
        super().shutdown()
        self._to_bench.clear()
        self._to_reader.clear()

    def _run_until(self, deadline: int) -> bool:
        """Run ticks until a frame is there (True) or the deadline [ns] has come (False)."""
        while self._next_tick <= deadline:
            self._run_tick()
            if self._to_reader:
                return True
        self._now = max(self._now, deadline)
        return False

    def _run_tick(self) -> None:
        """Advance to the next tick, hand it what was sent, and keep what the reader asked for."""
        if self._pacer is not None:
            self._pacer.wait()
        now = self._now = self._next_tick
        self._next_tick = now + self._period
        received, self._to_bench = self._to_bench, []
        frames = self._tick(received, now)
        if self._on_frame is not None:
            for frame in frames:
                self._on_frame(frame, now)
        if self._filters is None:
            self._to_reader.extend(frames)
        else:
            self._to_reader.extend(f for f in frames if self._matches_filters(message_of(f)))
        if self._pacer is not None:
            self._pacer.done()

    def _apply_filters(self, filters: can.typechecking.CanFilters | None) -> None:
        """Take filters as they are: `_run_tick` asks `_matches_filters`."""

    def _send_periodic_internal(self, *_args: Any, **_kwargs: Any) -> NoReturn:  # noqa: ANN401 - BusABC's
        raise can.CanOperationError(
            "the embedded bus has no time of its own: send from the loop that waits in recv"
        )
