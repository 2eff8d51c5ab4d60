"""A bus with a bench in lock-step on it, in one thread."""

from collections import deque

from hil_bench.abilities.lockstep.lockstep import LockStep
from hil_bench.bench.session import open_session


class DirectLockStep:
    """The controller's transport; the bench answers while a frame is being sent.

    Args:
        config: of the bench.
        bundles: how many frames `receive` gives at most, call by call; without it, all.

    Attributes:
        bench: the bench.
        lockstep: it, moved by SYNC.
        sent: all frames of the controller.
    """

    description = "direct"

    def __init__(self, config, bundles=()):
        session = open_session(config)
        session.start()
        self.bench = session.bench
        self.lockstep = LockStep(
            session, tick_ns=config.tick_ns, ticks_per_sync=config.ticks_per_sync
        )
        self.sent = []
        self._bundles = iter(bundles)
        self._arrived = deque(session.tick((), 0))
        self._clock = 0.0

    def clock(self):
        """The time of the machine, which passes in vain waits [s]."""
        return self._clock

    def wait(self, timeout):
        if not self._arrived:
            self._clock += timeout
        return bool(self._arrived)

    def receive(self, limit):
        count = min(next(self._bundles, limit), limit, len(self._arrived))
        return [self._arrived.popleft() for _ in range(count)]

    def send(self, frames):
        for frame in frames:
            self.sent.append(frame)
            self._arrived.extend(self.lockstep.receive(frame))

    def put(self, frame):
        """Let a frame come that nothing has brought."""
        self._arrived.append(frame)

    def close(self):
        pass
