"""Controllers of each kind beside the bench alone: times real time, and one hash of twenty runs.

    python benchmarks/controllers.py
    python benchmarks/controllers.py --seconds 60 --turns 7 --kinds library program

All drive the same axis by the same law: the example in C at 1 kHz as a library, as a program on the
bench's clock and as a process in lock-step over the hub, the example in Python at 500 Hz. The bench
alone is the bench with the frames of the library's run, both ways, and nobody who computes them.
Kinds take turns, so that a machine that becomes slower does so for all.
"""

import argparse
import hashlib
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
KINDS: Final = ("library", "program", "process", "python")
TICK: Final = 1_000_000
DWELL_MS: Final = 500  # at each target

PYTHON: Final = """
from hil_bench.abilities.controllers.python.examples import ControllerSettings, position_control

def control(rig):
    return position_control(rig, ControllerSettings())
"""


def build(folder: Path) -> None:
    """Build the example as a program and as a library, and write the one in Python."""
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    }
    for name in ("position_control", "libposition_control.so"):
        words = ["make", "--silent", "-C", str(FIRMWARE), f"BUILD={folder}", f"{folder}/{name}"]
        subprocess.run(words, check=True, env=environment)  # noqa: S603 - our own program
    (folder / "example.py").write_text(PYTHON, encoding="utf-8")


def table(kind: str, folder: Path, seconds: float) -> dict[str, object]:
    """Return the table of a controller that drives to and fro for so long."""
    count = min(16, max(1, round(seconds)))  # the example takes sixteen
    targets = ",".join(["50", "-50"] * (count // 2) + ["50"] * (count % 2))
    dwell = max(DWELL_MS, round(seconds * 1e3 / count))
    program = [str(folder / "position_control"), "--bus", "{bus}", "--targets-mm", targets]
    program += ["--dwell-ms", str(dwell)]
    match kind:
        case "library":
            settings = {"targets_mm": targets, "dwell_ms": dwell}
            library = str(folder / "libposition_control.so")
            return {"kind": kind, "library": library, "settings": settings}
        case "program":
            return {"kind": kind, "command": program}
        case "process":
            return {"kind": kind, "command": [*program, "--lockstep"]}
        case _:
            return {"kind": kind, "call": f"{folder / 'example.py'}:control"}


class Run:
    """A run of the bench for some time.

    Args:
        seconds: of bench time.
        controller: its table; None for none.
        frames: those that the bench is given instead, by tick.

    Attributes:
        speed: times real time.
        digest: of all frames and of the piston's way.
        frames: those that the controller sent, by tick.
    """

    def __init__(
        self,
        seconds: float,
        controller: Mapping[str, object] | None = None,
        frames: Mapping[int, Sequence[Frame]] | None = None,
    ) -> None:
        tables = {"controllers": {"c": controller}} if controller else {}
        config, given = load_config(tables=tables), frames or {}
        ticks = round(seconds * 1e3)
        with VirtualBench(config, recorded_time=seconds, logged_frames=ticks * 40) as bench:
            session = bench.session
            session.tick((), 0)
            session.tick(given.get(1, ()), TICK)  # starts the controller
            begin = time.perf_counter()
            for tick in range(2, ticks):
                session.tick(given.get(tick, ()), tick * TICK)
            self.speed = seconds / (time.perf_counter() - begin)
            digest = hashlib.sha256(bench.signals.tobytes())
            digest.update(repr([tuple(each) for each in bench.frames]).encode())
            self.digest = digest.hexdigest()[:16]
            heard = [each for each in bench.frames if each.is_received]
            self.frames = {
                now // TICK: [each.frame for each in group]
                for now, group in groupby(heard, key=lambda each: each.now)
            }
            self.way = float(abs(bench.signals["axis1.position"]).max())


def compare(kinds: Sequence[str], folder: Path, seconds: float, turns: int) -> None:
    """Print the speed of each kind beside the bench alone, in turns, and its share of it.

    Raises:
        SystemExit: the axis did not move.
    """
    frames = Run(seconds, table("library", folder, seconds)).frames
    makers: dict[str, Callable[[], Run]] = {"bench alone": lambda: Run(seconds, frames=frames)}
    for kind in kinds:
        makers[kind] = lambda kind=kind: Run(seconds, table(kind, folder, seconds))  # type: ignore[misc]
    speeds: dict[str, list[float]] = {name: [] for name in makers}
    for _ in range(turns):
        for name, make in makers.items():
            run = make()
            if run.way < 0.02:
                raise SystemExit(f"{name}: did not move: {run.way * 1e3:.1f} mm")
            speeds[name].append(run.speed)
    alone = statistics.median(speeds["bench alone"])
    print(f"{seconds:g} s of bench time, median of {turns} turns")
    print("| | times real time | least and most | share of the bench alone |")
    print("|---|---|---|---|")
    for name, each in speeds.items():
        middle = statistics.median(each)
        print(
            f"| {name} | {middle:.1f} | {min(each):.1f} to {max(each):.1f} | {middle / alone:.2f} |"
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
        return 1 if list(repeat(args.kinds, folder, min(args.seconds, 2.0), args.runs)) else 0


if __name__ == "__main__":
    sys.exit(main())
