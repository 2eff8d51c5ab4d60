"""A long run in lock-step, with a line every some minutes of bench time on its health.

    python benchmarks/soak_lockstep.py [--minutes N]

A controller in a process of its own sends set-point, SYNC and an SDO request in each millisecond of
bench time, through the bench's own hub, and waits for the four TPDOs and the answer. The lines show
what must not grow: resident memory and open files of the bench. At the end both sides' counts of
SYNCs and frames are compared; the exit code is 1 where one is missing, or where bench time is not
the number of SYNCs.
"""

import argparse
import ctypes
import multiprocessing
import os
import socket
import struct
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import occasion
from hil_bench.abilities.controllers.process.hosted_bus import HostedBus
from hil_bench.abilities.lockstep.lockstep import LockStep, LockStepReport, run_lockstep
from hil_bench.bench.configuration import load_config
from hil_bench.bench.session import open_session

NODE_IDS = (1, 2, 3, 4)
READ = bytes.fromhex("4000100000000000")  # 0x1000.00
EACH_SYNC_SENDS_A_TPDO = bytes.fromhex("2f00180201000000")  # 0x1800.02 = 1
MINUTE = 60_000_000_000  # [ns]
LINES = 12


@dataclass(frozen=True, slots=True)
class Counts:
    """The counters of the controller, for the bench to read.

    Attributes:
        sent: frames.
        syncs: SYNCs among them.
        boot_ups: messages of that kind that came.
        tpdos: the same.
        answers: to SDO requests, the same.
        has_ended: 1 once it has all that it waits for.
    """

    sent: Any
    syncs: Any
    boot_ups: Any
    tpdos: Any
    answers: Any
    has_ended: Any


class Controller:
    """The other end of the bus."""

    def __init__(self, port: int, counts: Counts) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port))
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._counts = counts
        self._rest = b""
        for command in (b"< open can0 >", b"< rawmode >"):
            self._hear(1)
            self._socket.sendall(command)
        self._hear(1)

    def run(self, cycles: int) -> None:
        """Send a cycle's frames and await all answers, as often as told."""
        counts = self._counts
        self._hear(len(NODE_IDS))  # boot-ups
        self._say(*((0x600 + node_id, EACH_SYNC_SENDS_A_TPDO) for node_id in NODE_IDS))
        self._hear(len(NODE_IDS))
        self._say((0x000, b"\x01\x00"))
        for number in range(cycles):
            setpoint = 8192 if number // 500 % 2 else -8192
            request = (0x600 + NODE_IDS[number % len(NODE_IDS)], READ)
            self._say((0x201, struct.pack("<Hh", 7, setpoint)), (0x080, b""), request)
            counts.syncs.value += 1
            self._hear(len(NODE_IDS) + 1)
        counts.has_ended.value = 1

    def _say(self, *frames: tuple[int, bytes]) -> None:
        text = [b"< send %03X %d %b >" % (i, len(d), d.hex(" ").encode()) for i, d in frames]
        self._socket.sendall(b"".join(text))
        self._counts.sent.value += len(frames)

    def _hear(self, count: int) -> None:
        """Wait for as many messages, and count them by their kind."""
        counts = self._counts
        while count > 0:
            *messages, self._rest = (self._rest + self._socket.recv(65_536)).split(b">")
            count -= len(messages)
            for message in messages:
                counts.boot_ups.value += message.startswith(b"< frame 70")
                counts.tpdos.value += message.startswith(b"< frame 18")
                counts.answers.value += message.startswith(b"< frame 58")


def control(port: int, cycles: int, counts: Counts) -> None:
    """Be the controller."""
    Controller(port, counts).run(cycles)


def health() -> str:
    """Return resident memory [MB] and open files of this process, as columns."""
    status = Path("/proc/self/status").read_text("ascii").splitlines()
    memory = next(int(line.split()[1]) for line in status if line.startswith("VmRSS:")) / 1024
    files = len(os.listdir("/proc/self/fd"))  # noqa: PTH208 - shorter
    return f"{memory:.1f} | {files}"


def run_bench(hub: HostedBus, minutes: float, counts: Counts) -> LockStepReport:
    """Run the bench until the controller has ended; print a line now and then."""
    print("| bench time [min] | RSS [MB] | files | SYNCs | times real time |", flush=True)
    print("|---|---|---|---|---|", flush=True)
    while not hub.clients:
        hub.wait(0.1)
    config = load_config()
    session = open_session(config)
    session.start()
    hub.send(session.tick([], 0))
    lockstep = LockStep(session, tick_ns=config.tick_ns)
    interval = round(minutes * MINUTE / LINES)
    due, begin = interval, time.monotonic_ns()

    def stopped() -> bool:
        nonlocal due
        now = lockstep.now
        if now >= due:
            due += interval
            speed = now / (time.monotonic_ns() - begin)
            columns = f"{now / MINUTE:.4g} | {health()} | {lockstep.syncs} | {speed:.1f}"
            print(f"| {columns} |", flush=True)
        return bool(counts.has_ended.value)

    return run_lockstep(lockstep, hub, stopped=stopped)


def mistakes(report: LockStepReport, counts: Counts) -> list[str]:
    """Return the deviations from the expected counts, a line a fact."""
    syncs, nodes = counts.syncs.value, len(NODE_IDS)
    facts = {
        "SYNCs of the bench": (report.syncs, syncs),
        "bench time [ns]": (report.now, syncs * load_config().tick_ns),
        "frames to the bench": (report.frames.received, counts.sent.value),
        "TPDOs": (counts.tpdos.value, nodes * syncs),
        "SDO answers": (counts.answers.value, nodes + syncs),
        "frames from the bench": (
            report.frames.sent,
            counts.boot_ups.value + counts.tpdos.value + counts.answers.value,
        ),
    }
    return [
        f"{what}: {found}, right are {right}"
        for what, (found, right) in facts.items()
        if found != right
    ]


def main() -> int:
    """Print the table, then what passed the bus; return 1 where something is missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0, help="of bench time")
    arguments = occasion.arguments(parser, minutes=0.005)
    context = multiprocessing.get_context("spawn")
    counts = Counts(*(context.RawValue(ctypes.c_uint64, 0) for _ in range(6)))
    hub = HostedBus()
    cycles = round(arguments.minutes * MINUTE / load_config().tick_ns)
    controller = context.Process(target=control, args=(hub.port, cycles, counts), daemon=True)
    controller.start()
    report = run_bench(hub, arguments.minutes, counts)
    hub.close()
    wrong = mistakes(report, counts)
    print(
        f"\n{report.syncs} SYNCs, {report.frames.received} frames to the bench, "
        f"{report.frames.sent} from it, {'none missing' if not wrong else 'not all there'}; "
        f"{report.now * 1e-9:.3f} s of bench time in {report.moved:.0f} s"
    )
    for line in wrong:
        print(line, file=sys.stderr)
    return int(bool(wrong) or report.lost is not None)


if __name__ == "__main__":
    sys.exit(main())
