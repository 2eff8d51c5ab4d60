"""Wake-up lateness of the paced 1 kHz loop beside `cyclictest`, in the same run.

    python benchmarks/lateness.py [--seconds N] [--slice N] [--cpu N] [--policy fifo]
                                  [--condition "as it is"] [--spin US]

Both wake at 1 kHz on absolute deadlines, on the same processor, in turns of some seconds, so that
whatever else the machine does meets both; first at normal priority, then with SCHED_FIFO, locked
memory and processors that are kept awake (`/dev/cpu_dma_latency` at 0). Both hold the same each
time; the last column says what the loop was given. Both leave out the periods that a hold-up
covers: one hold-up is one late tick. The loop runs the whole bench of four nodes on a bus without
traffic: as it is, with the other processors busy, and with a recording, a status line and a Modbus
server attached that a client asks for its registers 100 times a second. With `--spin` the loop
waits busily for the last microseconds under SCHED_FIFO, which cyclictest does not: that shows what
it is worth, and compares no equals. cyclictest is in Debian's package rt-tests.
"""

import argparse
import contextlib
import multiprocessing
import os
import shutil
import socket
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.synchronize import Event
from pathlib import Path

import occasion
from hil_bench.abilities.doctor.machine import SilentTransport
from hil_bench.abilities.modbus.binding import ModbusBinding
from hil_bench.abilities.modbus.server.process import ModbusProcess
from hil_bench.abilities.recording.report import RecordingWish
from hil_bench.abilities.recording.sessions import recorded
from hil_bench.bench.configuration import (
    BenchConfig,
    OverrunPolicy,
    RealtimeConfig,
    RealtimePolicy,
    load_config,
)
from hil_bench.bench.paced import run_paced
from hil_bench.bench.session import Session, open_session
from hil_bench.cli.status_line import (
    bench_status,
    bench_status_row,
    show,
)
from hil_bench.outside.helper_process import Snapshot
from hil_bench.outside.realtime.clock import MonotonicClock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.realtime.statistics import TickStatistics

LONGEST_US = 100_000
PRIORITY = 80
POLICIES = {"off": "normal", "fifo": "SCHED_FIFO"}
CONDITIONS = ("as it is", "others busy", "all attached")


@dataclass(slots=True)
class Peer:
    """The results of cyclictest, in all its turns.

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
            command += ["-p0", "--policy=other", "--latency=2000000000"]  # 2000 s: no request
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
    """A recording, a status line and a Modbus server, each in its process, as `run` has them."""

    def __init__(self, config: BenchConfig, session: Session, folder: Path) -> None:
        self._session = session
        channels, self._fields = bench_status(session.bench)
        self.snapshot = Snapshot(len(channels))
        wish = RecordingWish((folder / "attached.csv",))
        self.recording = recorded(session, wish, config, is_real_time=True)
        self.binding = ModbusBinding(config, session.bench)

    @contextlib.contextmanager
    def running(self, statistics: TickStatistics) -> Iterator[None]:
        """Run all of them, and a client of the server."""
        context = multiprocessing.get_context("spawn")
        ended = context.Event()
        shown, letting_go = context.Pipe()
        arguments = (self.snapshot, (tuple(self._fields),), statistics, shown)
        screen = context.Process(target=draw, args=arguments)
        screen.start()
        with ModbusProcess(self.binding.plan) as server, self.recording:
            self._session.watch(ticks=self.observe)
            client = context.Process(target=poll, args=(server.endpoints.port, ended))
            client.start()
            yield
            ended.set()
            letting_go.close()
            occasion.joined(client, "the Modbus client")
        occasion.joined(screen, "the status line")

    def observe(self, now: int) -> None:
        """Hand out what a tick has found."""
        self.snapshot.write(bench_status_row(self._session.bench))
        self.binding.exchange(now)


def poll(port: int, ended: Event) -> None:
    """Ask the valve's unit for its first eight input registers until all has ended."""
    with socket.create_connection(("127.0.0.1", port)) as connection:
        while not ended.wait(0.01):
            connection.sendall(bytes([0, 1, 0, 0, 0, 6, 1, 4, 0, 0, 0, 8]))
            connection.recv(256)


def draw(*arguments: object) -> None:
    """Draw the status line, for nobody."""
    with open(os.devnull, "w", encoding="ascii") as nowhere, contextlib.redirect_stderr(nowhere):  # noqa: PTH123 - it has no path
        show(*arguments)


def run_loop(
    seconds: float, realtime: RealtimeConfig, statistics: TickStatistics, folder: Path | None
) -> Sequence[str]:
    """Run the bench's loop for a turn; with a folder, with everything attached.

    Returns:
        What the operating system gave it.
    """
    config = load_config(folder / "modbus.toml" if folder else None)
    session = open_session(config)
    end = statistics.ticks + statistics.skipped + round(seconds * 1e9 / config.tick_ns)
    pacer = Pacer(
        *(MonotonicClock(), config.tick_ns),
        overrun=OverrunPolicy.SKIP,
        statistics=statistics,
        spin=realtime.spin,
    )
    with contextlib.ExitStack() as stack:
        if folder is not None:
            attachment = Attachment(config, session, folder)
            stack.enter_context(attachment.running(statistics))
        report = run_paced(
            *(session, SilentTransport(), pacer),
            stopped=lambda: statistics.ticks + statistics.skipped >= end,
            realtime=realtime,
        )
    return report.held


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
) -> tuple[TickStatistics, Peer, Sequence[str]]:
    """Measure loop and peer in one condition, in turns; return what the loop was given, too."""
    spin = arguments.spin * 1000 if policy is RealtimePolicy.FIFO else 0
    realtime = RealtimeConfig(policy=policy, priority=PRIORITY, cpu=arguments.cpu, spin=spin)
    others = os.sched_getaffinity(0) - {arguments.cpu}
    statistics, peer = TickStatistics(is_shared=True), Peer()
    held: Sequence[str] = ()
    with busy(others if is_busy else set()):
        for _ in range(max(round(arguments.seconds / arguments.slice), 1)):
            held = run_loop(arguments.slice, realtime, statistics, folder)
            peer.run(arguments.slice, realtime)
    return statistics, peer, held


def rows(
    condition: str, statistics: TickStatistics, peer: Peer, held: Sequence[str]
) -> Iterator[str]:
    """Yield the rows of one condition."""
    late = statistics.lateness.summary()
    ours = (late.p50_us, late.p99_us, late.p999_us, late.max_us)
    note = f"{statistics.overruns} overruns, {statistics.skipped} skipped in {statistics.ticks}"
    note += f"; held: {', '.join(held)}"
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
    parser.add_argument("--policy", choices=POLICIES, nargs="+", default=list(POLICIES))
    parser.add_argument("--condition", choices=CONDITIONS, nargs="+", default=CONDITIONS)
    parser.add_argument("--spin", type=int, default=0, help="busy wait before each tick [us]")
    arguments = occasion.arguments(parser, seconds=1.0, slice=1.0, policy=["off"])
    if shutil.which("cyclictest") is None:
        occasion.missing("cyclictest", "apt-get install rt-tests")
    print(f"{arguments.seconds:g} s each in turns; lateness in us\n")
    print("| | p50 | p99 | p99.9 | max | |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "modbus.toml").write_text("[modbus]\nport = 0\n", encoding="ascii")
        for policy in arguments.policy:
            for condition in arguments.condition:
                found = measure(
                    arguments,
                    RealtimePolicy(policy),
                    is_busy=condition == "others busy",
                    folder=folder if condition == "all attached" else None,
                )
                print("\n".join(rows(f"{POLICIES[policy]}, {condition}", *found)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
