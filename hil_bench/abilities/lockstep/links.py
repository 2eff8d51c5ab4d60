"""The time base of a bench whose controller is another program on a bus.

In lock-step the controller's SYNC does; in real time the clock does, and the controller keeps up.
Both are the same to who waits: `advance` returns when bench time has come to a moment.
"""

from collections.abc import Callable
from operator import methodcaller
from typing import Protocol

from hil_bench.abilities.lockstep.lockstep import LockStep, LockStepBus
from hil_bench.errors import HilBenchError
from hil_bench.outside.realtime.clock import Clock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.transports.transport import Transport
from hil_bench.session.paced import frames_per_tick
from hil_bench.session.program import USUAL_PATIENCE, Patience, Silence
from hil_bench.session.session import Session
from hil_bench.session.virtual_bench import VirtualBench

# Of an error that says what a test's controller did wrong, pytest shows the test's own line.
__tracebackhide__ = methodcaller("errisinstance", HilBenchError)


class ControllerLink(Protocol):
    """A bench and its controller on one bus."""

    @property
    def now(self) -> int:
        """The bench time [ns]."""

    def step(self) -> bool:
        """Let a little happen, at most one tick or period; return whether frames came."""

    def drain(self) -> None:
        """Answer what has arrived already, without waiting for more."""


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
        """Take the next frame; return whether one came within `transport.PATIENCE`.

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


def join(
    bench: VirtualBench,
    transport: Transport,
    *,
    pacer: Pacer | None = None,
    patience: Patience = USUAL_PATIENCE,
    check: Callable[[], None],
) -> ControllerLink:
    """Put a bench on a bus where another program controls it, in place of its own `buses`.

    From now on bench time passes in `run` and `run_until` as before, and in the link's `step`: by
    that program's SYNC, `config.sync_period_ns` each; or by the clock where there is a pacer.

    Args:
        bench: it.
        transport: the bus, or a `JoinedTransport`; it stays the caller's.
        pacer: paces the bench in real time; None is lock-step.
        patience: with a controller in lock-step.
        check: called in `run` and `run_until` when nothing came from the bus; raises where nothing
            will come any more.

    Returns:
        Bench and bus as one.
    """
    bench.leave_buses(lambda duration: advance(link, round(duration * 1e9), check))
    session, config = bench.session, bench.config
    if not session.now:
        transport.send(session.tick((), 0))  # all boot
    link: ControllerLink
    if pacer is None:
        lockstep = LockStep(session, tick_ns=config.tick_ns, ticks_per_sync=config.ticks_per_sync)
        link = LockStepLink(lockstep, transport, patience)
    else:
        link = RealTimeLink(session, transport, pacer)
    return link
