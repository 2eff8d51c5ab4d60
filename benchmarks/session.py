"""Benchmark of a session: cost of a tick and of a start, beside another checkout of this project.

    python benchmarks/session.py --against CHECKOUT [--here CHECKOUT] [--ticks N] [--turns N]

Processor time a tick, and of a `hil-bench run` of 20 ticks with its start; medians of turns that
both checkouts take one after the other, each in a new process, so that a busy machine is fair to
both. All in virtual time, with the valve's RPDO and a SYNC in each tick: `VirtualBench` on its
embedded bus, the same joined to a controller in lock-step, and recorded in a file.
`hil-bench run --speed max` is the paced loop, on a silent bus.
"""

import argparse
import contextlib
import io
import itertools
import os
import resource
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import can

import occasion
from hil_bench.abilities.doctor.machine import SilentTransport
from hil_bench.bench.virtual_bench import VirtualBench
from hil_bench.canopen_device.frame import Frame
from hil_bench.cli import main as hil_bench

SYNC = Frame(0x080)
START_ALL = Frame(0x000, b"\x01\x00")
ROOT = Path(__file__).parents[1]


def setpoint(number: int) -> Frame:
    """Return the RPDO of the valve in a tick."""
    return Frame(0x201, struct.pack("<Hh", 7, 8192 if number // 500 % 2 else -8192))


class Controller(SilentTransport):
    """A bus on which a set-point and a SYNC always wait."""

    def __init__(self) -> None:
        self._numbers = itertools.count()

    def wait(self, timeout: float) -> bool:  # noqa: ARG002 - the protocol's
        """Return True."""
        return True

    def receive(self, limit: int) -> list[Frame]:  # noqa: ARG002 - the protocol's
        """Return the frames of a tick."""
        number = next(self._numbers)
        return [setpoint(number), SYNC] if number else [START_ALL]


def in_virtual_time(ticks: int, record: Sequence[Path] = ()) -> float:
    """Return the processor time a tick of a bench on its embedded bus [us]."""
    with VirtualBench(record=record[0]) if record else VirtualBench() as bench:
        bench.run(0.01)
        frames = [message(START_ALL), *(message(setpoint(number)) for number in range(1000))]
        sync = message(SYNC)
        bench.bus.send(frames.pop(0))
        began = time.process_time()
        for number in range(ticks):
            bench.bus.send(frames[number % 1000])
            bench.bus.send(sync)
            bench.run(0.001)
        return (time.process_time() - began) * 1e6 / ticks


def message(frame: Frame) -> can.Message:
    """Return a frame for the embedded bus."""
    return can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False)


def in_lockstep(ticks: int) -> float:
    """Return the processor time a tick of a bench that SYNC moves [us]."""
    with VirtualBench() as bench:
        bench.join(Controller(), check=lambda: None)
        bench.run(0.01)
        began = time.process_time()
        bench.run(ticks * 1e-3)
        return (time.process_time() - began) * 1e6 / ticks


def recorded(ticks: int) -> float:
    """Return the processor time a tick of a bench that writes a recording [us]."""
    with tempfile.TemporaryDirectory() as folder:
        return in_virtual_time(ticks, [Path(folder) / "run.mf4"])


def paced(ticks: int) -> float:
    """Return the processor time a tick of the paced loop [us]: of a long run less a short one."""

    def run(count: int) -> float:
        words = [
            "-i",
            "virtual",
            "-c",
            "session",
            "--speed",
            "max",
            "--duration",
            f"{count / 1000}",
        ]
        began = time.process_time()
        with contextlib.redirect_stdout(io.StringIO()):
            hil_bench(["-q", "run", *words])
        return time.process_time() - began

    run(1000)
    short = run(1000)
    return (run(1000 + ticks) - short) * 1e6 / ticks


def start(ticks: int) -> float:  # noqa: ARG001 - as every way
    """Return the processor time of a run of 20 ms from its start to its end [us]."""
    words = ["-q", "run", "-i", "virtual", "-c", "session", "--speed", "max", "--duration", "0.02"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(  # noqa: S603 - this project
        [sys.executable, "-m", "hil_bench", *words], check=True, stdout=subprocess.DEVNULL
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime) * 1e6


WAYS: dict[str, Callable[[int], float]] = {
    "embedded": in_virtual_time,
    "embedded, recorded": recorded,
    "lock-step": in_lockstep,
    "paced": paced,
    "start": start,
}


def measure(checkout: Path, way: str, ticks: int) -> float:
    """Return the result of a new process of a checkout [us]."""
    command = [sys.executable, "-P", __file__, "--way", way, "--ticks", str(ticks)]
    folders = (checkout, checkout / "drivers", Path(__file__).parent)  # the last for `occasion`
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, folders))}
    done = subprocess.run(  # noqa: S603 - this program
        command, env=environment, cwd=checkout, check=True, capture_output=True, text=True
    )
    return float(done.stdout)


def main() -> None:
    """Print the figures as a Markdown table, or those of one way as a number."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--here", type=Path, default=ROOT)
    parser.add_argument("--ticks", type=int, default=20_000)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--way", choices=WAYS, help=argparse.SUPPRESS)
    args = occasion.quiet_arguments(parser, against=ROOT, ticks=50, turns=1)
    if args.way:
        print(WAYS[args.way](args.ticks))
        return
    if args.against is None:
        parser.error("--against: give another checkout of this project")
    occasion.print_occasion(args)
    print(
        "| | there [us] | here [us] | ratio, lowest and highest of the turns |\n|---|---|---|---|"
    )
    for way in WAYS:
        pairs = [
            (measure(args.against, way, args.ticks), measure(args.here, way, args.ticks))
            for _ in range(args.turns)
        ]
        there, here = (statistics.median(column) for column in zip(*pairs, strict=True))
        ratios = [after / before for before, after in pairs]
        spread = f"{statistics.median(ratios):.3f}, {min(ratios):.3f} to {max(ratios):.3f}"
        print(f"| {way} | {there:.1f} | {here:.1f} | {spread} |", flush=True)


if __name__ == "__main__":
    main()
