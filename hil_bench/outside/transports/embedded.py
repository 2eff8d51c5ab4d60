"""Buses inside the process with the bench at their other end, for the demo and for tests."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, NoReturn, Protocol

import can

from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.messages import frame_of, message_of

Tick = Callable[[Sequence[Frame], int], Sequence[Frame]]
"""The bench: received frames and the time [ns] in, frames to send out."""

FrameHook = Callable[[Frame, int], None]
"""Told each frame on the bus and its time [ns]."""

LONGEST_WAIT = 60_000_000_000
"""Bench time [ns] after which `recv(None)` gives up."""

_NS_PER_S = 1_000_000_000


class Pace(Protocol):
    """A pace that holds ticks back to real time, as `hil_bench.outside.realtime.pacer.Pacer`."""

    def wait(self) -> int:
        """Return when the next tick may start."""

    def done(self) -> None:
        """Take note that the tick is over."""


class Medium(Protocol):
    """Buses on which frames take time, as `hil_bench.bench.bench.Medium`."""

    def takes(self, frame: Frame) -> bool:
        """Return True if a frame is put here; others wait for the next tick."""

    def put(self, frame: Frame, now: int) -> bool:
        """Have the user want to send a frame from now on [ns]; return whether it had room."""

    def next_frame(self, until: int) -> tuple[Frame, int] | None:
        """Return the next frame that passes, and when [ns]; None where none does until then."""


class _BenchTime:
    """A bench and its time, which the users of all its buses let pass.

    Args:
        tick: the bench's tick.
        period: time between ticks [ns].
        start: bench time at which the buses begin [ns].
        pacer: holds each tick back until it is due; without one, ticks follow at once.
        on_frame: told every frame, both ways.
        medium: those of its buses on which frames take time.

    Attributes:
        now: bench time [ns].
        to_bench: frames for the next tick, oldest first.
        readers: where frames from the bench go, by the number of their bus.
        on_first_wait: called before somebody waits or reads for the first time.
    """

    def __init__(
        self,
        tick: Tick,
        period: int,
        start: int,
        pacer: Pace | None,
        on_frame: FrameHook | None,
        medium: Medium | None = None,
    ) -> None:
        self.now = start
        self.to_bench: list[Frame] = []
        self.on_first_wait: Callable[[], None] | None = None
        self.readers: list[Callable[[Frame, int | None], None]] = []
        self._medium = medium
        self._tick = tick
        self._period = period
        self._next_tick = start + period
        self._pacer = pacer
        self._on_frame = on_frame

    def send(self, frame: Frame) -> None:
        """Queue a frame for the next tick, or put it on the bus where it takes time there.

        Raises:
            can.CanOperationError: the transmission buffer is full.
        """
        if self._medium is None or not self._medium.takes(frame):
            self.to_bench.append(frame)
        elif not self._medium.put(frame, self.now):
            raise can.CanOperationError("the transmission buffer is full")
        if self._on_frame is not None:
            self._on_frame(frame, self.now)

    def begin(self, start: int) -> None:
        """Let time begin at another moment [ns], before it has passed."""
        self.now, self._next_tick = start, start + self._period

    def look(self) -> None:
        """Take note that somebody waits or reads."""
        if self.on_first_wait is not None:
            first, self.on_first_wait = self.on_first_wait, None
            first()

    def pass_until(self, deadline: int, is_over: Callable[[], object]) -> bool:
        """Run ticks until `is_over` (True) or the deadline [ns] has come (False)."""
        while self._next_tick <= deadline:
            if self._medium is not None and self._hear(self._medium, self._next_tick, is_over):
                return True
            self._run_tick()
            if is_over():
                return True
        if self._medium is not None and self._hear(self._medium, deadline, is_over):
            return True
        self.now = max(self.now, deadline)
        return False

    def _hear(self, medium: Medium, until: int, is_over: Callable[[], object]) -> bool:
        """Hand out what passes until then [ns], or until `is_over`; return whether it is."""
        while (passed := medium.next_frame(until)) is not None:
            frame, self.now = passed
            if self._on_frame is not None:
                self._on_frame(frame, self.now)
            self.readers[frame.bus](frame, self.now)
            if is_over():
                return True
        return False

    def _run_tick(self) -> None:
        """Advance to the next tick, hand it what was sent, and hand out what it sends."""
        if self._pacer is not None:
            self._pacer.wait()
        now = self.now = self._next_tick
        self._next_tick = now + self._period
        received, self.to_bench = self.to_bench, []
        for frame in self._tick(received, now):
            if self._on_frame is not None:
                self._on_frame(frame, now)
            self.readers[frame.bus](frame, None)
        if self._pacer is not None:
            self._pacer.done()


class EmbeddedPort(can.BusABC):
    """The user's end of one bus of a bench in the same thread.

    Args:
        time: of the bench.
        can_filters: as for every python-can bus.
        fd: whether it carries CAN FD, too.

    Attributes:
        number: of this bus among those of the bench.
    """

    def __init__(
        self,
        time: _BenchTime,
        can_filters: can.typechecking.CanFilters | None = None,
        *,
        fd: bool = False,
    ) -> None:
        self._time = time
        self._to_reader: deque[tuple[Frame, int | None]] = deque()
        self.number = len(time.readers)
        self._name = f"embedded{self.number or ''}"
        self.channel_info = f"{self._name} bench"
        time.readers.append(self._take)
        super().__init__(channel=self._name, can_filters=can_filters)
        self._can_protocol = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20

    def now(self) -> float:
        """Return the bench time [s]."""
        return self._time.now / _NS_PER_S

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 - BusABC's
        """Queue a message for the next tick.

        Raises:
            can.CanOperationError: this is no frame, or one of CAN FD on a classical bus, or the
                bus is shut down.
        """
        self._check_open()
        frame = frame_of(msg)
        if frame is None:
            raise can.CanOperationError(f"no CAN data or remote frame: {msg}")
        if frame.fd and self.protocol is not can.CanProtocol.CAN_FD:
            right = "fd = true in bench.toml makes it CAN FD"
            raise can.CanOperationError(f"{self._name}: the bus is classical CAN; {right}")
        self._time.send(frame._replace(bus=self.number) if self.number else frame)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next message, letting bench time pass until there is one.

        Overridden as a whole, since `BusABC.recv` measures its time-out on the wall clock.

        Args:
            timeout: bench time [s] to wait; 0 takes what is there, without a tick.

        Returns:
            The message, its time stamp in bench time [s], or None when the time-out has passed. On
            a bus of copper that is when it had passed, otherwise when it was taken.

        Raises:
            can.CanTimeoutError: `timeout` is None and no frame came for `LONGEST_WAIT`.
        """
        self._check_open()
        self._time.look()
        # Rounded up: a wait that is not over must move the time, or a caller's loop never ends.
        wait = LONGEST_WAIT if timeout is None else math.ceil(timeout * _NS_PER_S)
        if not self._to_reader and not self._wait(wait):
            if timeout is None:
                raise can.CanTimeoutError(f"no frame in {wait // _NS_PER_S} s of bench time")
            return None
        frame, time = self._to_reader.popleft()
        message = message_of(frame)
        message.timestamp = self.now() if time is None else time / _NS_PER_S
        message.channel = self._name
        return message

    def advance(self, duration: float) -> None:
        """Let bench time pass; what arrives meanwhile waits for `recv`.

        Args:
            duration: bench time [s].
        """
        self._check_open()
        self._time.look()
        self._time.pass_until(self._time.now + round(duration * _NS_PER_S), lambda: False)

    def shutdown(self) -> None:
        """End the use of the bus; a second call does nothing."""
        super().shutdown()
        self._time.to_bench = [f for f in self._time.to_bench if f.bus != self.number]
        self._to_reader.clear()

    def _check_open(self) -> None:
        """Refuse the use of a bus that is shut down.

        Raises:
            can.CanOperationError: it is.
        """
        if self._is_shutdown:
            raise can.CanOperationError("the embedded bus is shut down")

    def _wait(self, duration: int) -> bool:
        """Let time pass [ns] until a frame is there; return whether one is."""
        return self._time.pass_until(self._time.now + duration, lambda: self._to_reader)

    def _take(self, frame: Frame, time: int | None) -> None:
        """Keep a frame where the reader asked for it, with the time at which it had passed [ns]."""
        if self._filters is None or self._matches_filters(message_of(frame)):
            self._to_reader.append((frame, time))

    def _apply_filters(self, filters: can.typechecking.CanFilters | None) -> None:
        """Take filters as they are: `_take` asks `_matches_filters`."""

    def _send_periodic_internal(self, *_args: Any, **_kwargs: Any) -> NoReturn:  # noqa: ANN401 - BusABC's
        raise can.CanOperationError(
            "the embedded bus has no time of its own: send from the loop that waits in recv"
        )


