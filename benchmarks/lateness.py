"""Wake-up lateness of the paced 1 kHz loop beside `cyclictest`, in the same run.

    python benchmarks/lateness.py [--seconds N] [--slice N] [--cpu N]

Both wake at 1 kHz on absolute deadlines, on the same processor, in turns of some seconds, so that
whatever else the machine does meets both; first at normal priority, then with SCHED_FIFO and locked
memory. Both leave out the periods that a hold-up covers: one hold-up is one late tick. The loop
runs the whole bench of four nodes on a bus without traffic: as it is, with the other processors
busy, and with a recording and a status line attached. cyclictest is in Debian's package rt-tests.
"""

import argparse
import contextlib
import multiprocessing
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from hil_bench.assembly import build_bench
from hil_bench.bench import Bench
from hil_bench.cli.status_line import bench_status, bench_status_row, show
from hil_bench.config import OverrunPolicy, RealtimeConfig, RealtimePolicy, load_config
from hil_bench.realtime.clock import MonotonicClock
from hil_bench.realtime.pacer import Pacer
from hil_bench.realtime.statistics import TickStatistics
from hil_bench.recording.recorder import RecordingPlan
from hil_bench.recording.recorder_process import RecorderProcess
from hil_bench.recording.snapshot import Snapshot
from hil_bench.runner import run_paced
from hil_bench.telemetry import RecordingTap, bench_channels
from hil_bench.transports.silent import SilentTransport

LONGEST_US = 100_000
PRIORITY = 80


@dataclass(slots=True)
class Peer:
    """What cyclictest found, in all its turns.

    Attributes:
        counts: of each latency [us].
        maximum: the largest latency [us].
    """

    counts: Counter[int] = field(default_factory=Counter)
    maximum: float = 0.0

    def run(self, seconds: float, realtime: RealtimeConfig) -> None:
        """Take a turn; it waits on absolute deadlines as the loop does."""
        command = ["cyclictest", "-q", "-i1000", f"-h{LONGEST_US}", f"-D{seconds:g}s"]
        command += [f"-a{realtime.cpu}", "-t1"]
        if realtime.policy is RealtimePolicy.FIFO:
            command += ["-m", "--policy=fifo", f"-p{PRIORITY}"]
        else:
            command += ["-p0", "--policy=other"]
        output = subprocess.run(  # noqa: S603 - a fixed command
            command, stdout=subprocess.PIPE, text=True, check=True
        ).stdout
        for line in output.splitlines():
            if line.startswith("# Max Latencies:"):
                self.maximum = max(self.maximum, float(line.split()[-1]))
            elif line and not line.startswith("#"):
                latency, count = map(int, line.split())
                self.counts[latency] += count

    def figures(self) -> tuple[float, float, float, float]:
        """Return p50, p99, p99.9 and maximum [us], percentiles as upper edges of bins of 1 us."""
        total = self.counts.total()
        return (*(self._percentile(total * share) for share in (0.5, 0.99, 0.999)), self.maximum)

    def _percentile(self, rank: float) -> float:
        seen = 0
        for latency in sorted(self.counts):
            seen += self.counts[latency]
            if seen >= rank:
                return latency + 1
        return self.maximum


class Attachment:
    """A recording and a status line, each in its process, as `hil-bench run --record` has them."""

    def __init__(self, bench: Bench, folder: Path) -> None:
        channels, self._fields = bench_status(bench)
        self.snapshot = Snapshot(channels)
        plan = RecordingPlan((folder / "attached.csv",), bench_channels(bench))
        self.recorder = RecorderProcess(plan)

    @contextlib.contextmanager
    def running(self, statistics: TickStatistics) -> Iterator[None]:
        """Run both."""
        context = multiprocessing.get_context("spawn")
        ended = context.Event()
        arguments = (self.snapshot, tuple(self._fields), statistics, ended)
        screen = context.Process(target=draw, args=arguments)
        screen.start()
        with self.recorder:
            yield
        ended.set()
        screen.join()


def draw(*arguments: object) -> None:
    """Draw the status line, for nobody."""
    with open(os.devnull, "w", encoding="ascii") as nowhere, contextlib.redirect_stderr(nowhere):  # noqa: PTH123 - it has no path
        show(*arguments)


