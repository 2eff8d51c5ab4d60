"""Identification of virtual machines: how often do the intervals hold?

Run: `python benchmarks/identification.py [MACHINES] [--results DIR] [--workers N]`.

Each machine has parameters of its own: all that are sought within 30 % of Table I, leakage up to
2e-13 m³/(s Pa), and every third machine oil without air (bulk modulus 0.7 to 1.7 GPa). End stops,
cavitation floor and laminar transition are on, the sensors have noise and the position is rounded
to a micrometre. The search starts at Table I. Each result is kept as a JSON file in the directory
of results, and what is there is not done again. Prints Markdown tables of all results there;
progress goes to standard error.
"""

import argparse
import itertools
import json
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from hil_bench.abilities.identification.unknowns import KINDS
from scipy.stats import binomtest

import occasion
from hil_bench.abilities.analysis.simulation import Setup, simulate
from hil_bench.abilities.analysis.study import make_table
from hil_bench.abilities.identification.identify import identify
from hil_bench.abilities.identification.record import SIGNALS, AxisRecord
from hil_bench.outside.recording.channels import Channel, Recording
from hil_bench.plants.hydraulic_cylinder.model import (
    PlantOptions,
    PlantParameters,
    Solver,
    paper_parameters,
)

MACHINES = 40
STEP, TICK = 5e-5, 1e-3  # [s]
NOISE = {"position": 2e-6, "P_A": 5e3, "P_B": 5e3}  # [m], [Pa]
RESOLUTION = 1e-6  # of the position [m]
FULL_OPENING = paper_parameters().full_opening
# Rounding to steps of q adds noise of q / sqrt(12).
TRUE_NOISE = np.array([np.hypot(NOISE["position"], RESOLUTION / np.sqrt(12.0)), 5e3, 5e3])

Values = npt.NDArray[np.float64]
Result = dict[str, Any]


BRIEF_SOUGHT = ("E",)
"""The only parameter that is drawn and sought with ``--brief``."""


def draw_machine(
    number: int, source: np.random.Generator, sought: Sequence[str] = tuple(KINDS)
) -> PlantParameters:
    """Return the parameters of one machine: those that are sought are its own."""
    table_1 = paper_parameters()
    values = {name: getattr(table_1, name) * source.uniform(0.7, 1.3) for name in sought}
    if "C_L" not in sought:
        return replace(table_1, **values)
    values["F_s"] = max(values["F_s"], 1.1 * values["F_c"])
    values["C_L"] = source.uniform(0.0, 2e-13)
    if number % 3 == 2:
        values["E"] = source.uniform(7e8, 1.7e9)
    return replace(table_1, **values)


def make_setpoints() -> Values:
    """Return the commands of a commissioning run: slow ramps, steps, a chirp, random steps [m]."""
    parts = [_hold(0.0, 0.3)]
    for sign in (1.0, -1.0):
        ramp = np.linspace(0.0, sign * 0.8e-3, round(2.0 / TICK))
        parts += [ramp, ramp[::-1], _hold(0.0, 0.3)]
    for amplitude in (0.4e-3, 0.5e-3, 0.6e-3, 0.8e-3, 1.0e-3, 1.3e-3, 1.9e-3):
        for opening in (amplitude, -amplitude) * 2:
            parts += [_hold(opening, 0.25), _hold(0.0, 0.15)]
    times = np.arange(0.0, 6.0, TICK)
    parts += [0.7e-3 * np.sin(2.0 * np.pi * (1.0 + 59.0 / 12.0 * times) * times), _hold(0.0, 0.2)]
    source = np.random.default_rng(5)
    parts += [_hold(source.uniform(-1e-3, 1e-3), 0.1) for _ in range(60)]
    return np.concatenate([*parts, _hold(0.0, 0.5)])


def record_machine(machine: PlantParameters, source: np.random.Generator) -> Recording:
    """Return the sensor signals of a machine as a recording."""
    setpoints = make_setpoints()
    every = round(TICK / STEP)
    setup = Setup(
        parameters=machine,
        options=PlantOptions.bench(),
        solver=Solver.LINEARLY_IMPLICIT_MIDPOINT,
        dt=STEP,
    )
    run = simulate(setup, np.repeat(setpoints, every), every=every)
    shown = {
        signal: run[name] + NOISE[signal] * source.standard_normal(len(run))
        for signal, name in zip(SIGNALS, ("x", "P_A", "P_B"), strict=True)
    }
    return make_table(
        {
            Channel("time", "s"): run["time"],
            Channel("axis1.position", "m"): RESOLUTION * np.rint(shown["position"] / RESOLUTION),
            Channel("axis1.P_A", "Pa"): shown["P_A"],
            Channel("axis1.P_B", "Pa"): shown["P_B"],
            Channel("axis1.spool_setpoint", "-"): setpoints / FULL_OPENING,
        }
    )


