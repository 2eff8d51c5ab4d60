"""`hil-bench run --lockstep`: bench time is the controller's count of SYNCs."""

import argparse
import contextlib
import logging
import math
from collections.abc import Iterator

from hil_bench.abilities.controllers.process.hosted_bus import HostedBus
from hil_bench.abilities.hub.hosting import fd_speedups, hub_channels, join_lines
from hil_bench.abilities.lockstep.lockstep import LockStep, LockStepReport, run_lockstep
from hil_bench.bench.bench import Bench
from hil_bench.bench.configuration import BenchConfig
from hil_bench.cli import status_line
from hil_bench.cli.arguments import load_bench_config
from hil_bench.cli.bench_events import BenchEvents
from hil_bench.cli.exit_codes import Ending
from hil_bench.cli.helpers import Helpers
from hil_bench.cli.paced_run import event_lines, frame_lines, helper_lines, node_lines
from hil_bench.cli.run_setup import (
    OpenBus,
    RunSetup,
    common_content,
    open_bus,
    set_up,
    watched_run,
)
from hil_bench.errors import ConfigError
from hil_bench.outside.bits import USUAL_BITRATE
from hil_bench.outside.helper_process import Snapshot
from hil_bench.outside.realtime.clock import Clock, MonotonicClock
from hil_bench.outside.recording.channels import Channel
from hil_bench.outside.transports.transport import Transport

# The status lines of a bench in lock-step.

_PROGRESS = {
    Channel("bench_time", "s"): status_line.Field("{:.1f} s of bench time", 1.0),
    Channel("speed", "-"): status_line.Field("{:.1f} times real time", 1.0),
    Channel("received", "-"): status_line.Field("in {:.0f}", 1.0),
    Channel("sent", "-"): status_line.Field("out {:.0f}", 1.0),
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
        channels, fields = status_line.bench_status(bench)
        self.snapshot = Snapshot(len(channels) + len(_PROGRESS))
        self.lines = (fields, tuple(_PROGRESS.values()))
        self._bench = bench
        self._lockstep = lockstep
        self._transport = transport
        self._clock = clock
        self._then, self._bench_then = clock.now(), lockstep.now

    def update(self) -> None:
        """Write a row where the last one is old enough; to be called often."""
        if self._clock.now() - self._then >= status_line.REFRESH * 1e9:
            self.snapshot.write(self._next_row())

    def texts(self) -> list[str]:
        """Return the lines as they are now; the speed is that since the last ones."""
        return status_line.format_lines(self._next_row(), self.lines)

    def _next_row(self) -> tuple[float, ...]:
        now, bench_time, counters = (
            self._clock.now(),
            self._lockstep.now,
            self._transport.counters(),
        )
        speed = (bench_time - self._bench_then) / max(1, now - self._then)
        progress = (bench_time * 1e-9, speed, counters.received, counters.sent)
        self._then, self._bench_then = now, bench_time
        return (*status_line.bench_status_row(self._bench), *progress)


logger = logging.getLogger(__name__)


def run(args: argparse.Namespace) -> int:
    """Run the bench by a controller's SYNCs, print the summary and return the exit code.

    The nodes boot in a tick at time 0; the first SYNC begins the first period after it.

    Raises:
        ConfigError: a part of the bench serves others in real time.
    """
    config = load_bench_config(args)
    for part in config.parts:
        if part.real_time_only:
            raise ConfigError(f"--lockstep: {part.real_time_only}, or --lockstep")
    opens = open_bus if args.hub is None else host_bus
    with set_up(args, config, is_real_time=False, open_buses=opens) as setup:
        announce = setup.announcement()
        setup.session.start()
        setup.bus.transport.send(setup.session.tick((), 0))
        announce()
        report, helpers = follow(setup)
    lines = summary_lines(report, config, setup.session.bench) + setup.companion_lines()
    lines += helper_lines(helpers.lines())
    content = lockstep_content(report, setup, helpers)
    return setup.finish(Ending(args), helpers, report.lost, lines, content)


@contextlib.contextmanager
def host_bus(args: argparse.Namespace, config: BenchConfig) -> Iterator[OpenBus]:
    """Host the buses of the configuration in this process, which waits for nobody in real time.

    Yields:
        The buses.
    """
    channels = hub_channels(config)
    hosted = HostedBus(port=args.hub, channels=list(channels.values()), fd=fd_speedups(config))
    with contextlib.closing(hosted):
        lines = (f"bus    {hosted.description}", *join_lines(channels, hosted.host, hosted.port))
        yield OpenBus(hosted, {"bus": hosted}, lines, (), USUAL_BITRATE * len(channels))


def follow(setup: RunSetup) -> tuple[LockStepReport, Helpers]:
    """Let SYNC move a bench that has booted until somebody wants the end, or `--duration`.

    Returns:
        What the run did, and the processes beside it.
    """
    config, bench, transport = setup.config, setup.session.bench, setup.bus.transport
    lockstep = LockStep(setup.session, tick_ns=config.tick_ns, ticks_per_sync=config.ticks_per_sync)
    status = LockStepStatus(bench, lockstep, transport, MonotonicClock())
    line = status_line.StatusLine(status.snapshot, status.lines, wanted=not setup.args.quiet)
    progress = status_line.Progress(logger.warning, lambda _now: status.texts())
    events = BenchEvents(config, bench, logger.warning, watches_sync=False)
    duration = setup.args.duration
    end = math.inf if duration is None else round(duration * 1e9)
    shown = [line] if line.is_shown else []
    helpers = setup.watch(*shown)

    def is_over() -> bool:
        if line.is_shown:
            status.update()
        else:
            progress.look(lockstep.now)
        helpers.look()
        events.look(lockstep.now)
        if look is not None:
            look()
        is_wished = setup.wish.requested or setup.session.controls.is_over
        return is_wished or helpers.is_over or lockstep.now >= end

    def health() -> dict[str, float]:
        counters = transport.counters()
        return {"received": counters.received, "sent": counters.sent, "syncs": lockstep.syncs}

    watched = watched_run(setup.args, config, setup.session, health=health)
    with line, contextlib.closing(helpers), watched as look:
        return run_lockstep(lockstep, transport, stopped=is_over), helpers


def speed_line(report: LockStepReport, config: BenchConfig) -> str:
    """Return the time that the bench covered, and its speed once the controller had begun."""
    bench_time = report.now * 1e-9
    speed = f", {bench_time / report.moved:.1f} times real time" if report.moved > 0.0 else ""
    return (
        f"lockstep  {report.syncs} SYNCs of {config.sync_period_ns / 1000:g} us: "
        f"{bench_time:.3f} s in {report.moved:.2f} s{speed}"
    )


def summary_lines(report: LockStepReport, config: BenchConfig, bench: Bench) -> list[str]:
    """Return the summary at the end of a run in lock-step."""
    return [
        "summary",
        speed_line(report, config),
        *frame_lines(report.frames, bench.unrouted),
        *event_lines(bench),
        *node_lines(config, bench),
    ]


def lockstep_content(
    report: LockStepReport, setup: RunSetup, helpers: Helpers
) -> dict[str, object]:
    """Return the figures of a run in lock-step.

    Args:
        report: of the run.
        setup: the bench, and what was open around it.
        helpers: the processes beside the loop.
    """
    return {
        "bench_time": report.now * 1e-9,
        "wall_time": report.moved,
        "syncs": report.syncs,
        "sync_period": setup.config.sync_period_ns * 1e-9,
        **common_content(report.frames, report.lost, setup, helpers),
    }
