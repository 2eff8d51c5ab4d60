"""Strange machines: is what is estimated from their records a prediction of what was not fitted?

Run: `python benchmarks/identification_strangers.py [NUMBER ...] [--by verb plain line linear]
[--machines N] [--seed SEED] [--folder DIR]`.

The machines are those of `tests/support/strange_machines.py`: a plant that is not the bench's, with
sensors and a logger. Each gives three files, an amplitude each with four strokes each way, and six
strokes at amplitudes between and above these, which are kept apart. An estimate gets the files and
the owner's data sheet, and predicts the strokes kept apart from their command and their state at
the start. A machine counts as predicted where the root mean square over these strokes is within
1.5 % of speed, 0.5 bar + 1 % of supply pressure, 10 ms of arrival and 1 mm of position.
Models without pressures are judged by the rest.

| `--by` | |
|---|---|
| `sheet` | the data sheet itself, nothing estimated |
| `line` | the piston's speed as a straight line of the command, each way |
| `linear` | speed as a second-order linear system of the command (SciPy) |
| `plain` | `plain_fit.py`: least squares over whole strokes on the bench's plant |
| `verb` | `hil-bench identify` with these limits as `--require`, and the `bench.toml` it writes |

A machine that is not predicted counts as announced where the verb does not end with exit code 0.

Results are kept in the folder as JSON, and what is there is not done again. Prints Markdown.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import occasion
from hil_bench.abilities.common.arguments import find_cylinder
from hil_bench.bench.configuration import load_config
from linear_models import fit_line, fit_second_order
from plain_fit import fit
from stranger_prediction import (
    LIMITS,
    TICK,
    BenchPlant,
    Errors,
    Predictor,
    Stroke,
    cut_strokes,
    errors_of,
    is_within,
    read_logged,
    together,
)

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.strange_logger import Records, draw_logger, write_records
from support.strange_machines import Stranger, draw, write_sheet
from support.strange_plant import Run

SEED, MACHINES = 30, 40
PATIENCE = 900.0  # [s]


class Case(NamedTuple):
    """A machine, what its owner has of it, and the strokes kept apart."""

    stranger: Stranger
    records: Records
    sheet: Path
    kept: list[Stroke]
    pressures: tuple[str, ...]
    strokes: int | None

    def logged_strokes(self) -> list[Stroke]:
        """Return the strokes of all files, or the first of each file where time is short."""
        files = [cut_strokes(read_logged(one, self.records.columns)) for one in self.records.files]
        return [stroke for file in files for stroke in file[: self.strokes]]


class Estimate(NamedTuple):
    """A model, and what its maker says of it: whether it announces that it will miss."""

    predictor: Predictor
    is_announced: bool = False
    said: str = ""


def make_case(seed: int, number: int, folder: Path, strokes: int | None = None) -> Case:
    """Draw a machine and write its records and its data sheet."""
    stranger = draw(seed, number)
    logger = draw_logger(seed, stranger)
    records = write_records(stranger, logger, folder, seed)
    sheet = folder / "bench.toml"
    sheet.write_text(write_sheet(stranger.sheet), encoding="utf-8")
    kept = [stroke_of(run) for _, run in records.kept]
    return Case(stranger, records, sheet, kept, logger.pressures, strokes)


def stroke_of(run: Run) -> Stroke:
    """Return a run of the strange plant each `TICK`."""
    times = np.arange(0.0, run.time[-1], TICK)
    rows = [np.interp(times, run.time, one) for one in (run.x, run.pressure_a, run.pressure_b)]
    last = np.searchsorted(run.time, times + 1e-9, side="right") - 1
    return Stroke(run.command[last], rows[0], rows[1], rows[2], float(run.supply[0]))


def plant_of(path: Path) -> BenchPlant:
    """Return the plant that a `bench.toml` describes."""
    config = load_config(str(path))
    axis = find_cylinder(config, None, "prediction")
    return BenchPlant(axis.parameters, axis.options, config.dt)


def by_sheet(case: Case) -> Estimate:
    """Take the data sheet as it is."""
    return Estimate(plant_of(case.sheet))


def by_line(case: Case) -> Estimate:
    """Fit a straight line."""
    return Estimate(fit_line(case.logged_strokes()))


def by_second_order(case: Case) -> Estimate:
    """Fit a linear system of second order."""
    return Estimate(fit_second_order(case.logged_strokes()))


def by_plain_fit(case: Case) -> Estimate:
    """Fit the bench's plant plainly."""
    strokes = case.logged_strokes()
    half = [one for number, one in enumerate(strokes) if number % 4 < 2]
    return Estimate(fit(plant_of(case.sheet), half, 1 if case.strokes else 20))


def by_verb(case: Case) -> Estimate:
    """Run `hil-bench identify` as a user would, and take the file that it writes."""
    folder = case.sheet.parent
    output = folder / "identified"
    files = case.records.files[: 1 if case.strokes else None]
    command = [sys.executable, "-m", "hil_bench", "identify", *map(str, files), str(case.sheet)]
    command += ["--columns", str(case.records.columns), "--output", str(output), "--quiet"]
    bars = LIMITS["pressure"] / 1e5 + 0.01 * case.stranger.sheet.supply
    for limit in ("speed 1.5 %", f"pressure {bars:g} bar", "time 10 ms", "position 1 mm"):
        command += ["--require", limit]
    done = subprocess.run(  # noqa: S603 - our own program
        command, capture_output=True, text=True, check=False, timeout=PATIENCE
    )
    said = (done.stderr.strip().splitlines() or [""])[-1]
    written = output / "bench.toml"
    found = plant_of(written) if written.exists() else plant_of(case.sheet)
    return Estimate(found, done.returncode != 0, said)


