"""A long run of the paced loop under full bus load, with a line a minute on its health.

    python benchmarks/soak.py [--minutes N] [--realtime fifo] [--channel vcan0]

A controller in a process of its own sends SYNC and a set-point each millisecond, with an SDO
request and frames that are for nobody in between, until a bus of 1 Mbit/s would be full. The lines
show what must not grow: resident memory and open files of the loop's process, and the distance
between tick count and clock. At the end both sides' counts of frames are compared, and the SYNCs
are counted that not all four devices have answered: the controller's clock is its own, so some
ticks take two SYNCs and others none. The exit code is 1 where a frame or an answer is missing. One
minute has 60,000 SYNCs.
"""

import argparse
import contextlib
import ctypes
import logging
import math
import multiprocessing
import os
import struct
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can

import occasion
from hil_bench.abilities.hub.process import HubProcess
from hil_bench.bench.configuration import RealtimeConfig, RealtimePolicy, load_config
from hil_bench.bench.paced import RunReport, run_paced
from hil_bench.bench.session import open_session
from hil_bench.outside.realtime.clock import MonotonicClock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.realtime.statistics import TickStatistics
from hil_bench.outside.transports.opening import open_transport

PERIOD = 1e-3  # of SYNC [s]
NODE_IDS = (1, 2, 3, 4)
FILLERS = 1  # frames for nobody in each period, which is full then
READ = bytes.fromhex("4000100000000000")  # 0x1000.00
READY, ENDING, ENDED = 1, 2, 3
MINUTE = 60.0


@dataclass(frozen=True, slots=True)
class Counts:
    """The counters of the controller, for others to read.

    Attributes:
        syncs: SYNCs sent.
        tpdos: TPDOs that came.
        answers: answers to SDO requests.
        sent: all frames sent.
        received: all frames that came.
        state: 0 at first, then `READY`, `ENDING` once it is to end, `ENDED` once it has.
    """

    syncs: Any
    tpdos: Any
    answers: Any
    sent: Any
    received: Any
    state: Any


class Controller:
    """The other end of the bus."""

    def __init__(self, bus: can.BusABC, counts: Counts) -> None:
        self._bus = bus
        self._counts = counts

    def run(self) -> None:
        """Send a period's frames each millisecond until told to end; then await the last ones."""
        counts = self._counts
        self._prepare()
        due = time.monotonic()
        while counts.state.value != ENDING:
            self._send_period(counts.syncs.value)
            counts.syncs.value += 1
            due += PERIOD
            while (remaining := due - time.monotonic()) > 0:
                self._take(remaining)
        while self._take(0.5):
            pass

    def _prepare(self) -> None:
        """Await the boot-ups, let each device send its TPDO with each SYNC, and start them."""
        self._counts.state.value = READY
        for _ in NODE_IDS:
            self._take(60.0)
        for node_id in NODE_IDS:
            self._send(0x600 + node_id, bytes.fromhex("2f00180201000000"))
            self._take(5.0)
        self._send(0x000, b"\x01\x00")

    def _send_period(self, number: int) -> None:
        """Send set-point and SYNC, frames for nobody, an SDO request."""
        setpoint = 8192 if number // 500 % 2 else -8192
        self._send(0x201, struct.pack("<Hh", 7, setpoint))
        self._send(0x080)
        for filler in range(FILLERS):
            self._send(0x7F0 + filler, bytes(8))
        self._send(0x600 + NODE_IDS[number % len(NODE_IDS)], READ)

    def _send(self, can_id: int, data: bytes = b"") -> None:
        self._bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
        self._counts.sent.value += 1

    def _take(self, timeout: float) -> bool:
        """Count the next frame; return whether one came in time [s]."""
        answer = self._bus.recv(timeout)
        if answer is None:
            return False
        self._counts.received.value += 1
        self._counts.tpdos.value += 0x181 <= answer.arbitration_id <= 0x184
        self._counts.answers.value += 0x581 <= answer.arbitration_id <= 0x584
        return True


def control(bus_options: dict[str, Any], counts: Counts) -> None:
    """Be the controller."""
    logging.getLogger("can").setLevel(logging.ERROR)
    with can.Bus(**bus_options) as bus:
        Controller(bus, counts).run()
    counts.state.value = ENDED


@dataclass(frozen=True, slots=True)
class Health:
    """The loop's process at one moment.

    Attributes:
        memory: resident [MB].
        files: open.
        drift: clock minus ticks, as a time [ms].
        overruns: so far.
        unanswered: SDO requests without an answer so far.
    """

    memory: float
    files: int
    drift: float
    overruns: int
    unanswered: int

    def row(self) -> str:
        """Return the middle of its line in the table."""
        return f"| {self.memory:.1f} | {self.files} | {self.drift:+.1f} | {self.overruns} |"


def examine(pid: int, start: float, statistics: TickStatistics, counts: Counts) -> Health:
    """Return the health of the loop, from another process."""
    status = Path(f"/proc/{pid}/status").read_text("ascii").splitlines()
    memory = next(int(line.split()[1]) for line in status if line.startswith("VmRSS:")) / 1024
    ticks = statistics.ticks + statistics.skipped
    return Health(
        memory=memory,
        files=len(os.listdir(f"/proc/{pid}/fd")),  # noqa: PTH208 - shorter
        drift=(time.monotonic() - start) * 1e3 - ticks * PERIOD * 1e3,
        overruns=statistics.overruns,
        unanswered=counts.syncs.value + len(NODE_IDS) - counts.answers.value,
    )


