"""`hil-bench run --lockstep`: bench time is the controller's count of SYNCs."""

import argparse
import math
from collections.abc import Callable

from hil_bench.bench import Bench
from hil_bench.cli.lockstep_status import LockStepStatus
from hil_bench.cli.loop_summary import fault_lines, frame_lines, node_lines
from hil_bench.cli.recording_arguments import open_recording
from hil_bench.cli.status_line import StatusLine
from hil_bench.config import BenchConfig
from hil_bench.lockstep import LockStep, LockStepReport, Round, run_lockstep
from hil_bench.realtime.clock import MonotonicClock
from hil_bench.recording.inline_recorder import RecordingSink
from hil_bench.telemetry import record_exchange
from hil_bench.transports.transport import Transport


def run_in_lockstep(
    args: argparse.Namespace,
    config: BenchConfig,
    bench: Bench,
    transport: Transport,
    stopped: Callable[[], bool],
) -> tuple[LockStepReport, RecordingSink | None]:
    """Power the bench on and let SYNC move it until `stopped` or `--duration` of bench time.

    The nodes boot in a tick at time 0; the first SYNC begins the first period after it.

    Returns:
        What was done, and the recording, which has ended.
    """
    with open_recording(args, config, bench, is_real_time=False) as recording:
        tick: Round = bench.tick
        serve: Round = bench.serve
        if recording is not None:
            tick = record_exchange(tick, recording, bench)
            serve = record_exchange(serve, recording)
        bench.start(0)
        transport.send(tick((), 0))
        lockstep = LockStep(
            tick, serve, tick_ns=config.tick_ns, ticks_per_sync=config.ticks_per_sync
        )
        end = math.inf if args.duration is None else round(args.duration * 1e9)
        status = LockStepStatus(bench, lockstep, transport, MonotonicClock())
        with StatusLine(status.snapshot, status.lines, wanted=not args.quiet) as line:

            def is_over() -> bool:
                if line.is_shown:
                    status.update()
                return stopped() or lockstep.now >= end

            report = run_lockstep(lockstep, transport, stopped=is_over)
    return report, recording


def speed_line(report: LockStepReport, config: BenchConfig) -> str:
    """Return how far the bench went, and how fast once its controller had begun."""
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
