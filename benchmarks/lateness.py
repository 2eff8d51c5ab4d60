"""Wake-up lateness of the paced 1 kHz loop beside `cyclictest`, in the same minute.

    python benchmarks/lateness.py [--seconds N]

Both wake at 1 kHz on absolute deadlines at normal priority, first one after the other, then both
at once; the loop runs the whole bench of four nodes on a bus without traffic. cyclictest is in
Debian's package rt-tests.
"""

import argparse
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterable, Sequence

from hil_bench.assembly import build_bench
from hil_bench.canopen_device.frame import Frame
from hil_bench.config import load_config
from hil_bench.realtime.clock import MonotonicClock
from hil_bench.realtime.pacer import Pacer
from hil_bench.realtime.statistics import TickSummary
from hil_bench.runner import run_paced
from hil_bench.transports.transport import TransportCounters

LONGEST_US = 100_000


class SilentTransport:
    """A bus on which nothing happens."""

    description = "silent"

    def receive(self, limit: int) -> list[Frame]:  # noqa: ARG002 - the protocol's
        """Return nothing."""
        return []

    def send(self, frames: Sequence[Frame]) -> None:
        """Drop the frames."""

    def listen_to(self, can_ids: Iterable[int]) -> None:
        """Do nothing."""

    def counters(self) -> TransportCounters:
        """Return zeros."""
        return TransportCounters()

    def close(self) -> None:
        """Do nothing."""


def run_loop(seconds: float) -> TickSummary:
    """Return what the bench's loop did."""
    config = load_config()
    pacer = Pacer(MonotonicClock(), config.tick_ns)
    ticks = round(seconds * 1e9 / config.tick_ns)
    return run_paced(
        build_bench(config),
        SilentTransport(),
        pacer,
        stopped=lambda: pacer.statistics.ticks == ticks,
    ).ticks


def start_cyclictest(seconds: float) -> subprocess.Popen[str]:
    """Start cyclictest with a histogram; it waits on absolute deadlines as the loop does."""
    command = ["cyclictest", "-q", "-p0", "--policy=other", "-i1000", f"-h{LONGEST_US}"]
    return subprocess.Popen(  # noqa: S603 - a fixed command
        [*command, f"-D{seconds:g}s"], stdout=subprocess.PIPE, text=True
    )


def cyclictest_percentiles(process: subprocess.Popen[str]) -> tuple[float, float, float, float]:
    """Return p50, p99, p99.9 and maximum [us] from its histogram."""
    output = process.communicate()[0]
    counts, maximum = [], 0.0
    for line in output.splitlines():
        if line.startswith("# Max Latencies:"):
            maximum = float(line.split()[-1])
        elif line and not line.startswith("#"):
            latency, count = map(int, line.split())
            counts.append((latency, count))
    total = sum(count for _, count in counts)
    return (*(percentile(counts, total * share, maximum) for share in (0.5, 0.99, 0.999)), maximum)


def percentile(counts: list[tuple[int, int]], rank: float, maximum: float) -> float:
    """Return the upper edge [us] of the bin that holds the value of this rank."""
    seen = 0
    for latency, count in counts:
        seen += count
        if seen >= rank:
            return latency + 1
    return maximum


def table_row(name: str, figures: tuple[float, ...], note: str) -> str:
    """Return one row of the table."""
    return f"| {name} | " + " | ".join(f"{figure:.3g}" for figure in figures) + f" | {note} |"


def loop_row(name: str, summary: TickSummary) -> str:
    """Return the row of a loop."""
    late = summary.lateness
    note = f"{summary.overruns} overruns, {summary.skipped} skipped in {summary.ticks} ticks"
    return table_row(name, (late.p50_us, late.p99_us, late.p999_us, late.max_us), note)


def main() -> int:
    """Print the figures as a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    args = parser.parse_args()
    if shutil.which("cyclictest") is None:
        print("cyclictest is missing: apt-get install rt-tests", file=sys.stderr)
        return 1
    alone = run_loop(args.seconds)
    peer_alone = cyclictest_percentiles(start_cyclictest(args.seconds))
    peer = start_cyclictest(args.seconds)
    together = run_loop(args.seconds)
    peer_together = cyclictest_percentiles(peer)
    print(f"{platform.machine()}, Linux {platform.release()}, Python {platform.python_version()}, ")
    print(f"normal priority, {args.seconds:g} s each; lateness in us\n")
    print("| | p50 | p99 | p99.9 | max | |\n|---|---|---|---|---|---|")
    print(loop_row("bench's loop alone", alone))
    print(table_row("cyclictest alone", peer_alone, ""))
    print(loop_row("bench's loop, cyclictest beside it", together))
    print(table_row("cyclictest, the loop beside it", peer_together, ""))
    print(table_row("ratio, alone", ratios(alone, peer_alone), ""))
    return 0


def ratios(summary: TickSummary, peer: tuple[float, ...]) -> tuple[float, ...]:
    """Return the loop's figures over cyclictest's."""
    late = summary.lateness
    ours = (late.p50_us, late.p99_us, late.p999_us, late.max_us)
    return tuple(mine / theirs for mine, theirs in zip(ours, peer, strict=True))


if __name__ == "__main__":
    sys.exit(main())
