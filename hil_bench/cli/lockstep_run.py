"""`hil-bench run --lockstep`: bench time is the controller's count of SYNCs."""

import argparse
import contextlib
import logging
import math

from hil_bench.bench.bench import Bench
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.configuration.records import Serving
from hil_bench.cli.arguments import load_bench_config
from hil_bench.cli.bench_events import BenchEvents
from hil_bench.cli.exit_codes import Ending
from hil_bench.cli.feed_side import open_feed
from hil_bench.cli.helpers import Helpers
from hil_bench.cli.lockstep_status import LockStepStatus
from hil_bench.cli.loop_summary import fault_lines, frame_lines, helper_lines, node_lines
from hil_bench.cli.progress import Progress
from hil_bench.cli.recording_arguments import recording_lines
from hil_bench.cli.run_content import lockstep_content
from hil_bench.cli.run_setup import RunSetup, set_up
from hil_bench.cli.status_line import StatusLine
from hil_bench.errors import ConfigError
from hil_bench.outside.realtime.clock import MonotonicClock
from hil_bench.session.lockstep import LockStep, LockStepReport, run_lockstep

logger = logging.getLogger(__name__)


def run(args: argparse.Namespace) -> int:
    """Run the bench by a controller's SYNCs, print the summary and return the exit code.

    The nodes boot in a tick at time 0; the first SYNC begins the first period after it.

    Raises:
        ConfigError: a part of the bench serves others in real time.
    """
    config = load_bench_config(args, modbus=args.modbus)
    for part in config.parts:
        if isinstance(part, Serving):
            raise ConfigError(f"--lockstep: {part.no_lockstep}")
    with set_up(args, config, is_real_time=False) as setup:
        announce = setup.announcement()
        setup.session.start()
        setup.bus.transport.send(setup.session.tick((), 0))
        announce()
        report, helpers = follow(setup)
    lines = summary_lines(report, config, setup.session.bench) + recording_lines(setup.recording)
    lines += helper_lines(helpers.lines())
    content = lockstep_content(report, setup, helpers)
    return setup.finish(Ending(args), helpers, report.lost, lines, content)


def follow(setup: RunSetup) -> tuple[LockStepReport, Helpers]:
    """Let SYNC move a bench that has booted until somebody wants the end, or `--duration`.

    Returns:
        What the run did, and the processes beside it.
    """
    config, bench, transport = setup.config, setup.session.bench, setup.bus.transport
    lockstep = LockStep(setup.session, tick_ns=config.tick_ns, ticks_per_sync=config.ticks_per_sync)
    status = LockStepStatus(bench, lockstep, transport, MonotonicClock())
    line = StatusLine(status.snapshot, status.lines, wanted=not setup.args.quiet)
    progress = Progress(logger.warning, lambda _now: status.texts())
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
        if feed is not None:
            feed.look()
        is_wished = setup.wish.requested or setup.session.controls.is_over
        return is_wished or helpers.is_over or lockstep.now >= end

    def health() -> dict[str, float]:
        counters = transport.counters()
        return {"received": counters.received, "sent": counters.sent, "syncs": lockstep.syncs}

    opened = open_feed(setup.args, config, setup.session, health=health)
    with line, contextlib.closing(helpers), opened as feed:
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
        *fault_lines(bench),
        *node_lines(config, bench),
    ]
