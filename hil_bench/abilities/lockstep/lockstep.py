"""Lock-step: each SYNC of the controller moves the bench on by one period, and nothing else does.

Frames are taken one by one, in the order of the bus. A SYNC runs the ticks of one period, the first
of which takes it; any other frame is served at once, while time stands still. What the bench sends
is thus a function of what it received, and of nothing else: neither the speed of the two processes
nor how the bus bundles their frames can change it. Of several buses, the SYNC of the first counts.
"""

import logging
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.sync import SYNC_COB_ID
from hil_bench.errors import BusError, ConfigError, ControllerError
from hil_bench.outside.realtime.clock import Clock, MonotonicClock
from hil_bench.outside.transports.transport import (
    FRAMES_AT_ONCE,
    PATIENCE,
    Transport,
    TransportCounters,
    outage_at_end,
)

logger = logging.getLogger(__name__)

LONG_SILENCE: Final = 5_000_000_000
"""Time without SYNC after which it is said that bench time stands still [ns]."""


class Stepped(Protocol):
    """The parts of a session that lock-step needs."""

    @property
    def bench(self) -> Any:  # noqa: ANN401 - whose `wiring` alone is asked for
        """The bench."""

    @property
    def now(self) -> int:
        """The bench time [ns]."""

    def tick(self, frames: Sequence[Frame], now: int) -> Sequence[Frame]:
        """Move the bench on by one tick; return the frames that it sends."""

    def serve(self, frames: Sequence[Frame]) -> Sequence[Frame]:
        """Let the bench answer frames while its time stands still."""


class LockStep:
    """A bench whose time is counted in SYNCs: frame in, frames out.

    Args:
        session: the bench, powered on.
        tick_ns: period of a tick [ns].
        ticks_per_sync: ticks that each SYNC runs, one or more.

    Attributes:
        session: as passed in.
        syncs: SYNCs so far.

    Raises:
        ConfigError: a bus of the bench is of copper.
    """

    def __init__(self, session: Stepped, *, tick_ns: int, ticks_per_sync: int = 1) -> None:
        if session.bench.medium is not None:
            raise ConfigError(
                "[bus.wire]: in lock-step no time passes for frames; leave the table out, or run "
                "in real or virtual time"
            )
        self.session = session
        self.syncs = 0
        self._tick_ns = tick_ns
        self._ticks_per_sync = ticks_per_sync

    @property
    def now(self) -> int:
        """The bench time [ns]."""
        return self.session.now

    def receive(self, frame: Frame) -> Sequence[Frame]:
        """Take the next frame of the bus; return all that the bench has to say to it, in order."""
        can_id, _, is_remote, is_extended, bus, fd = frame
        if can_id != SYNC_COB_ID or is_remote or is_extended or bus or fd:
            return self.session.serve((frame,))
        self.syncs += 1
        if self._ticks_per_sync == 1:
            return self.session.tick((frame,), self.session.now + self._tick_ns)
        sent: list[Frame] = []
        received: tuple[Frame, ...] = (frame,)
        for _ in range(self._ticks_per_sync):
            sent += self.session.tick(received, self.session.now + self._tick_ns)
            received = ()
        return sent


class LockStepBus:
    """A bench in lock-step on a bus.

    Args:
        lockstep: the bench, powered on.
        transport: the bus; it stays open, and must let SYNC through.
    """

    def __init__(self, lockstep: LockStep, transport: Transport) -> None:
        self.lockstep = lockstep
        self.transport = transport
        self._arrived: deque[Frame] = deque()

    def step(self, patience: float = PATIENCE) -> bool:
        """Take the next frame and answer it; return whether one came within `patience` [s]."""
        if not self._arrived:
            if not self.transport.wait(patience):
                self.transport.send(())  # what the bus did not take before: it may be waited for
                return False
            self._arrived.extend(self.transport.receive(FRAMES_AT_ONCE))
        if self._arrived:
            self.transport.send(self.lockstep.receive(self._arrived.popleft()))
        return True


class SyncWatch:
    """Says when bench time stands still because SYNC stays away, and when it is back.

    Args:
        lockstep: the bench.
        description: the bus in words.
        clock: the machine's clock.
    """

    def __init__(self, lockstep: LockStep, description: str, clock: Clock) -> None:
        self._lockstep = lockstep
        self._description = description
        self._clock = clock
        self._syncs = lockstep.syncs
        self._first = self._last = clock.now()
        self._is_told = False

    @property
    def moved(self) -> float:
        """From the first SYNC to the last on the machine's clock [s]."""
        return (self._last - self._first) * 1e-9

    def look(self) -> None:
        """Look whether SYNC has come since the last look, and say what has changed."""
        now, syncs = self._clock.now(), self._lockstep.syncs
        silence = now - self._last
        if syncs != self._syncs:
            if self._is_told:
                self._warn(f"SYNC has come after {silence * 1e-9:.1f} s; bench time goes on")
            self._first = self._first if self._syncs else now
            self._syncs, self._last, self._is_told = syncs, now, False
        elif silence >= LONG_SILENCE and not self._is_told:
            self._is_told = True
            self._warn(
                f"no SYNC (0x080) for {LONG_SILENCE * 1e-9:g} s; bench time stands still at "
                f"{self._lockstep.now * 1e-9:.3f} s, and so do time-outs and valve"
            )

    def _warn(self, what: str) -> None:
        logger.warning("%s: %s", self._description, what)


@dataclass(frozen=True, slots=True)
class LockStepReport:
    """The result of a run in lock-step.

    Attributes:
        now: bench time at its end [ns].
        syncs: SYNCs that moved the bench.
        moved: from the first of them to the last on the machine's clock [s].
        frames: what passed the bus.
        lost: why the run ended early, None where it did not.
    """

    now: int
    syncs: int
    moved: float
    frames: TransportCounters
    lost: BusError | ControllerError | None


def run_lockstep(
    lockstep: LockStep,
    transport: Transport,
    *,
    stopped: Callable[[], bool],
    clock: Clock | None = None,
) -> LockStepReport:
    """Serve the bus until `stopped` says so; a lost bus ends the run too, and the report says why.

    An interface that is down does not: it may come back. Nor does a SYNC that stays away, but it is
    said.

    Args:
        lockstep: the bench, powered on.
        transport: the bus; it stays open, and must let SYNC through.
        stopped: asked after each frame, and at least every `PATIENCE` seconds.
        clock: the machine's clock; None is the monotonic one.
    """
    bus = LockStepBus(lockstep, transport)
    watch = SyncWatch(lockstep, transport.description, clock or MonotonicClock())
    lost: BusError | ControllerError | None = None
    try:
        while not stopped():
            bus.step()
            watch.look()
    except (BusError, ControllerError) as error:
        lost = error
    return LockStepReport(
        lockstep.now,
        lockstep.syncs,
        watch.moved,
        transport.counters(),
        lost or outage_at_end(transport),
    )