def watch(pid: int, minutes: float, statistics: TickStatistics, counts: Counts) -> None:
    """Print a line a minute, then tell the controller to end."""
    print("| minute | RSS [MB] | files | clock - ticks [ms] | overruns | frames/s | unanswered |")
    print("|---|---|---|---|---|---|---|", flush=True)
    while not counts.syncs.value:
        time.sleep(0.01)
    start = time.monotonic() - (statistics.ticks + statistics.skipped) * PERIOD
    begin, frames = time.monotonic(), counts.sent.value + counts.received.value
    for minute in range(1, math.ceil(minutes) + 1):
        time.sleep(max(begin + min(minute, minutes) * MINUTE - time.monotonic(), 0.0))
        health = examine(pid, start, statistics, counts)
        rate = (counts.sent.value + counts.received.value - frames) / (time.monotonic() - begin)
        print(f"| {minute} {health.row()} {rate:.0f} | {health.unanswered} |", flush=True)
    counts.state.value = ENDING


@contextlib.contextmanager
def opened_bus(channel: str) -> Iterator[dict[str, Any]]:
    """Yield how python-can opens the bus: a SocketCAN interface, or a hub of its own."""
    if channel:
        yield {"interface": "socketcan", "channel": channel}
        return
    with HubProcess(port=0) as hub:
        yield {
            "interface": "socketcand",
            "channel": "can0",
            "host": hub.host,
            "port": hub.port,
            "tcp_tune": True,
        }


def run_loop(
    bus_options: dict[str, Any],
    statistics: TickStatistics,
    counts: Counts,
    policy: RealtimePolicy,
) -> RunReport:
    """Run the bench from when the controller is there until it has ended."""
    options = dict(bus_options)
    interface, channel = options.pop("interface"), options.pop("channel")
    transport = open_transport(interface, channel, None, options)
    config = load_config()
    while counts.state.value != READY:
        time.sleep(0.01)
    try:
        return run_paced(
            open_session(config),
            transport,
            Pacer(MonotonicClock(), config.tick_ns, statistics=statistics),
            stopped=lambda: counts.state.value == ENDED,
            realtime=RealtimeConfig(policy=policy),
        )
    finally:
        transport.close()


def main() -> int:
    """Print the table, then what passed the loop; return 1 where frames are missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--channel", default="", help="a SocketCAN interface in place of a hub")
    parser.add_argument("--realtime", choices=[*RealtimePolicy], default=RealtimePolicy.OFF)
    arguments = occasion.arguments(parser, minutes=0.03)
    logging.getLogger("can").setLevel(logging.ERROR)  # it warns of each frame that comes in halves
    context = multiprocessing.get_context("spawn")
    statistics = TickStatistics(is_shared=True)
    counts = Counts(*(context.RawValue(ctypes.c_uint64, 0) for _ in range(6)))
    with opened_bus(arguments.channel) as bus_options:
        watcher = (os.getpid(), arguments.minutes, statistics, counts)
        processes = [
            context.Process(target=control, args=(bus_options, counts), daemon=True),
            context.Process(target=watch, args=watcher, daemon=True),
        ]
        for process in processes:
            process.start()
        report = run_loop(bus_options, statistics, counts, RealtimePolicy(arguments.realtime))
    print("\n" + "\n".join(summary_lines(report, counts)))
    is_whole = not missing_frames(report, counts) and not unanswered_syncs(counts)
    return int(report.lost is not None or not is_whole)


def missing_frames(report: RunReport, counts: Counts) -> int:
    """Count the frames that one side sent and the other did not get, both ways."""
    to_bench = counts.sent.value - report.frames.received
    return abs(to_bench) + abs(report.frames.sent - counts.received.value)


def unanswered_syncs(counts: Counts) -> int:
    """Count the TPDOs that are missing, or too many, for one of each device a SYNC."""
    return abs(len(NODE_IDS) * counts.syncs.value - counts.tpdos.value)


def summary_lines(report: RunReport, counts: Counts) -> list[str]:
    """Return the figures of the whole run, a line a fact."""
    ticks, late = report.ticks, report.ticks.lateness
    return [
        (
            f"{counts.syncs.value} SYNCs, {counts.tpdos.value} TPDOs, "
            f"{unanswered_syncs(counts)} missing; {counts.answers.value} answers"
        ),
        (
            f"{counts.sent.value} frames to the bench, {report.frames.sent} from it, "
            f"{missing_frames(report, counts)} missing; bus {report.lost or 'not lost'}"
        ),
        f"{ticks.ticks} ticks, {ticks.overruns} overruns, {ticks.skipped} skipped",
        (
            f"lateness p50 {late.p50_us:.0f}, p99 {late.p99_us:.0f}, p99.9 {late.p999_us:.0f}, "
            f"max {late.max_us:.0f} us"
        ),
    ]


if __name__ == "__main__":
    sys.exit(main())
