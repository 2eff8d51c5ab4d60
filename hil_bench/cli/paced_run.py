"""`hil-bench run` by the clock: the loop, and all that looks after it from its thread."""

import argparse
import contextlib
import logging
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import NamedTuple

from hil_bench.bench.bench import Bench
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.events import event_text
from hil_bench.bench.paced import RunReport, run_paced
from hil_bench.bench.peers import peers_of
from hil_bench.bench.session import Session
from hil_bench.cli import status_line
from hil_bench.cli.arguments import load_bench_config
from hil_bench.cli.bench_events import BenchEvents
from hil_bench.cli.exit_codes import Ending, ExitCode
from hil_bench.cli.helpers import Helpers
from hil_bench.cli.results import ecu_text
from hil_bench.cli.run_setup import HistogramFile, RunSetup, paced_content, set_up, watched_run
from hil_bench.outside.bits import BusLoad, bitrate_text, load_of
from hil_bench.outside.helper_process import Snapshot
from hil_bench.outside.realtime.clock import Clock, MonotonicClock, ScaledClock, VirtualClock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.realtime.statistics import DurationSummary, TickStatistics, TickSummary
from hil_bench.outside.transports.transport import Transport, TransportCounters

# The figures of a loop in words, for the summary at the end of a run.

_SHOWN_EVENTS = 20


def loop_lines(summary: TickSummary, period_ns: int) -> list[str]:
    """Return the figures of the loop, a line a fact."""
    return [
        (
            f"ticks     {summary.ticks} of {period_ns / 1000:g} us, {summary.overruns} overran, "
            f"{summary.skipped} skipped"
        ),
        f"lateness  {duration_text(summary.lateness)}",
        f"work      {duration_text(summary.work)}",
    ]


def duration_text(duration: DurationSummary) -> str:
    """Return the percentiles of a duration in microseconds."""
    return (
        f"p50 {duration.p50_us:.0f}  p99 {duration.p99_us:.0f}  p99.9 {duration.p999_us:.0f}  "
        f"max {duration.max_us:.0f} us"
    )


def frame_lines(counters: TransportCounters, unrouted: int) -> list[str]:
    """Return the counts of frames on the bus, a line a fact; losses only where there were some."""
    lines = [
        f"frames    {counters.received} received ({unrouted} for nobody here), {counters.sent} sent"
    ]
    losses = {
        "dropped by the kernel's full receive buffer": counters.dropped,
        "ignored (CAN FD or error frames)": counters.ignored,
        "not taken by the bus": counters.send_failures,
        "times the interface went down": counters.outages,
    }
    lines += [f"          {count} {what}" for what, count in losses.items() if count]
    return lines


def bus_lines(parts: Mapping[str, Transport]) -> list[str]:
    """Return the counts of each of several buses, a line each; nothing for a single bus."""
    if len(parts) == 1:
        return []
    counts = {name: transport.counters() for name, transport in parts.items()}
    return [
        f"          {name}: {count.received} received, {count.sent} sent"
        + (f", {count.outages} times down" if count.outages else "")
        for name, count in counts.items()
    ]


def load_line(report: RunReport, period_ns: int, bitrate: int) -> str:
    """Return the bus load of the frames that the bench sent and received."""
    duration = (report.ticks.ticks + report.ticks.skipped) * period_ns
    load = load_of(report.frames.bits, duration, bitrate)
    return f"bus load  {load:.1%} of {bitrate_text(bitrate)}"


def event_lines(bench: Bench) -> list[str]:
    """Return the last events, as the begin of a fault, a line each."""
    return [
        f"{event.what:9} {event.time * 1e-9:.3f} s {event_text(event)}"
        for log in bench.events.values()
        for event in [*log][-_SHOWN_EVENTS:]
    ]


def wire_lines(config: BenchConfig, bench: Bench) -> list[str]:
    """Return the lines on the buses on which frames take time."""
    return [] if bench.medium is None else bench.medium.lines(list(config.buses))


def helper_lines(endings: Sequence[str]) -> list[str]:
    """Return the processes beside the loop that ended, a line each."""
    return [f"helper    {ending}" for ending in endings]


