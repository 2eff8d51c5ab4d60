"""Identification of machines of the model's own kind: do the intervals hold, and what does it cost?

Run: `python benchmarks/identification.py [MACHINES] [--seconds S]`.

Each machine has the parameters of `SOUGHT` drawn within 30 % of Table I. Its record has strokes
each way at three openings, a row each ms, with the noise of sensors; strokes at openings between
these are kept apart. The search starts at Table I. Prints Markdown: how often the stated intervals
hold the truth, the error of prediction that is stated and that of the strokes kept apart, and the
processor time. Then the cost of a run of all strokes beside that of the solver's steps in it.
Machines that are not the model's are those of `identification_strangers.py`.
"""

import argparse
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt

import occasion
from hil_bench.abilities.analysis.simulation import Setup, simulate
from hil_bench.abilities.analysis.study import make_table
from hil_bench.abilities.identification.errors import measure_errors, stated_error
from hil_bench.abilities.identification.fit import Bench
from hil_bench.abilities.identification.identify import Identification, Options, identify
from hil_bench.abilities.identification.machine import Template
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.strokes import make_course
from hil_bench.bench.configuration import load_config
from hil_bench.outside.recording.channels import Channel
from hil_bench.plants.hydraulic_cylinder.model import (
    FullOrderPlant,
    PlantInput,
    PlantOptions,
    PlantParameters,
    Solver,
    balanced_state,
    paper_parameters,
)

if TYPE_CHECKING:
    from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig

STEP, TICK = 1e-4, 1e-3  # [s]
NOISE = (5e-6, 1e4, 1e4)  # [m], [Pa]
FULL_OPENING = paper_parameters().full_opening
OPENINGS, APART = (0.4, 0.6, 0.9), (0.5, 0.75)
SOUGHT = {
    "orifice_width_mm": ("w", 1e3),
    "spool_overlap_mm": ("beta", 1e3),
    "bulk_modulus_mpa": ("E", 1e-6),
    "coulomb_friction_n": ("F_c", 1.0),
    "viscous_friction_n_s_m": ("sigma", 1.0),
    "moving_mass_kg": ("m", 1.0),
    "spool_natural_frequency_rad_s": ("omega_0", 1.0),
}
CONFIG = load_config(None)
AXIS = cast("CylinderConfig", CONFIG.first_axis)
SETTINGS = {one.key.name: one for one in CONFIG.settings if one.table == f"plant.{AXIS.name}"}

Values = npt.NDArray[np.float64]


def draw_machine(number: int) -> PlantParameters:
    """Return a machine of the model's kind."""
    source, table_1 = np.random.default_rng(number), paper_parameters()
    values = {
        name: getattr(table_1, name) * source.uniform(0.7, 1.3) for name, _ in SOUGHT.values()
    }
    return replace(table_1, F_s=1.5 * values["F_c"], **values)


def setpoints_of(openings: tuple[float, ...], pairs: int) -> Values:
    """Return set-points [m]: strokes out and in at each opening, with rests."""
    parts = [np.zeros(300)]
    for opening in openings:
        rows = round(0.28 / opening / TICK)
        for sign in (1.0, -1.0) * pairs:
            parts += [np.full(rows, sign * opening * FULL_OPENING), np.zeros(300)]
    return np.concatenate(parts)


def record_machine(machine: PlantParameters, setpoints: Values, seed: int) -> AxisRecord:
    """Return the record of a machine behind its sensors."""
    every = round(TICK / STEP)
    setup = Setup(
        parameters=machine,
        options=PlantOptions.bench(),
        solver=Solver.LINEARLY_IMPLICIT_MIDPOINT,
        dt=STEP,
        state=balanced_state(machine, x=-0.05),
    )
    run = simulate(setup, np.repeat(setpoints, every), every=every)
    noise = np.random.default_rng(seed).standard_normal((3, len(run)))
    columns = {Channel("time", "s"): run["time"]}
    for place, (quantity, unit, name) in enumerate(
        (("position", "m", "x"), ("P_A", "Pa", "P_A"), ("P_B", "Pa", "P_B"))
    ):
        channel = Channel(f"{AXIS.name}.{quantity}", unit)
        columns[channel] = run[name] + NOISE[place] * noise[place]
    columns[Channel(f"{AXIS.name}.spool_setpoint", "-")] = setpoints / FULL_OPENING
    return AxisRecord.of(make_table(columns), AXIS.name, FULL_OPENING)