WAYS: dict[str, Callable[[Case], Estimate]] = {
    "sheet": by_sheet,
    "line": by_line,
    "linear": by_second_order,
    "plain": by_plain_fit,
    "verb": by_verb,
}


def judge(case: Case, way: str) -> dict[str, Any]:
    """Estimate a machine in a way, predict what was kept apart, and say how far it is off."""
    begin = time.process_time() + _children()
    estimate = WAYS[way](case)
    seconds = time.process_time() + _children() - begin
    known = () if way in {"line", "linear"} else case.pressures
    each = [errors_of(one, estimate.predictor(one), known or ("P_A",)) for one in case.kept]
    if not known:
        each = [one._replace(pressure=np.nan) for one in each]
    errors, worst = together(each), Errors(*np.max(each, axis=0).tolist())
    supply = case.stranger.machine.supply
    return {
        "machine": case.stranger.number,
        "way": way,
        "errors": errors._asdict(),
        "worst": worst._asdict(),
        "is_within": bool(is_within(errors, supply)),
        "is_worst_within": bool(is_within(worst, supply)),
        "is_announced": estimate.is_announced,
        "said": estimate.said,
        "effects": case.stranger.effects,
        "seconds": seconds,
    }


def _children() -> float:
    """Return the processor time of ended children [s]."""
    shown = os.times()
    return float(shown.children_user + shown.children_system)


def print_results(results: Sequence[dict[str, Any]], ways: Sequence[str]) -> None:
    """Print a row for each machine and way, and the shares."""
    print("| machine | by | speed | pressure | arrival | position | within | announced | time |")
    print("|---|---|---|---|---|---|---|---|---|")
    for one in results:
        e = Errors(**one["errors"])
        print(
            f"| {one['machine']} | {one['way']} | {e.speed:.2%} | {_bars(e.pressure)} | "
            f"{e.arrival * 1e3:.0f} ms | {e.position * 1e3:.2f} mm | "
            f"{'yes' if one['is_within'] else 'no'} | {'yes' if one['is_announced'] else 'no'} | "
            f"{one['seconds']:.0f} s |"
        )
    print("\n| by | machines | predicted | by their worst stroke | of the others, announced |")
    print("|---|---|---|---|---|")
    for way in ways:
        mine = [one for one in results if one["way"] == way]
        missed = [one for one in mine if not one["is_within"]]
        print(
            f"| {way} | {len(mine)} | {sum(one['is_within'] for one in mine)} | "
            f"{sum(one['is_worst_within'] for one in mine)} | "
            f"{sum(one['is_announced'] for one in missed)} of {len(missed)} |"
        )
    print("\n| by | speed, median | pressure | arrival | position | processor time |")
    print("|---|---|---|---|---|---|")
    for way in ways:
        mine = [one for one in results if one["way"] == way]
        rows = np.array([list(one["errors"].values()) for one in mine])
        speed, pressure, arrival, position = np.median(rows, axis=0)
        print(
            f"| {way} | {speed:.2%} | {_bars(pressure)} | {arrival * 1e3:.0f} ms | "
            f"{position * 1e3:.2f} mm | {np.median([one['seconds'] for one in mine]):.0f} s |"
        )


def _bars(pressure: float) -> str:
    return "" if np.isnan(pressure) else f"{pressure / 1e5:.2f} bar"


def judge_all(args: argparse.Namespace, folder: Path) -> None:
    """Judge all machines in all ways, and print."""
    results = []
    for number in args.numbers or range(args.machines):
        case = None
        for way in args.by:
            path = folder / f"{number:02}-{way}.json"
            if not path.exists():
                case = case or make_case(args.seed, number, folder / f"{number:02}", args.strokes)
                path.write_text(json.dumps(judge(case, way)), encoding="utf-8")
                print(f"machine {number} by {way}", file=sys.stderr, flush=True)
            results.append(json.loads(path.read_text(encoding="utf-8")))
    print(f"seed {args.seed}, machines {', '.join(str(one) for one in args.numbers) or 'all'}\n")
    print_results(results, args.by)


def main() -> None:
    """Draw, estimate, predict and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("numbers", nargs="*", type=int, metavar="NUMBER", help="of machines")
    parser.add_argument("--machines", type=int, default=MACHINES)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--by", nargs="+", choices=WAYS, default=list(WAYS), metavar="WAY")
    parser.add_argument("--folder", type=Path, help="for records and results")
    args = occasion.arguments(parser, machines=1, by=["sheet", "line", "linear", "plain"])
    args.strokes = 2 if args.brief else None
    if args.folder:
        args.folder.mkdir(parents=True, exist_ok=True)
        judge_all(args, args.folder)
    else:
        with tempfile.TemporaryDirectory() as name:
            judge_all(args, Path(name))


if __name__ == "__main__":
    main()
