"""A public record of real actuators: is a stroke at another supply pressure predicted?

Run: `python benchmarks/identification_public.py FOLDER [--actuators Act_1 ...]`.

The folder is the `Data` of https://github.com/vtnsi/actuator_dataset (MIT licence, 2025, Virginia
Tech National Security Institute): strokes from stop to stop of hydraulic rotary actuators, in raw
counts of angle and both pressures, 1,000 rows a second here. Nothing of it is kept in this project.
The valve is on or off, and the supply is an accumulator that runs down from stroke to stroke, by a
quarter and more, until it is charged again. Its pressure before a stroke is that of the driving
chamber at the end of the stroke before.

A rotary actuator is a cylinder of equal areas here: a count of angle stands for 10 um, one of
pressure for 1 kPa. The strokes at the higher supply pressures are fitted, a dozen of them, and
those at the lower ones predicted: from angle and pressures in their first row and the supply
pressure before. A straight line (a speed each way), a linear system of second order and a line of
the root of the supply pressure stand beside it. Prints Markdown.
"""

import argparse
import re
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

import occasion
from hil_bench.plants.hydraulic_cylinder.model import EndStop, PlantOptions, paper_parameters
from linear_models import Line, fit_line, fit_second_order
from plain_fit import fit
from stranger_prediction import (
    BenchPlant,
    Predictor,
    Shown,
    Stroke,
    Values,
    errors_of,
    together,
)

ACTUATORS = ("Act_1", "Act_2", "Act_5")
COUNT, PRESSURE = 1e-5, 1e3  # [m], [Pa] of a count
ROWS = 700
COLUMNS = (4, 8, 9)  # angle, P_A, P_B
FITTED = 12


def read_strokes(folder: Path) -> list[Stroke]:
    """Return the strokes of an actuator whose supply pressure is known from the one before."""
    tables: dict[int, Values] = {}
    for path in folder.glob("*.txt"):
        number = re.search(r"_000_(\d+)_", path.name)
        lines = path.read_text(encoding="latin-1").splitlines()[1:]
        rows = [line.split("\t") for line in lines]
        if number is not None:
            kept = [[float(row[at]) for at in COLUMNS] for row in rows if len(row) > 10 and row[4]]
            tables[int(number[1])] = np.array(kept)
    strokes = []
    for number, table in sorted(tables.items()):
        before = tables.get(number - 1)
        if before is None or min(len(table), len(before)) < 2 * ROWS:
            continue
        supply = PRESSURE * float(before[2 * ROWS - 50 : 2 * ROWS, 1:].max(axis=1).mean())
        x = COUNT * table[:ROWS, 0]
        way = np.sign(x[-1] - x[0])
        is_next = abs(x[0] - COUNT * before[-1, 0]) < 0.02 * abs(x[-1] - x[0])
        is_charged = PRESSURE * table[ROWS - 50 : ROWS, 1:].max() > supply
        if is_next and not is_charged and abs(x[-1] - x[0]) > 1e-2:
            pressures = PRESSURE * table[:ROWS, 1:]
            strokes.append(Stroke(np.full(ROWS, way), x, *pressures.T, supply))
    middle = np.mean([np.mean([one.x.min(), one.x.max()]) for one in strokes])
    return [one._replace(x=one.x - middle) for one in strokes]


def first_guess(strokes: Sequence[Stroke]) -> BenchPlant:
    """Return a cylinder of about this size, for want of a data sheet."""
    h = float(np.max([np.abs(one.x).max() for one in strokes]))
    supply = float(np.median([one.supply for one in strokes]))
    speed = float(np.median([abs(_speed(one)) for one in strokes]))
    area = 2e-3
    table_1 = paper_parameters()
    known = {
        name: getattr(table_1, name) for name in ("C_d", "rho", "omega_0", "xi", "C_L", "delta")
    }
    width = area * speed / np.sqrt(0.4 * supply) / (known["C_d"] * 1e-3 * np.sqrt(2 / known["rho"]))
    parameters = type(table_1)(
        **known,
        alpha=1e-3,
        beta=0.0,
        w=float(width),
        E=8e8,
        P_S=supply,
        P_T=0.0,
        A_A=area,
        A_B=area,
        V_A0=1.3 * area * h,
        V_B0=1.3 * area * h,
        m=30.0,
        F_c=0.02 * supply * area,
        F_s=0.03 * supply * area,
        sigma=0.02 * supply * area / speed,
        chi=0.02,
        h=h,
    )
    options = PlantOptions(end_stop=EndStop(), cavitation_floor=-101325.0, laminar_transition=300.0)
    return BenchPlant(parameters, options, nominal=supply)


