"""`hil-bench run` by the clock: the loop, and all that looks after it from its thread."""

import argparse
import contextlib
import logging
import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from hil_bench.bench import Bench
from hil_bench.cli.bench_bus import OpenBus
from hil_bench.cli.bench_events import BenchEvents
from hil_bench.cli.helpers import Helpers
from hil_bench.cli.interruption import Interruption
from hil_bench.cli.loop_summary import (
    bus_lines,
    fault_lines,
    frame_lines,
    helper_lines,
    load_line,
    loop_lines,
    node_lines,
)
from hil_bench.cli.modbus_side import OpenModbus
from hil_bench.cli.progress import Progress
from hil_bench.cli.recording_arguments import is_incomplete
from hil_bench.cli.status_line import (
    StatusLine,
    bench_status,
    bench_status_row,
    bus_status,
    bus_status_row,
    format_health,
    format_lines,
)
from hil_bench.config import BenchConfig
from hil_bench.realtime.clock import Clock
from hil_bench.realtime.pacer import Pacer
from hil_bench.realtime.statistics import TickStatistics
from hil_bench.recording.inline_recorder import RecordingSink
from hil_bench.recording.snapshot import Snapshot
from hil_bench.runner import Observer, RunReport, run_paced
from hil_bench.telemetry import RecordingTap
from hil_bench.transports.bus_load import BusLoad

logger = logging.getLogger(__name__)


class Surroundings(NamedTuple):
    """What is open around a bench that runs.

    Attributes:
        bus: its buses.
        modbus: its Modbus server, where it has one.
        recording: what is recorded, None for nothing.
        wish: whether somebody wants the end.
    """

    bus: OpenBus
    modbus: OpenModbus
    recording: RecordingSink | None
    wish: Interruption


class PacedRun:
    """A run by the clock.

    Args:
        args: the command line.
        config: of the bench.
        bench: not yet powered on.
        around: what is open around it.
        announce: called once all nodes have booted, and answer.
        clock: that moves the bench.

    Attributes:
        helpers: the processes beside the loop.
        is_timed: whether there is a time by which ticks are due.
    """

    def __init__(
        self,
        args: argparse.Namespace,
        config: BenchConfig,
        bench: Bench,
        around: Surroundings,
        announce: Callable[[], None],
        clock: Clock,
    ) -> None:
        self.is_timed = math.isfinite(args.speed)
        self.helpers = Helpers([])
        self._args = args
        self._config = config
        self._bench = bench
        self._around = around
        self._announce = announce
        self._clock = clock
        self._statistics = TickStatistics(is_shared=True)
        self._start: int | None = None
        self._load = BusLoad(around.bus.bitrate)
        channels, fields = bench_status(bench)
        bus_channels, bus_fields = bus_status()
        self._snapshot = Snapshot((*channels, *bus_channels))
        self._fields = (fields, bus_fields)
        self._events = BenchEvents(config, bench, logger.warning)

    def run(self) -> RunReport:
        """Pace the bench until its end: by somebody's wish, by `--duration` or by a loss."""
        args, config, around = self._args, self._config, self._around
        pacer = Pacer(
            self._clock,
            config.tick_ns,
            overrun=config.realtime.overrun,
            statistics=self._statistics,
        )
        transport = around.bus.transport
        observers: list[Observer] = [*around.modbus.observers, self._watch]
        if around.recording is not None:
            tap = RecordingTap(transport, around.recording)
            transport, observers = tap, [tap.observe, *observers]
        line = StatusLine(
            self._snapshot, self._fields, statistics=self._statistics, wanted=not args.quiet
        )
        with line, contextlib.closing(self._watch_helpers(line)):
            observers.append(self._publish if line.is_shown else self._tell_progress())
            return run_paced(
                *(self._bench, transport, pacer),
                stopped=self._make_stopped(),
                observers=observers,
                realtime=config.realtime,
                serves_between_ticks=args.speed == 1,
            )

    def _watch_helpers(self, line: StatusLine) -> Helpers:
        around = self._around
        shown = [line] if line.is_shown else []
        self.helpers = Helpers(
            [*around.bus.helpers, *around.modbus.helpers, *shown],
            ends_on_loss=self._args.end_on_loss,
            has_lost_data=partial(is_incomplete, around.recording),
        )
        return self.helpers

    def _make_stopped(self) -> Callable[[], bool]:
        duration, statistics = self._args.duration, self._statistics
        periods = math.inf if duration is None else round(duration * 1e9 / self._config.tick_ns)
        wish, helpers = self._around.wish, self.helpers

        def stopped() -> bool:
            ticks = statistics.ticks + statistics.skipped
            return wish.requested or helpers.is_over or ticks >= periods

        return stopped

    def _watch(self, _bench: Bench, now: int) -> None:
        """Look after all that is not the tick's work."""
        if self._start is None:
            self._start = now
            self._announce()
        self.helpers.look()
        self._events.look(now - self._start)

    def _row(self, now: int) -> tuple[float, ...]:
        counters = self._around.bus.transport.counters()
        present = bus_status_row(counters, self._load.update(now, counters.bits))
        return (*bench_status_row(self._bench), *present)

    def _publish(self, _bench: Bench, now: int) -> None:
        self._snapshot.write(self._row(now))

    def _tell_progress(self) -> Observer:
        """Return what says now and then how it goes, where no status lines do."""

        def lines(now: int) -> list[str]:
            health = format_health(self._statistics if self.is_timed else None)
            return format_lines(self._row(now), self._fields) + health

        progress = Progress(logger.warning, lines)
        return lambda _bench, now: progress.look(now - (self._start or 0))


def summary_lines(
    report: RunReport, run: PacedRun, config: BenchConfig, bench: Bench, bus: OpenBus
) -> list[str]:
    """Return the summary at the end of a run; the loop's timing where there was any."""
    ticks, *timing = loop_lines(report.ticks, config.tick_ns)
    return [
        *("summary", ticks, *(timing if run.is_timed else ())),
        *frame_lines(report.frames, bench.unrouted),
        *bus_lines(bus.parts),
        load_line(report, config.tick_ns, bus.bitrate),
        *fault_lines(bench),
        *node_lines(config, bench),
        *helper_lines(run.helpers.lines()),
    ]