def try_machine(number: int, results: Path, sought: Sequence[str], starts: int) -> None:
    """Identify a machine, and write what was found of it."""
    source = np.random.default_rng(number + 1)
    machine = draw_machine(number, source, sought)
    record = AxisRecord.of(record_machine(machine, source), "axis1", FULL_OPENING)
    start = time.process_time()
    search = {"step": STEP, "names": sought, "starts": starts}
    found = identify(record, paper_parameters(), PlantOptions.bench(), **search)
    result = {
        "machine": number + 1,
        "estimates": {
            estimate.name: {
                "true": getattr(machine, estimate.name),
                "value": estimate.value,
                "deviation": estimate.deviation,
                "interval": list(estimate.interval),
                "is_told": estimate.is_told,
            }
            for estimate in found.estimates
        },
        "first_noise": (record.noise / TRUE_NOISE).tolist(),
        "noise": (found.record.noise / TRUE_NOISE).tolist(),
        "residual": found.residual.tolist(),
        "trial": (found.trial.residual * found.record.noise / TRUE_NOISE).tolist(),
        "is_reached": found.is_reached,
        "is_white": found.is_white,
        "left_out": found.left_out,
        "rivals": [[rival.residual, rival.apart] for rival in found.rivals],
        "processor_s": time.process_time() - start,
    }
    path = results / f"machine-{number + 1:03}.json"
    path.with_suffix(".part").write_text(json.dumps(result, indent=1), encoding="utf-8")
    path.with_suffix(".part").rename(path)
    print(f"{path}: {result['processor_s']:.0f} s of processor", file=sys.stderr, flush=True)


def main() -> None:
    """Identify and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("machines", type=int, nargs="?", default=MACHINES)
    parser.add_argument("--results", type=Path, default=Path("identification-results"))
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--sought", nargs="+", choices=KINDS, default=tuple(KINDS))
    parser.add_argument("--starts", type=int, default=24, help="candidates of the search (24)")
    args = occasion.arguments(parser, machines=1, sought=BRIEF_SOUGHT, starts=1)
    if args.brief:
        with tempfile.TemporaryDirectory() as name:
            run_machines(args, Path(name))
    else:
        args.results.mkdir(parents=True, exist_ok=True)
        run_machines(args, args.results)


def run_machines(args: argparse.Namespace, results: Path) -> None:
    """Identify the machines without a result, and print all results."""
    missing = [
        number
        for number in range(args.machines)
        if not (results / f"machine-{number + 1:03}.json").exists()
    ]
    with ProcessPoolExecutor(args.workers) as pool:
        search = itertools.repeat(args.sought), itertools.repeat(args.starts)
        list(pool.map(try_machine, missing, itertools.repeat(results), *search))
    paths = sorted(results.glob("machine-*.json"))
    print_tables([json.loads(path.read_text(encoding="utf-8")) for path in paths])


def print_tables(tried: list[Result]) -> None:
    """Print what was found of all machines."""
    print(f"{len(tried)} machines, {len(make_setpoints()) * TICK:.1f} s of record each\n")
    print(
        "| | error, median | worst | standard deviation | truth in the 95 % interval "
        "| coverage, with 95 % confidence |"
    )
    print("|---|---|---|---|---|---|")
    names = list(tried[0]["estimates"])
    for name in names:
        print(_row(name, tried))
    position = [result["trial"][0] for result in tried]
    print(
        f"\nposition where nothing was fitted, in multiples of the sensor's noise: median "
        f"{np.median(position):.2f}, worst {max(position):.2f}"
    )
    for key in ("first_noise", "noise"):
        ratios = np.array([result[key] for result in tried])
        print(
            f"{key}, in multiples of the true one (position, P_A, P_B): median "
            f"{np.median(ratios, axis=0).round(3)}, least {ratios.min(axis=0).round(3)}, "
            f"largest {ratios.max(axis=0).round(3)}"
        )
    for key in ("is_reached", "is_white"):
        print(f"{key}: {sum(result[key] for result in tried)} of {len(tried)}")
    apart = sum(bool(result["rivals"]) for result in tried)
    print(f"another start ended elsewhere: {apart} of {len(tried)}")
    left_out = [result["left_out"] for result in tried]
    print(f"pieces left out: median {np.median(left_out):g}, most {max(left_out)}")
    ratios = np.array([ratio for name in names for ratio in _ratios(name, tried)])
    print(
        f"{len(ratios)} errors over their stated deviations: root mean square "
        f"{np.sqrt(np.square(ratios).mean()):.2f}, {(ratios < 1.96).mean():.1%} below 1.96"
    )
    seconds = [result["processor_s"] for result in tried]
    print(f"processor time a machine: median {np.median(seconds):.0f} s, most {max(seconds):.0f} s")


def _told(name: str, tried: list[Result]) -> list[Result]:
    """Return the estimates of a parameter on the machines that tell it."""
    estimates = [result["estimates"][name] for result in tried]
    return [estimate for estimate in estimates if estimate["is_told"]]


def _ratios(name: str, tried: list[Result]) -> list[float]:
    """Return the error of a parameter on each machine, in stated deviations."""
    return [
        abs(estimate["value"] - estimate["true"]) / estimate["deviation"]
        for estimate in _told(name, tried)
    ]


def _row(name: str, tried: list[Result]) -> str:
    """Return the row of a parameter; leakage goes by the largest that was drawn."""
    told = _told(name, tried)
    if not told:
        return f"| {name} | | | | 0 of 0 | |"
    scales = np.array([2e-13 if name == "C_L" else estimate["true"] for estimate in told])
    errors = np.array([abs(estimate["value"] - estimate["true"]) for estimate in told]) / scales
    deviations = np.array([estimate["deviation"] for estimate in told]) / scales
    hits = sum(
        estimate["interval"][0] <= estimate["true"] <= estimate["interval"][1] for estimate in told
    )
    chance = binomtest(hits, len(told)).proportion_ci(0.95)
    return (
        f"| {name} | {100.0 * np.median(errors):.3f} % | {100.0 * max(errors):.3f} % | "
        f"{100.0 * np.median(deviations):.3f} % | {hits} of {len(told)} | "
        f"{chance.low:.0%} to {chance.high:.0%} |"
    )


def _hold(value: float, duration: float) -> Values:
    return np.full(round(duration / TICK), value)


if __name__ == "__main__":
    main()