def node_lines(config: BenchConfig, bench: Bench) -> list[str]:
    """Return the final state and refusals of each node, then each J1939 device, a line each."""
    lines = []
    for settings, node in zip(config.nodes, bench.nodes, strict=True):
        refused = [
            f"{count} {name.replace('_', ' ')}"
            for name, count in asdict(node.counters).items()
            if count
        ]
        words = ", ".join((node.state_name, *refused))
        lines.append(f"node {node.node_id:<4} {settings.name}: {words}")
        if node.storage_problem is not None:
            lines.append(f"          {node.storage_problem}")
    return lines + [
        f"J1939     {name}: {ecu_text(ecu.standing())}" for name, ecu in peers_of(bench).items()
    ]


logger = logging.getLogger(__name__)

IsOver = Callable[[], bool]
"""Whether a run has come to its own end."""


class Guest(NamedTuple):
    """The guest of a running bench, with a report at the end.

    Attributes:
        is_over: whether it has come to its end, and the run with it.
        lines: what it found, for people.
        content: the same for a program.
        shown: the same for those who watch.
        code: the exit code of its verdict.
    """

    is_over: IsOver
    lines: Callable[[], Iterable[str]]
    content: Callable[[], Mapping[str, object]]
    shown: object
    code: Callable[[], ExitCode]


def run(args: argparse.Namespace) -> int:
    """Run the bench by the clock, print the summary and return the exit code."""
    return run_bench(args, load_bench_config(args))


def run_bench(
    args: argparse.Namespace, config: BenchConfig, begin: Callable[[Session], Guest] | None = None
) -> int:
    """Run a bench by the clock, print the summary and return the exit code.

    Args:
        args: the command line.
        config: of the bench.
        begin: called before the first tick; returns what plays on the bench.
    """
    ending = Ending(args)
    histograms = HistogramFile(args.histograms)
    with set_up(args, config, is_real_time=args.speed <= 1) as setup:
        announce = setup.announcement()
        guest = None if begin is None else begin(setup.session)
        paced = PacedRun(setup, announce, clock_of(args.speed), guest)
        report = paced.run()
        with ending.going_on():
            histograms.write(report, config.tick_ns, setup.bus.bitrate)
    announce()  # where not even one tick was asked for
    lines = summary_lines(report, paced, setup) + setup.companion_lines()
    content = paced_content(report, setup, paced.helpers, is_timed=paced.is_timed)
    if guest is not None:
        lines += guest.lines()
        content |= guest.content()
        ending.take(guest.code())
    if args.strict_timing and report.ticks.overruns > 0:
        ending.take(ExitCode.TIMING)
    return setup.finish(ending, paced.helpers, report.lost, lines, content)


def clock_of(speed: float) -> Clock:
    """Return the clock of a run at some speed, which may be infinite."""
    if math.isinf(speed):
        return VirtualClock()
    return MonotonicClock() if speed == 1 else ScaledClock(MonotonicClock(), speed)


