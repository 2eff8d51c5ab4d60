"""The status lines of a bench in lock-step."""

from hil_bench.bench.bench import Bench
from hil_bench.cli.status_line import (
    REFRESH,
    Field,
    bench_status,
    bench_status_row,
    format_lines,
)
from hil_bench.outside.processes.snapshot import Snapshot
from hil_bench.outside.realtime.clock import Clock
from hil_bench.outside.recording.channels import Channel
from hil_bench.outside.transports.transport import Transport
from hil_bench.session.lockstep import LockStep

_PROGRESS = {
    Channel("bench_time", "s"): Field("{:.1f} s of bench time", 1.0),
    Channel("speed", "-"): Field("{:.1f} times real time", 1.0),
    Channel("received", "-"): Field("in {:.0f}", 1.0),
    Channel("sent", "-"): Field("out {:.0f}", 1.0),
}


class LockStepStatus:
    """A snapshot of the axes, and of how far and how fast the bench goes.

    Args:
        bench: the bench.
        lockstep: what moves it.
        transport: its bus.
        clock: the machine's clock.

    Attributes:
        snapshot: for another process.
        lines: how it is shown.
    """

    def __init__(
        self, bench: Bench, lockstep: LockStep, transport: Transport, clock: Clock
    ) -> None:
        channels, fields = bench_status(bench)
        self.snapshot = Snapshot(len(channels) + len(_PROGRESS))
        self.lines = (fields, tuple(_PROGRESS.values()))
        self._bench = bench
        self._lockstep = lockstep
        self._transport = transport
        self._clock = clock
        self._then, self._bench_then = clock.now(), lockstep.now

    def update(self) -> None:
        """Write a row where the last one is old enough; to be called often."""
        if self._clock.now() - self._then >= REFRESH * 1e9:
            self.snapshot.write(self._next_row())

    def texts(self) -> list[str]:
        """Return the lines as they are now; the speed is that since the last ones."""
        return format_lines(self._next_row(), self.lines)

    def _next_row(self) -> tuple[float, ...]:
        now, bench_time, counters = (
            self._clock.now(),
            self._lockstep.now,
            self._transport.counters(),
        )
        speed = (bench_time - self._bench_then) / max(1, now - self._then)
        progress = (bench_time * 1e-9, speed, counters.received, counters.sent)
        self._then, self._bench_then = now, bench_time
        return (*bench_status_row(self._bench), *progress)