class EmbeddedBus(EmbeddedPort):
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
        medium: those buses of the bench on which frames take time: they pass them in their time, to
            the bit, and a wait may end between two ticks.
        fd: whether the bus carries CAN FD, too.

    Raises:
        ValueError: the period is not positive.
    """

    def __init__(  # noqa: PLR0913 - each with a meaning of its own
        self,
        tick: Tick,
        period_ns: int = 1_000_000,
        *,
        start_ns: int = 0,
        pacer: Pace | None = None,
        on_frame: FrameHook | None = None,
        can_filters: can.typechecking.CanFilters | None = None,
        description: str = "embedded bench",
        medium: Medium | None = None,
        fd: bool = False,
    ) -> None:
        if period_ns <= 0:
            raise ValueError(f"tick period {period_ns} ns: a positive number is right")
        time = _BenchTime(tick, period_ns, start_ns, pacer, on_frame, medium)
        super().__init__(time, can_filters, fd=fd)
        self.channel_info = description

    def begin_later(self, wait: Callable[[], int] | None) -> None:
        """Let time begin when somebody waits or reads for the first time.

        Args:
            wait: called then; returns at which bench time the buses begin [ns]. None lets time
                begin now.
        """
        time = self._time
        time.on_first_wait = None if wait is None else lambda: time.begin(wait())

    def hear(self, frames: Sequence[Frame]) -> None:
        """Keep frames that passed before the user came, for `recv`."""
        for frame in frames:
            self._time.readers[frame.bus](frame, None)

    def take_sent(self) -> list[Frame]:
        """Take back what waits for the next tick."""
        sent, self._time.to_bench = self._time.to_bench, []
        return sent

    def make_further(self, *, fd: bool = False) -> EmbeddedPort:
        """Return the next bus of the same bench; waiting on either lets time pass for both."""
        return EmbeddedPort(self._time, fd=fd)