class PacedRun:
    """A run by the clock.

    Args:
        setup: the bench and what is open around it.
        announce: called once all nodes have booted, and answer.
        clock: that moves the bench.
        guest: what plays on the bench; None for nothing.

    Attributes:
        helpers: the processes beside the loop.
        is_timed: whether there is a time by which ticks are due.
    """

    def __init__(
        self,
        setup: RunSetup,
        announce: Callable[[], None],
        clock: Clock,
        guest: Guest | None = None,
    ) -> None:
        self._guest = guest
        self.is_timed = math.isfinite(setup.args.speed)
        self.helpers = Helpers([])
        self._look: Callable[[], None] | None = None
        self._setup = setup
        self._bench = setup.session.bench
        self._announce = announce
        self._clock = clock
        self._statistics = TickStatistics(is_shared=True)
        self._load = BusLoad(setup.bus.bitrate)
        channels, fields = status_line.bench_status(self._bench)
        bus_channels, bus_fields = status_line.bus_status()
        self._snapshot = Snapshot(len(channels) + len(bus_channels))
        self._fields = (fields, bus_fields)
        self._events = BenchEvents(setup.config, self._bench, logger.warning)

    def run(self) -> RunReport:
        """Pace the bench until its end: by somebody's wish, by `--duration` or by a loss."""
        args, config, session = self._setup.args, self._setup.config, self._setup.session
        pacer = Pacer(
            self._clock,
            config.tick_ns,
            overrun=config.realtime.overrun,
            statistics=self._statistics,
            spin=0 if isinstance(self._clock, VirtualClock) else config.realtime.spin,
        )
        line = status_line.StatusLine(
            self._snapshot, self._fields, statistics=self._statistics, wanted=not args.quiet
        )
        shown = [line] if line.is_shown else []
        self.helpers = self._setup.watch(*shown)
        session.watch(ticks=self._watch)
        session.watch(ticks=self._publish if line.is_shown else self._make_progress().look)
        watched = watched_run(
            args,
            config,
            session,
            statistics=self._statistics if self.is_timed else None,
            health=self._health,
            work=self._guest and self._guest.shown,
        )
        is_stopped = self._make_stopped()
        with line, contextlib.closing(self.helpers), watched as self._look:
            return run_paced(
                session,
                self._setup.bus.transport,
                pacer,
                stopped=is_stopped,
                realtime=config.realtime,
                serves_between_ticks=args.speed == 1,
                hears_all=any(each.hears_all for each in self._setup.companions),
            )

    def _make_stopped(self) -> Callable[[], bool]:
        setup, statistics, helpers = self._setup, self._statistics, self.helpers
        controls = setup.session.controls
        duration, wish = setup.args.duration, setup.wish
        guest = self._guest
        periods = math.inf if duration is None else round(duration * 1e9 / setup.config.tick_ns)

        def stopped() -> bool:
            ticks = statistics.ticks + statistics.skipped
            is_wished = wish.requested or controls.is_over
            is_played = guest is not None and guest.is_over()
            return is_wished or is_played or helpers.is_over or ticks >= periods

        return stopped

    def _watch(self, now: int) -> None:
        """Look after all that is not the tick's work."""
        if not now:
            self._announce()
        self.helpers.look()
        self._events.look(now)
        if now >= self._load.due:
            self._load.update(now, self._setup.bus.transport.counters().bits)
        if self._look is not None:
            self._look()

    def _health(self) -> dict[str, float]:
        counters, now = self._setup.bus.transport.counters(), self._setup.session.now
        received, sent, load = status_line.bus_status_row(
            counters, self._load.update(now, counters.bits)
        )
        return {"received": received, "sent": sent, "bus_load": load}

    def _row(self, now: int) -> tuple[float, ...]:
        counters = self._setup.bus.transport.counters()
        present = status_line.bus_status_row(counters, self._load.update(now, counters.bits))
        return (*status_line.bench_status_row(self._bench), *present)

    def _publish(self, now: int) -> None:
        self._snapshot.write(self._row(now))

    def _make_progress(self) -> status_line.Progress:
        """Make the progress lines that replace the status lines where there are none."""

        def lines(now: int) -> list[str]:
            health = status_line.format_health(self._statistics if self.is_timed else None)
            return status_line.format_lines(self._row(now), self._fields) + health

        return status_line.Progress(logger.warning, lines)


def summary_lines(report: RunReport, run: PacedRun, setup: RunSetup) -> list[str]:
    """Return the summary at the end of a run; the loop's timing where there was any."""
    config, bench, bus = setup.config, setup.session.bench, setup.bus
    ticks, *timing = loop_lines(report.ticks, config.tick_ns)
    return [
        "summary",
        ticks,
        *(timing if run.is_timed else ()),
        *([f"real time {', '.join(report.held)}"] if report.held else ()),
        *frame_lines(report.frames, bench.unrouted),
        *bus_lines(bus.parts),
        load_line(report, config.tick_ns, bus.bitrate),
        *wire_lines(config, bench),
        *event_lines(bench),
        *node_lines(config, bench),
        *helper_lines(run.helpers.lines()),
    ]