def try_machine(number: int, pairs: int, seconds: float) -> dict[str, Any]:
    """Identify a machine; return what was found beside the truth."""
    machine = draw_machine(number)
    record = record_machine(machine, setpoints_of(OPENINGS, pairs), number)
    begin, first = time.process_time(), 0.0

    def say(stage: str) -> None:
        nonlocal first
        if not first and "so far" in stage:
            first = time.process_time() - begin

    options = Options(seconds=seconds, say=say)
    found = identify(record, AXIS, SETTINGS, step=STEP, options=options)
    spent = time.process_time() - begin
    estimates = {one.name: one for one in found.estimates}
    truth = {name: factor * getattr(machine, field) for name, (field, factor) in SOUGHT.items()}
    told = {name: estimates[name] for name in truth if name in estimates}
    return {
        "hits": {
            name: one.interval[0] <= truth[name] <= one.interval[1] for name, one in told.items()
        },
        "errors": {name: abs(one.value / truth[name] - 1.0) for name, one in told.items()},
        "stated": stated_error(found.ladder.best.errors, "position"),
        "apart": predict_apart(found, machine, number),
        "model": found.ladder.best.title,
        "first": first,
        "spent": spent,
        "rows": len(record),
    }


def predict_apart(found: Identification, machine: PlantParameters, number: int) -> float:
    """Return the error of position that nine of ten strokes kept apart are within [mm]."""
    record = record_machine(machine, setpoints_of(APART, 2), 1000 + number)
    bench = replace(found.bench, course=make_course(record, TICK))
    shown = bench.run(bench.machine(found.fit.values), bench.cuts())
    errors = [
        measure_errors(model, bench.measured(stroke), TICK)
        for stroke, model in zip(bench.course.strokes, shown, strict=True)
    ]
    return stated_error(errors, "position")


def time_runs(pairs: int) -> tuple[float, float]:
    """Return the processor time of a run of all strokes beside the record, and of its steps [s]."""
    record = record_machine(paper_parameters(), setpoints_of(OPENINGS, pairs), 1)
    bench = Bench(Template(AXIS, SETTINGS, 1), make_course(record, TICK), STEP)
    plant = FullOrderPlant(
        replace(paper_parameters()), options=replace(AXIS.options, C_LA=1e-30), dt=bench.dt
    )
    whole, steps = [], []
    count = sum(len(cut) for cut in bench.cuts())
    for _ in range(7):  # in turns
        begin = time.process_time()
        bench.run(bench.machine({}), bench.cuts())
        whole.append(time.process_time() - begin)
        begin = time.process_time()
        for stroke in bench.course.strokes:
            plant.step(PlantInput(float(bench.setpoints_of(stroke)[-1])), steps=1)
        plant.step(PlantInput(0.5e-3), steps=count)
        steps.append(time.process_time() - begin)
    return min(whole), min(steps)


def main() -> None:
    """Identify and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("machines", type=int, nargs="?", default=20)
    parser.add_argument("--pairs", type=int, default=2, help="strokes each way at an opening (2)")
    parser.add_argument("--seconds", type=float, default=3600.0, help="time limit of each (3600)")
    args = occasion.arguments(parser, machines=1, pairs=1, seconds=5.0)
    tried = [try_machine(number, args.pairs, args.seconds) for number in range(args.machines)]
    print("| key | in the 95 % interval | error, median | worst |\n|---|---|---|---|")
    for name in SOUGHT:
        hits = [one["hits"][name] for one in tried if name in one["hits"]]
        errors = [one["errors"][name] for one in tried if name in one["errors"]]
        if hits:
            print(
                f"| {name} | {sum(hits)} of {len(hits)} | {np.median(errors):.3%} | "
                f"{max(errors):.3%} |"
            )
    within = sum(one["apart"] <= max(one["stated"], 0.1) for one in tried)
    print(f"\n{len(tried)} machines, {tried[0]['rows']} rows each")
    print(f"position of strokes kept apart within what is stated or 0.1 mm: {within}")
    for key, unit in (("stated", "mm"), ("apart", "mm"), ("first", "s"), ("spent", "s")):
        values = [one[key] for one in tried]
        print(
            f"{key}: median {np.nanmedian(values):.3g} {unit}, most {np.nanmax(values):.3g} {unit}"
        )
    models = sorted({one["model"] for one in tried})
    print(f"models taken: {', '.join(models)}")
    whole, steps = time_runs(args.pairs)
    print(
        f"a run of all strokes: {1e3 * whole:.1f} ms, its steps alone: {1e3 * steps:.1f} ms, "
        f"ratio {whole / steps:.2f}"
    )


if __name__ == "__main__":
    main()
