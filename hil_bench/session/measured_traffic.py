"""What a bench in virtual time puts on a bus, and how long each frame waits there."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from hil_bench.bench.configuration import BenchConfig
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NMT_COB_ID, NmtCommand
from hil_bench.outside.wire.arbitration import Arbiter, Sent
from hil_bench.session.session import open_session

_NS_PER_S = 1_000_000_000


@dataclass(slots=True)
class MeasuredTraffic:
    """What passed a simulated bus.

    Attributes:
        worst: longest time from a frame's release to the bus being free again [ns], by identifier.
        counts: frames by identifier.
        busy: time that frames were on the bus [ns].
        waiting: frames that had not been sent at the end.
    """

    worst: dict[int, int] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    busy: int = 0
    waiting: int = 0

    def take(self, sent: Sequence[Sent]) -> None:
        """Count what was sent."""
        for each in sent:
            can_id = each.frame.can_id
            self.counts[can_id] = self.counts.get(can_id, 0) + 1
            self.worst[can_id] = max(self.worst.get(can_id, 0), each.end - each.released)
            self.busy += each.end - each.begin


def measure_traffic(
    config: BenchConfig, commands: Sequence[Frame], *, cycle: int, bitrate: int, duration: int
) -> MeasuredTraffic:
    """Run a bench whose controller starts all nodes and sends the same frames in each cycle.

    The frames of a tick are released at its time, and go by arbitration, to the bit.

    Args:
        config: a bench on one bus.
        commands: what the controller sends in each cycle: SYNC and RPDOs.
        cycle: of the controller [ns].
        bitrate: of the bus [bit/s].
        duration: how long [ns].
    """
    session, arbiter, found = open_session(config), Arbiter(bitrate), MeasuredTraffic()

    def take(received: Sequence[Frame], sent: Sequence[Frame], now: int) -> None:
        found.take(arbiter.run(now))
        for frame in (*received, *sent):
            arbiter.release(frame, now)

    session.start()
    boot = config.tick_ns * 10
    for now in range(0, boot, config.tick_ns):
        session.tick((), now)
    session.watch(frames=take)
    start = Frame(NMT_COB_ID, bytes((NmtCommand.START, 0)))
    due = boot
    for now in range(boot, boot + duration, config.tick_ns):
        frames = [start] if now == boot else []
        if now >= due:
            due += cycle
            frames += commands
        session.tick(frames, now)
    end = boot + duration
    found.take(arbiter.run(end))
    found.waiting = arbiter.waiting
    return found
