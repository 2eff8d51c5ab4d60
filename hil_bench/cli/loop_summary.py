"""The figures of a loop in words, for the summary at the end of a run."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict

from hil_bench.bench.bench import Bench
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.ecus import ecus_of
from hil_bench.cli.live_words import ecu_text
from hil_bench.devices.faults.faults import Faults
from hil_bench.outside.realtime.statistics import DurationSummary, TickSummary
from hil_bench.outside.transports.bus_load import bitrate_text, load_of
from hil_bench.outside.transports.transport import Transport, TransportCounters
from hil_bench.session.paced import RunReport

_SHOWN_FAULT_EVENTS = 20


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


def fault_lines(bench: Bench) -> list[str]:
    """Return the faults that began and ended last, a line each."""
    return [
        f"fault     {event.time * 1e-9:.3f} s {event.kind} {event.target} "
        f"{'begins' if event.is_begin else 'ends'}"
        for event in list(bench.part(Faults).events)[-_SHOWN_FAULT_EVENTS:]
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
        state = node.state.name.replace("_", "-")
        lines.append(f"node {node.node_id:<4} {settings.name}: {', '.join((state, *refused))}")
        if node.storage_problem is not None:
            lines.append(f"          {node.storage_problem}")
    return lines + [
        f"J1939     {name}: {ecu_text(ecu.standing())}" for name, ecu in ecus_of(bench).items()
    ]
