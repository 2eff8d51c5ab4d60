"""`hil-bench run --lockstep`: bench time is the controller's count of SYNCs."""

import argparse
import contextlib
import logging
import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from hil_bench.bench import Bench
from hil_bench.cli.bench_events import BenchEvents
from hil_bench.cli.helpers import Helpers
from hil_bench.cli.interruption import Interruption
from hil_bench.cli.lockstep_status import LockStepStatus
from hil_bench.cli.loop_summary import fault_lines, frame_lines, node_lines
from hil_bench.cli.progress import Progress
from hil_bench.cli.recording_arguments import is_incomplete, open_recording
from hil_bench.cli.status_line import StatusLine
from hil_bench.config import BenchConfig
from hil_bench.lockstep import LockStep, LockStepReport, Round, run_lockstep
from hil_bench.realtime.clock import MonotonicClock
from hil_bench.telemetry import record_exchange
from hil_bench.transports.transport import Transport

if TYPE_CHECKING:
    from hil_bench.recording.inline_recorder import RecordingSink

logger = logging.getLogger(__name__)


class LockStepRun:
    """A run by the SYNCs of a controller.

    Args:
        args: the command line.
        config: of the bench.
        bench: not yet powered on.
        transport: its bus.
        wish: whether somebody wants the end.

    Attributes:
        helpers: the processes beside the loop.
        recording: what was recorded, None for nothing.
    """

    def __init__(
        self,
        args: argparse.Namespace,
        config: BenchConfig,
        bench: Bench,
        transport: Transport,
        wish: Interruption,
    ) -> None:
        self.helpers = Helpers([])
        self.recording: RecordingSink | None = None
        self._args = args
        self._config = config
        self._bench = bench
        self._transport = transport
        self._wish = wish

    def run(self, announce: Callable[[], None]) -> LockStepReport:
        """Power the bench on and let SYNC move it until somebody wants the end, or `--duration`.

        The nodes boot in a tick at time 0; the first SYNC begins the first period after it.

        Args:
            announce: called once all nodes have booted, and answer.
        """
        with open_recording(
            self._args, self._config, self._bench, is_real_time=False
        ) as self.recording:
            lockstep = self._power_on()
            announce()
            return self._follow(lockstep)

    def _power_on(self) -> LockStep:
        tick: Round = self._bench.tick
        serve: Round = self._bench.serve
        if self.recording is not None:
            tick = record_exchange(tick, self.recording, self._bench)
            serve = record_exchange(serve, self.recording)
        self._bench.start(0)
        self._transport.send(tick((), 0))
        config = self._config
        return LockStep(tick, serve, tick_ns=config.tick_ns, ticks_per_sync=config.ticks_per_sync)

    def _follow(self, lockstep: LockStep) -> LockStepReport:
        status = LockStepStatus(self._bench, lockstep, self._transport, MonotonicClock())
        line = StatusLine(status.snapshot, status.lines, wanted=not self._args.quiet)
        progress = Progress(logger.warning, lambda _now: status.texts())
        events = BenchEvents(self._config, self._bench, logger.warning, watches_sync=False)
        duration = self._args.duration
        end = math.inf if duration is None else round(duration * 1e9)
        self.helpers = helpers = Helpers(
            [line] if line.is_shown else [],
            ends_on_loss=self._args.end_on_loss,
            has_lost_data=partial(is_incomplete, self.recording),
        )

        def is_over() -> bool:
            if line.is_shown:
                status.update()
            else:
                progress.look(lockstep.now)
            helpers.look()
            events.look(lockstep.now)
            return self._wish.requested or helpers.is_over or lockstep.now >= end

        with line, contextlib.closing(helpers):
            return run_lockstep(lockstep, self._transport, stopped=is_over)


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
