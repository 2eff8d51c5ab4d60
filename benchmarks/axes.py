"""Benchmark of the number of axes that one core holds at 1 kHz in real time.

    python benchmarks/axes.py [--seconds N] [--axes N ...] [--realtime fifo]

The paced loop of `hil-bench run` on one processor, with a bus in memory that brings every valve's
set-point and a SYNC in each tick and takes every node's TPDO. A row holds where no tick is skipped
and no more of them overrun than with one axis, but for what the machine itself holds up: see the
peer, a loop on a silent bus with one axis, in the same run.
"""

import argparse
import os
from collections.abc import Iterable, Sequence

import occasion
from hil_bench.abilities.doctor.machine import SilentTransport
from hil_bench.bench.configuration import BenchConfig, OverrunPolicy, RealtimeConfig, RealtimePolicy
from hil_bench.bench.paced import run_paced
from hil_bench.bench.session import open_session
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.realtime.clock import MonotonicClock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.realtime.statistics import TickStatistics
from hil_bench.outside.transports.transport import TransportCounters
from lockstep import config_of, cycle_frames, set_up_frames, valves_of

PRIORITY = 80


class BusyTransport:
    """A bus in memory with a controller on it that commands every valve in each tick.

    Args:
        config: the bench.
    """

    description = "busy"
    has_exact_wait = False

    def __init__(self, config: BenchConfig) -> None:
        self._valves = valves_of(config)
        self._set_up = list(set_up_frames(config))
        self._number = -3
        self.answers = 0

    def receive(self, limit: int) -> list[Frame]:  # noqa: ARG002 - it is what a tick gets
        """Return the controller's frames of this tick: it sets up once, then commands."""
        self._number += 1
        if self._number < 0:
            return []
        if self._number == 0:
            return self._set_up
        return cycle_frames(self._valves, self._number)

    def wait(self, timeout: float) -> bool:  # noqa: ARG002 - the protocol's
        """Return False at once."""
        return False

    def send(self, frames: Sequence[Frame]) -> None:
        """Count the TPDOs."""
        self.answers += sum(frame.can_id & 0x780 == 0x180 for frame in frames)

    def listen_to(self, can_ids: Iterable[int]) -> None:
        """Do nothing."""

    def counters(self) -> TransportCounters:
        """Return zeros."""
        return TransportCounters()

    def close(self) -> None:
        """Do nothing."""


def run(
    config: BenchConfig, transport: BusyTransport | SilentTransport, arguments: argparse.Namespace
) -> TickStatistics:
    """Run the paced loop for a while; return its statistics."""
    realtime = RealtimeConfig(
        policy=RealtimePolicy(arguments.realtime), priority=PRIORITY, cpu=arguments.cpu
    )
    statistics = TickStatistics()
    pacer = Pacer(
        MonotonicClock(), config.tick_ns, overrun=OverrunPolicy.SKIP, statistics=statistics
    )
    ticks = round(arguments.seconds * 1e9 / config.tick_ns)
    run_paced(
        *(open_session(config), transport, pacer),
        stopped=lambda: statistics.ticks + statistics.skipped >= ticks,
        realtime=realtime,
    )
    return statistics


def row(name: str, nodes: int, statistics: TickStatistics) -> str:
    """Return a row of the table."""
    late, work = statistics.lateness.summary(), statistics.work.summary()
    return (
        f"| {name} | {nodes} | {work.p50_us:.0f} | {work.p99_us:.0f} | {work.p999_us:.0f} "
        f"| {late.p99_us:.0f} | {statistics.overruns} | {statistics.skipped} |"
    )


def main() -> None:
    """Print the figures as a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="of each row")
    parser.add_argument("--axes", type=int, nargs="+", default=[1, 8, 16, 20, 24, 28, 31])
    parser.add_argument("--realtime", choices=("off", "fifo"), default="off")
    parser.add_argument("--cpu", type=int, default=max(os.sched_getaffinity(0)))
    arguments = occasion.arguments(parser, seconds=0.3, axes=[1, 2])
    print(f"policy {arguments.realtime}, {arguments.seconds:g} s a row; us\n")
    print("| axes | nodes | work p50 | p99 | p99.9 | late p99 | overran | skipped |")
    print("|---|---|---|---|---|---|---|---|")
    print(row("1, silent bus", 4, run(config_of(1), SilentTransport(), arguments)), flush=True)
    for axes in arguments.axes:
        config = config_of(axes)
        transport = BusyTransport(config)
        statistics = run(config, transport, arguments)
        least = (statistics.ticks - 20) * len(config.nodes)
        assert transport.answers >= least, transport.answers  # noqa: S101 - or it measured nothing
        print(row(str(axes), len(config.nodes), statistics), flush=True)


if __name__ == "__main__":
    main()
