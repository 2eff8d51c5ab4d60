"""Lock-step: each SYNC of the controller moves the bench on by one period, and nothing else does.

Frames are taken one by one, in the order of the bus. A SYNC runs the ticks of one period, the first
of which takes it; any other frame is served at once, while time stands still. What the bench sends
is thus a function of what it received, and of nothing else: neither the speed of the two processes
nor how the bus bundles their frames can change it.
"""

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import BusError
from hil_bench.transports.transport import Transport, TransportCounters

SYNC_COB_ID = 0x080
"""Identifier of SYNC in the predefined connection set (CiA 301)."""

PATIENCE = 0.1
"""Longest wait for a frame before `stopped` is asked again [s]."""

FRAMES_AT_ONCE = 64
"""Most frames taken from the bus before the bus is asked again."""

Round = Callable[[Sequence[Frame], int], Sequence[Frame]]
"""A bench's `tick` or `serve`: received frames and the time [ns] in, frames to send out."""


class LockStep:
    """A bench whose time is counted in SYNCs: frame in, frames out.

    Args:
        tick: the bench's tick.
        serve: the bench's answers while time stands still.
        tick_ns: period of a tick [ns].
        ticks_per_sync: ticks that each SYNC runs, one or more.
        now: time of the last tick [ns].

    Attributes:
        now: time of the last tick [ns].
        syncs: SYNCs so far.
    """

    def __init__(
        self, tick: Round, serve: Round, *, tick_ns: int, ticks_per_sync: int = 1, now: int = 0
    ) -> None:
        self.now = now
        self.syncs = 0
        self._tick = tick
        self._serve = serve
        self._tick_ns = tick_ns
        self._ticks_per_sync = ticks_per_sync

    def receive(self, frame: Frame) -> list[Frame]:
        """Take the next frame of the bus; return all that the bench has to say to it, in order."""
        is_sync = frame.can_id == SYNC_COB_ID and not (frame.is_remote or frame.is_extended)
        if not is_sync:
            return list(self._serve((frame,), self.now))
        self.syncs += 1
        sent: list[Frame] = []
        received: tuple[Frame, ...] = (frame,)
        for _ in range(self._ticks_per_sync):
            self.now += self._tick_ns
            sent += self._tick(received, self.now)
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


@dataclass(frozen=True, slots=True)
class LockStepReport:
    """What a run in lock-step did.

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
    lost: BusError | None


def run_lockstep(
    lockstep: LockStep, transport: Transport, *, stopped: Callable[[], bool]
) -> LockStepReport:
    """Serve the bus until `stopped` says so; a lost bus ends the run too, and the report says why.

    Args:
        lockstep: the bench, powered on.
        transport: the bus; it stays open, and must let SYNC through.
        stopped: asked after each frame, and at least every `PATIENCE` seconds.
    """
    bus = LockStepBus(lockstep, transport)
    lost = None
    started = ended = time.perf_counter()
    syncs = lockstep.syncs
    try:
        while not stopped():
            bus.step()
            if lockstep.syncs != syncs:
                ended = time.perf_counter()
                started = started if syncs else ended
                syncs = lockstep.syncs
    except BusError as error:
        lost = error
    return LockStepReport(lockstep.now, lockstep.syncs, ended - started, transport.counters(), lost)
