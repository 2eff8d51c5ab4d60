"""The time base of a bench whose controller is another program on a bus.

In lock-step the controller's SYNC does; in real time the clock does, and the controller keeps up.
Both are the same to who waits: `advance` returns when bench time has come to a moment.
"""

from collections.abc import Callable
from operator import methodcaller
from typing import NamedTuple, Protocol

from hil_bench.abilities.lockstep.lockstep import PATIENCE, LockStep, LockStepBus
from hil_bench.errors import ControllerError, HilBenchError
from hil_bench.outside.realtime.clock import Clock, MonotonicClock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.transports.transport import Transport
from hil_bench.session.paced import frames_per_tick
from hil_bench.session.session import Session

# Of an error that says what a test's controller did wrong, pytest shows the test's own line.
__tracebackhide__ = methodcaller("errisinstance", HilBenchError)


class Patience(NamedTuple):
    """The longest time that a controller in lock-step may send no SYNC.

    Attributes:
        longest: time after which it is given up [s].
        right: what else would be right, for the message.
    """

    longest: float = 20.0
    right: str = ""


USUAL_PATIENCE = Patience()


class ControllerLink(Protocol):
    """A bench and its controller on one bus."""

    @property
    def now(self) -> int:
        """The bench time [ns]."""

    def step(self) -> bool:
        """Let a little happen, at most one tick or period; return whether frames came."""

    def drain(self) -> None:
        """Answer what has arrived already, without waiting for more."""


class Silence:
    """The time without SYNC, which has an end.

    Args:
        patience: with the controller.
        clock: the machine's clock; None is the monotonic one.
    """

    def __init__(self, patience: Patience = USUAL_PATIENCE, clock: Clock | None = None) -> None:
        self._patience = patience
        self._clock = clock or MonotonicClock()
        self._began = 0
        self._has_come = False
        self._without_sync = 0.0

    def begin(self) -> None:
        """Begin to wait for a frame, at most `lockstep.PATIENCE`."""
        self._began = self._clock.now()

    def end(self, *, has_come: bool, has_synced: bool) -> None:
        """End the wait.

        Args:
            has_come: whether a frame came.
            has_synced: whether it was SYNC.

        Raises:
            ControllerError: no SYNC has come for as long as the patience lasts.
        """
        if has_synced:
            self._has_come, self._without_sync = False, 0.0
            return
        # At most what was waited for: a machine that was suspended is not the controller's fault.
        self._without_sync += min((self._clock.now() - self._began) * 1e-9, PATIENCE)
        self._has_come |= has_come
        if self._without_sync > self._patience.longest:
            raise ControllerError(self._standstill())

    def _standstill(self) -> str:
        what = "frames, but no SYNC (0x080)" if self._has_come else "nobody has sent a frame"
        right = "let the controller on this bus send SYNC (as producer: bit 30 of 0x1005, 0x1006)"
        return (
            f"{what} for {self._patience.longest:g} s, and without SYNC bench time stands still; "
            f"{right}{self._patience.right}"
        )


class LockStepLink:
    """A bench whose time the controller's SYNC lets pass.

    Args:
        lockstep: the bench, powered on.
        transport: the bus.
        patience: with its controller.
        clock: the machine's clock; None is the monotonic one.
    """

    def __init__(
        self,
        lockstep: LockStep,
        transport: Transport,
        patience: Patience = USUAL_PATIENCE,
        *,
        clock: Clock | None = None,
    ) -> None:
        self._lockstep = lockstep
        self._bus = LockStepBus(lockstep, transport)
        self._silence = Silence(patience, clock)

    @property
    def now(self) -> int:
        """The bench time [ns]."""
        return self._lockstep.now

    def step(self) -> bool:
        """Take the next frame; return whether one came within `lockstep.PATIENCE`.

        A `ControllerError` says that no SYNC has come for as long as its patience lasts.
        """
        syncs = self._lockstep.syncs
        self._silence.begin()
        has_come = self._bus.step()
        self._silence.end(has_come=has_come, has_synced=self._lockstep.syncs != syncs)
        return has_come

    def drain(self) -> None:
        """Answer what has arrived already, without waiting for more."""
        while self._bus.step(0.0):
            pass


class RealTimeLink:
    """A bench whose time the clock lets pass, beside a controller that keeps up with it.

    Args:
        session: the bench, powered on.
        transport: the bus.
        pacer: a new one, its grid not yet begun.
    """

    def __init__(self, session: Session, transport: Transport, pacer: Pacer) -> None:
        self._session = session
        self._transport = transport
        self._pacer = pacer
        self._limit = frames_per_tick(pacer.period)
        self._offset: int | None = None

    @property
    def now(self) -> int:
        """The bench time [ns]."""
        return self._session.now

    def step(self) -> bool:
        """Run the next tick when it is due; return whether frames had come for it."""
        scheduled = self._pacer.wait()
        if self._offset is None:
            self._offset = self.now + self._pacer.period - scheduled
        received = self._transport.receive(self._limit)
        self._session.tick(received, scheduled + self._offset, self._transport.send)
        self._pacer.done()
        return bool(received)

    def drain(self) -> None:
        """Run the next tick, which takes what has arrived."""
        self.step()


def advance(link: ControllerLink, duration: int, check: Callable[[], None]) -> None:
    """Let `duration` [ns] of bench time pass; `check` is called whenever nothing came."""
    end = link.now + duration
    while link.now < end:
        if not link.step():
            check()
