"""Runs of a campaign from a snapshot behind the boot-up, beside runs from the start.

    python benchmarks/snapshots.py
    python benchmarks/snapshots.py --kind library --runs 100 --seconds 5.0

The example in C drives, as it is flashed on a simulated STM32F407 or as a library; the supply sags
in the last quarter of each run, by another pressure. Batches take turns; their results must be the
same.
"""

import argparse
import statistics
import sys
import tempfile
import time
from pathlib import Path

import occasion
from controllers import build
from hil_bench.abilities.campaign.plan import make_spec, own_case, space_of
from hil_bench.abilities.campaign.records import RunSpec
from hil_bench.abilities.campaign.snapshot import Snapshots, perform
from hil_bench.abilities.campaign.table import digest_of
from hil_bench.abilities.scenario.load import load_scenario

SCENARIO = """
title = "The supply sags while the example drives"
bench = "bench.toml"
duration_s = {seconds}

[controller]
kind = "{kind}"
{keys}

[parameters]
sag_bar = {{ value = 60.0, range = [20.0, 150.0] }}

[[step]]
at_s = {late}
fault = "drop_supply"
target = "axis1"
pressure_bar = "sag_bar"

[[expect]]
id = "T-1"
that = "always abs(axis1.position) < 60 mm"
"""
KEYS = {
    "elf": 'program = "stm32f4.elf"\nchip = "STM32F407"',
    "library": 'library = "libposition_control.so"\nsettings = { targets_mm = "50,-50,50,-50" }',
}


def main() -> int:
    """Print the time of a run of both; return 1 where a result differs."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--kind", choices=KEYS, default="elf")
    parser.add_argument("--runs", type=int, default=12, help="of each batch")
    parser.add_argument("--seconds", type=float, default=1.2, help="bench time of a run")
    parser.add_argument("--turns", type=int, default=3)
    args = occasion.arguments(parser, runs=3, seconds=0.4, turns=1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        build(folder)
        if args.kind == "elf" and not (folder / "stm32f4.elf").exists():
            occasion.missing("the kind elf", "the chip's program is not built")
        runs = prepare(folder, args.kind, args.runs, args.seconds)
        return compare(runs, args.turns)


def prepare(folder: Path, kind: str, count: int, seconds: float) -> list[RunSpec]:
    """Return the runs."""
    tick_us = 500 if kind == "elf" else 1000
    (folder / "bench.toml").write_text(f"[bench]\ntick_us = {tick_us}\n", encoding="utf-8")
    path = folder / "sag.scenario.toml"
    late = 0.75 * seconds
    text = SCENARIO.format(seconds=seconds, late=late, kind=kind, keys=KEYS[kind])
    path.write_text(text, encoding="utf-8")
    scenario = load_scenario(path)
    case, space = own_case(scenario), space_of(scenario)
    sags = [20.0 + 130.0 * number / count for number in range(count)]
    return [make_spec(case, {"sag_bar": sag}, space, None, 600.0) for sag in sags]


def compare(runs: list[RunSpec], turns: int) -> int:
    """Do all runs both ways, in turns; return 1 where a result differs."""
    perform(runs[0])  # compiles the plant
    times: dict[str, list[float]] = {"from the start": [], "from a snapshot": []}
    digests = set()
    for _ in range(turns):
        snapshots = Snapshots()
        ways = perform, snapshots.perform
        try:
            for taken, do in zip(times.values(), ways, strict=True):
                begin = time.perf_counter()
                digests.add(digest_of([do(run) for run in runs]))
                taken.append((time.perf_counter() - begin) / len(runs))
        finally:
            snapshots.close()
    print(f"{len(runs)} runs of each batch, median of {turns} turns")
    for name, each in times.items():
        least, middle, most = min(each), statistics.median(each), max(each)
        print(f"{name}: {middle * 1e3:.0f} ms a run ({least * 1e3:.0f} to {most * 1e3:.0f})")
    alone, quick = (statistics.median(each) for each in times.values())
    print(f"{alone / quick:.1f} times as quick; {len(digests)} digest of all results")
    return 0 if len(digests) == 1 else 1


if __name__ == "__main__":
    sys.exit(main())
