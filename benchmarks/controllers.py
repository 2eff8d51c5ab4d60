"""Controllers of each kind beside the bench alone: times real time, and one hash of twenty runs.

    python benchmarks/controllers.py
    python benchmarks/controllers.py --seconds 60 --turns 7 --kinds library program

All drive the same axis by the same law: the example in C at 1 kHz as a library, as a program on the
bench's clock, as a process in lock-step over the hub and as flashed on a simulated STM32F407, which
sleeps between five interrupts by CAN a millisecond; the example in Python at 500 Hz. A chip has a
phase of its own, so its bench has a tick of half its cycle. The bench alone is the bench with the
frames of the library's run, both ways, and nobody who computes them. Kinds take turns, so that a
machine that becomes slower does so for all; on a busy one compare the bench's processor time, whose
least of all turns is shown. Python collects no cycles meanwhile: it would in some runs and not in
others, for what those before have left, at twice the time of a tick.
"""

import argparse
import gc
import hashlib
import math
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Final

import occasion
from hil_bench import VirtualBench, load_config
from hil_bench.canopen_device.frame import Frame

FIRMWARE: Final = Path(__file__).parents[1] / "examples/firmware"
KINDS: Final = ("library", "program", "process", "elf", "python")
TICK: Final = 1_000_000
TICKS: Final = {"elf": 500_000}
DWELL_MS: Final = 500  # at each target

PYTHON: Final = """
from hil_bench.abilities.controllers.python.examples import ControllerSettings, position_control

def control(rig):
    return position_control(rig, ControllerSettings())
"""
LISTENERS: Final = """
from can import Message

def heartbeat(rig):
    while True:
        rig.bus.send(Message(arbitration_id=0x70A, data=[5], is_extended_id=False))
        rig.sleep(0.0105)

def reader(rig):
    rig.sleep(0.5)  # until the other has set its devices up
    while True:
        data = [0x40, 4, 0x60, 0, 0, 0, 0, 0]
        rig.bus.send(Message(arbitration_id=0x604, data=data, is_extended_id=False))
        while (answer := rig.bus.recv(0.01)) is not None and answer.arbitration_id != 0x584:
            pass
        rig.sleep(0.0033)
"""


def build(folder: Path) -> None:
    """Build the example as a program and as a library, and write the one in Python."""
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    }
    names = ["position_control", "libposition_control.so"]
    if shutil.which("arm-none-eabi-gcc"):
        names.append("stm32f4.elf")
    else:
        occasion.missing("the kind elf", "there is no arm-none-eabi-gcc")
    targets = f"TARGETS_MM={','.join(['50', '-50'] * 8)}"
    for name in names:
        goal = f"{folder}/{name}"
        words = ["make", "--silent", "-C", str(FIRMWARE), f"BUILD={folder}", targets, goal]
        subprocess.run(words, check=True, env=environment)  # noqa: S603 - our own program
    (folder / "example.py").write_text(PYTHON, encoding="utf-8")
    (folder / "listeners.py").write_text(LISTENERS, encoding="utf-8")