def run_loop(
    seconds: float, realtime: RealtimeConfig, statistics: TickStatistics, folder: Path | None
) -> None:
    """Run the bench's loop for a turn; with a folder, with everything attached."""
    config = load_config()
    bench = build_bench(config)
    end = statistics.ticks + statistics.skipped + round(seconds * 1e9 / config.tick_ns)
    transport: SilentTransport | RecordingTap = SilentTransport()
    pacer = Pacer(
        MonotonicClock(), config.tick_ns, overrun=OverrunPolicy.SKIP, statistics=statistics
    )
    observers = []
    with contextlib.ExitStack() as stack:
        if folder is not None:
            attachment = Attachment(bench, folder)
            stack.enter_context(attachment.running(statistics))
            transport = tap = RecordingTap(transport, attachment.recorder)
            observers = [
                tap.observe,
                lambda bench, _now: attachment.snapshot.write(bench_status_row(bench)),
            ]
        run_paced(
            *(bench, transport, pacer),
            stopped=lambda: statistics.ticks + statistics.skipped >= end,
            observers=observers,
            realtime=realtime,
        )


@contextlib.contextmanager
def busy(cpus: set[int]) -> Iterator[None]:
    """Keep processors busy with a Python that computes."""
    command = [sys.executable, "-c", "while True: sum(range(1000))"]
    with contextlib.ExitStack() as stack:
        for cpu in cpus:
            process = stack.enter_context(subprocess.Popen(command))  # noqa: S603 - our own
            os.sched_setaffinity(process.pid, {cpu})
            stack.callback(process.kill)
        yield


def measure(
    arguments: argparse.Namespace, policy: RealtimePolicy, *, is_busy: bool, folder: Path | None
) -> tuple[TickStatistics, Peer]:
    """Return what loop and peer found in one condition, in turns."""
    realtime = RealtimeConfig(policy=policy, priority=PRIORITY, cpu=arguments.cpu)
    others = os.sched_getaffinity(0) - {arguments.cpu}
    statistics, peer = TickStatistics(is_shared=True), Peer()
    with busy(others if is_busy else set()):
        for _ in range(max(round(arguments.seconds / arguments.slice), 1)):
            run_loop(arguments.slice, realtime, statistics, folder)
            peer.run(arguments.slice, realtime)
    return statistics, peer


def rows(condition: str, statistics: TickStatistics, peer: Peer) -> Iterator[str]:
    """Yield the rows of one condition."""
    late = statistics.lateness.summary()
    ours = (late.p50_us, late.p99_us, late.p999_us, late.max_us)
    note = f"{statistics.overruns} overruns, {statistics.skipped} skipped in {statistics.ticks}"
    yield table_row(f"{condition}: loop", ours, note)
    yield table_row("cyclictest", peer.figures(), "")
    ratios = tuple(mine / theirs for mine, theirs in zip(ours, peer.figures(), strict=True))
    yield table_row("ratio", ratios, "")


def table_row(name: str, figures: tuple[float, ...], note: str) -> str:
    """Return one row of the table."""
    return f"| {name} | " + " | ".join(f"{figure:.3g}" for figure in figures) + f" | {note} |"


def main() -> int:
    """Print the figures as a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="of each row")
    parser.add_argument("--slice", type=float, default=10.0, help="length of a turn [s]")
    parser.add_argument("--cpu", type=int, default=max(os.sched_getaffinity(0)))
    arguments = parser.parse_args()
    if shutil.which("cyclictest") is None:
        print("cyclictest is missing: apt-get install rt-tests", file=sys.stderr)
        return 1
    load = os.getloadavg()[0]
    print(f"{platform.machine()}, Linux {platform.release()}, Python {platform.python_version()}, ")
    print(f"load {load:.1f} before; {arguments.seconds:g} s each in turns; lateness in us\n")
    print("| | p50 | p99 | p99.9 | max | |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        conditions = (
            ("as it is", False, None),
            ("others busy", True, None),
            ("recording and screen", False, Path(folder)),
        )
        for policy, how in ((RealtimePolicy.OFF, "normal"), (RealtimePolicy.FIFO, "SCHED_FIFO")):
            for name, is_busy, place in conditions:
                found = measure(arguments, policy, is_busy=is_busy, folder=place)
                print("\n".join(rows(f"{how}, {name}", *found)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