def _speed(stroke: Stroke) -> float:
    """Return the speed in the middle of the way [m/s]."""
    travel = np.abs(stroke.x - stroke.x[0])
    rows = np.flatnonzero((travel > 0.3 * travel[-1]) & (travel < 0.7 * travel[-1]))
    return float(np.polyfit(1e-3 * rows, stroke.x[rows], 1)[0])


def fit_root(strokes: Sequence[Stroke]) -> Predictor:
    """Return a line each way whose speed goes with the root of the supply pressure."""
    line = fit_line(strokes)
    middle = np.mean([np.sqrt(one.supply) for one in strokes])

    def predict(stroke: Stroke) -> Shown:
        factor = float(np.sqrt(stroke.supply) / middle)
        scaled = Line(
            (line.gains[0] * factor, line.gains[1] * factor),
            (line.offsets[0] * factor, line.offsets[1] * factor),
            line.ends,
        )
        return scaled(stroke)

    return predict


def split(strokes: Sequence[Stroke]) -> tuple[list[Stroke], list[Stroke]]:
    """Return some strokes at the higher supply pressures, and all at the lower ones."""
    border = np.median([one.supply for one in strokes])
    high = [one for one in strokes if one.supply > border]
    places = np.unique(np.linspace(0, len(high) - 1, FITTED).astype(int))
    return [high[place] for place in places], [one for one in strokes if one.supply <= border]


def judge(folder: Path, *, is_brief: bool) -> None:
    """Fit and predict an actuator, and print a row a model."""
    strokes = read_strokes(folder)
    fitted, apart = split(strokes)
    evaluations = 1 if is_brief else 15
    models: dict[str, Callable[[], Predictor]] = {
        "straight line": lambda: fit_line(fitted),
        "linear system of second order": lambda: fit_second_order(fitted),
        "line, by the root of the supply pressure": lambda: fit_root(fitted),
        "the bench's plant, `plain_fit.py`": lambda: fit(first_guess(fitted), fitted, evaluations),
    }
    supplies = [np.array([one.supply for one in part]) / PRESSURE for part in (fitted, apart)]
    spans = [f"{part.min():.0f} to {part.max():.0f}" for part in supplies]
    for name, make in models.items():
        model = make()
        errors = [errors_of(one, model(one), ("P_A", "P_B")) for one in apart]
        e = together(errors)
        pressure = "" if np.isnan(e.pressure) else f"{e.pressure / PRESSURE:.0f}"
        cells = (folder.name, *spans, name, f"{e.speed:.1%}", pressure)
        last = f"{e.arrival * 1e3:.0f} ms", f"{e.position / COUNT:.0f}"
        print(f"| {' | '.join((*cells, *last))} |", flush=True)


def made_up(folder: Path) -> None:
    """Write strokes of no actuator in the form of the data set, for a brief run."""
    folder.mkdir()
    for number in range(8):
        way, supply = (-1) ** number, 6000.0 - 100.0 * number
        travel = np.clip(10.0 * np.sqrt(supply / 6000.0) * np.arange(1500), 0.0, 4000.0)
        x = (2000.0 - 2000.0 * way) + way * travel
        ends = np.where(travel < 4000.0, 0.55 * supply, np.where(way > 0, supply, 0.0))
        rows = [
            "\t".join(["0", "0", "0", "0", f"{a:.0f}", "0", "0", "0", f"{p:.0f}", f"{q:.0f}", "0"])
            for a, p, q in zip(x, ends, supply - ends, strict=True)
        ]
        text = "\n".join(["Time", *rows])
        (folder / f"Base_000_{number}_0.txt").write_text(text, encoding="latin-1")


def main() -> None:
    """Fit, predict and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--actuators", nargs="+", default=list(ACTUATORS), metavar="NAME")
    args = occasion.arguments(parser)
    if args.folder is None and not args.brief:
        parser.error("give the folder Data of the data set")
    print("pressures in counts, position as the root mean square in counts of some 4,300\n")
    print(
        "| actuator | supply, fitted | predicted | model | speed | pressure | arrival | position |"
    )
    print("|---|---|---|---|---|---|---|---|")
    if args.folder is not None:
        for name in args.actuators:
            judge(args.folder / name, is_brief=args.brief)
        return
    with tempfile.TemporaryDirectory() as name:
        made_up(Path(name) / "Act_0")
        judge(Path(name) / "Act_0", is_brief=True)


if __name__ == "__main__":
    main()