def table(kind: str, folder: Path, seconds: float) -> dict[str, object]:
    """Return the table of a controller that drives to and fro for so long."""
    count = min(16, max(1, round(seconds)))  # the example takes sixteen
    targets = ",".join(["50", "-50"] * (count // 2) + ["50"] * (count % 2))
    dwell = max(DWELL_MS, round(seconds * 1e3 / count))
    command = [str(folder / "position_control"), "--bus", "{bus}", "--targets-mm", targets]
    command += ["--dwell-ms", str(dwell)]
    match kind:
        case "library":
            settings = {"targets_mm": targets, "dwell_ms": dwell}
            library = str(folder / "libposition_control.so")
            return {"kind": kind, "library": library, "settings": settings}
        case "program":
            return {"kind": kind, "command": command}
        case "process":
            return {"kind": kind, "command": [*command, "--lockstep"]}
        case "elf":
            program = str(folder / "stm32f4.elf")
            return {"kind": kind, "program": program, "chip": "STM32F407"}
        case _:
            return {"kind": kind, "call": f"{folder / 'example.py'}:control"}


class Run:
    """A run of the bench for some time.

    Args:
        seconds: of bench time.
        controller: its table; None for none.
        frames: those that the bench is given instead, by tick.
        others: tables of further controllers, by name.

    Attributes:
        speed: times real time.
        used: processor time of the bench's process a tick [us].
        digest: of all frames and of the piston's way.
        frames: those that the controller sent, by tick.
    """

    def __init__(
        self,
        seconds: float,
        controller: Mapping[str, object] | None = None,
        frames: Mapping[int, Sequence[Frame]] | None = None,
        others: Mapping[str, object] | None = None,
    ) -> None:
        tables: dict[str, Mapping[str, object]] = {}
        if controller:
            tables["controllers"] = {"c": controller, **(others or {})}
        tick_ns = TICKS.get(str(controller["kind"]), TICK) if controller else TICK
        tables["bench"] = {"tick_us": tick_ns // 1000}
        config, given = load_config(tables=tables), frames or {}
        ticks = round(seconds * 1e9 / tick_ns)
        with VirtualBench(config, recorded_time=seconds, logged_frames=ticks * 40) as bench:
            session = bench.session
            session.tick((), 0)
            session.tick(given.get(1, ()), tick_ns)  # starts the controller
            gc.collect()
            gc.disable()
            begin, before = time.perf_counter(), time.process_time()
            for tick in range(2, ticks):
                session.tick(given.get(tick, ()), tick * tick_ns)
            self.speed = seconds / (time.perf_counter() - begin)
            self.used = (time.process_time() - before) / ticks * 1e6
            gc.enable()
            digest = hashlib.sha256(bench.signals.tobytes())
            digest.update(repr([tuple(each) for each in bench.frames]).encode())
            self.digest = digest.hexdigest()[:16]
            heard = [each for each in bench.frames if each.is_received]
            last = heard[-1].now * 1e-9 if heard else 0.0
            if controller and last < seconds - 0.1:
                raise RuntimeError(
                    f"{controller['kind']}: silent from {last:g} s on; who ended it?"
                )
            self.frames = {
                now // tick_ns: [each.frame for each in group]
                for now, group in groupby(heard, key=lambda each: each.now)
            }
            self.way = float(abs(bench.signals["axis1.position"]).max())


def compare(kinds: Sequence[str], folder: Path, seconds: float, turns: int) -> None:
    """Print speed and processor time of each kind beside the bench alone, in turns, and its share.

    Raises:
        SystemExit: the axis did not move.
    """
    frames = Run(seconds, table("library", folder, seconds)).frames
    makers: dict[str, Callable[[], Run]] = {"bench alone": lambda: Run(seconds, frames=frames)}
    for kind in kinds:
        makers[kind] = lambda kind=kind: Run(seconds, table(kind, folder, seconds))  # type: ignore[misc]
    speeds: dict[str, list[float]] = {name: [] for name in makers}
    used: dict[str, float] = dict.fromkeys(makers, math.inf)
    for _ in range(turns):
        for name, make in makers.items():
            run = make()
            if run.way < 0.02:
                raise SystemExit(f"{name}: did not move: {run.way * 1e3:.1f} mm")
            speeds[name].append(run.speed)
            used[name] = min(used[name], run.used)
    print(f"{seconds:g} s of bench time, median of {turns} turns")
    print("| | times real time | least and most | bench's processor, us a tick | share |")
    print("|---|---|---|---|---|")
    for name, each in speeds.items():
        share = used["bench alone"] / used[name]
        print(
            f"| {name} | {statistics.median(each):.1f} | {min(each):.1f} to {max(each):.1f} "
            f"| {used[name]:.1f} | {share:.2f} |"
        )


def repeat(kinds: Sequence[str], folder: Path, seconds: float, runs: int) -> Iterator[str]:
    """Print the hashes of several runs of each kind.

    Yields:
        The kinds with more than one.
    """
    for kind in kinds:
        digests = {Run(seconds, table(kind, folder, seconds)).digest for _ in range(runs)}
        print(f"{kind}: {len(digests)} hash of {runs} runs: {', '.join(sorted(digests))}")
        if len(digests) > 1:
            yield kind


def repeat_together(folder: Path, seconds: float, runs: int) -> Iterator[str]:
    """Print the hashes of several runs of three controllers on one bus.

    Yields:
        Their name, where there is more than one.
    """
    others = {
        name: {"kind": "python", "call": f"{folder / 'listeners.py'}:{name}"}
        for name in ("heartbeat", "reader")
    }
    law = table("library", folder, seconds)
    digests = {Run(seconds, law, others=others).digest for _ in range(runs)}
    print(f"three on one bus: {len(digests)} hash of {runs} runs: {', '.join(sorted(digests))}")
    if len(digests) > 1:
        yield "three on one bus"


def main() -> int:
    """Print all figures; return 1 where a kind has more than one hash."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=20.0, help="bench time of a run")
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--runs", type=int, default=20, help="of each kind, for the hashes")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    args = occasion.arguments(parser, seconds=1.0, turns=1, runs=2)
    if not (shutil.which("make") and shutil.which("cc")):
        occasion.missing("all kinds in C", "there is no make, or no C compiler")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        build(folder)
        compare(args.kinds, folder, args.seconds, args.turns)
        seconds = min(args.seconds, 2.0)
        differ = list(repeat(args.kinds, folder, seconds, args.runs))
        differ += repeat_together(folder, seconds, args.runs)
        return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main())
