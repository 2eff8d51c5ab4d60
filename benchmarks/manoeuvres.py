"""Manoeuvres drawn at random, and a process that runs them, for `benchmarks/accuracy.py`.

    python benchmarks/manoeuvres.py SEED STEP    # reads numbers, prints what the plant did

Each of ten kinds has the same share. The process runs the plant that it imports, so that
`PYTHONPATH` decides whose plant that is; it asks nothing of it that older revisions do not have.
"""

import json
import sys
import time
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.plants.hydraulic_cylinder.model import (
    ConstantLoad,
    EntrainedAir,
    FullOrderPlant,
    LoadSeries,
    LuGreFriction,
    MassOnSlope,
    PlantInput,
    PlantOptions,
    PlantParameters,
    Solver,
    SpringLoad,
    SupplyUnit,
    balanced_state,
    paper_parameters,
)

Array = npt.NDArray[np.float64]

TICK, TICKS = 1e-3, 1500
KINDS = (
    "steps",
    "sines",
    "ramps through standstill",
    "creeping reversals",
    "loads up to 30 kN",
    "overloads up to 70 kN",
    "leakage",
    "mixture",
    "mixture, other machine",
    "mixture, extension",
)
EXTENSIONS: tuple[dict[str, Any], ...] = (
    {"alpha_negative": 8e-4, "beta_negative": 2e-4},
    {"C_LA": 1e-12, "C_LB": 1e-12},
    {"loads": (ConstantLoad(5e3), SpringLoad(1e5), MassOnSlope(20.0, 0.3))},
    {"loads": (LoadSeries((0.2, 0.4, 0.4, 1.0), (0.0, 2e4, -1e4, 0.0)),)},
    {"air": EntrainedAir(air_fraction=0.01)},
    {"bristles": LuGreFriction()},
    {"supply": SupplyUnit()},
)


class Manoeuvre(NamedTuple):
    """A run of a plant: an input a tick."""

    kind: str
    parameters: PlantParameters
    options: PlantOptions
    x: float
    u: Array
    F_L: Array


def draw_levels(source: np.random.Generator, shortest: int, longest: int, largest: float) -> Array:
    """Return levels that hold for random counts of ticks; three of ten are 0."""
    levels, at = np.zeros(TICKS), 0
    while at < TICKS:
        ticks = int(source.integers(shortest, longest))
        levels[at : at + ticks] = source.uniform(-largest, largest) if source.random() < 0.7 else 0
        at += ticks
    return levels


def draw_setpoint(source: np.random.Generator, kind: str) -> Array:
    """Return the spool set-points of a kind [m]."""
    t = np.arange(TICKS) * TICK
    if kind.startswith("steps"):
        return draw_levels(source, 50, 500, 1.4e-3)
    if kind.startswith("sines"):
        swing = np.sin(2.0 * np.pi * (source.uniform(0.5, 10.0) * t + source.random()))
        return source.uniform(2e-4, 1.4e-3) * swing
    if kind.startswith("ramps"):
        turns = (source.uniform(0.3, 3.0) * t + source.random()) % 1.0
        return source.uniform(3e-4, 8e-4) * (4.0 * np.abs(turns - 0.5) - 1.0)
    if kind.startswith("creeping"):
        return draw_levels(source, 100, 600, 5e-4)
    if kind.startswith("mixture"):
        swing = 3e-4 * np.sin(2.0 * np.pi * source.uniform(1.0, 10.0) * t)
        return draw_levels(source, 50, 400, 1.4e-3) + swing
    return draw_levels(source, 100, 500, 1e-3)


def draw_machine(source: np.random.Generator, kind: str) -> tuple[PlantParameters, PlantOptions]:
    """Return the machine on which a kind runs."""
    table, options = paper_parameters(), PlantOptions.bench()
    if kind == "leakage":
        return replace(table, C_L=10.0 ** source.uniform(-12.5, -11.0)), options
    if kind.endswith("other machine"):
        names = ("w", "omega_0", "F_c", "sigma", "chi")
        changes = {name: getattr(table, name) * source.uniform(0.7, 1.3) for name in names}
        changes["F_s"] = changes["F_c"] * source.uniform(1.05, 1.6)
        changes["E"] = 10.0 ** source.uniform(8.0, 9.2)
        changes["m"] = 10.0 ** source.uniform(1.3, 2.7)
        return replace(table, **changes), options
    if kind.endswith("extension"):
        return table, replace(options, **EXTENSIONS[int(source.integers(len(EXTENSIONS)))])
    return table, options


def draw(seed: int, number: int) -> Manoeuvre:
    """Return one manoeuvre: the same for the same seed and number."""
    source = np.random.default_rng((seed, number))
    kind = KINDS[number % len(KINDS)]
    parameters, options = draw_machine(source, kind)
    load = 3e4 if kind.startswith("loads") else 7e4 if kind.startswith("overloads") else 0.0
    load = 2e4 if kind.startswith("mixture") else load
    x = float(source.uniform(-0.15, 0.15))
    u = draw_setpoint(source, kind)
    return Manoeuvre(kind, parameters, options, x, u, draw_levels(source, 50, 400, load))


class Run(NamedTuple):
    """One run of a plant.

    Attributes:
        x: positions at each tick [m].
        evaluations: a step, mean over the run.
        most: evaluations in one tick.
        cost: processor time a tick [us].
    """

    x: Array
    evaluations: float
    most: int
    cost: float


def make(
    manoeuvre: Manoeuvre, solver: Solver, dt: float
) -> tuple[FullOrderPlant, list[PlantInput]]:
    """Return a plant at the start of a manoeuvre, and what it is given in each tick."""
    p = manoeuvre.parameters
    start = balanced_state(p, x=manoeuvre.x)
    plant = FullOrderPlant(p, options=manoeuvre.options, solver=solver, dt=dt, state=start)
    return plant, [PlantInput(*pair) for pair in zip(manoeuvre.u, manoeuvre.F_L, strict=True)]


def positions(manoeuvre: Manoeuvre, solver: Solver, dt: float) -> Array:
    """Return the positions at each tick [m]."""
    plant, inputs = make(manoeuvre, solver, dt)
    return np.array([plant.step(given, round(TICK / dt)).x for given in inputs])


def run(manoeuvre: Manoeuvre, dt: float) -> Run:
    """Run a plant on the default solver, and measure its cost when nobody looks."""
    steps = round(TICK / dt)
    unseen, inputs = make(manoeuvre, Solver.LINEARLY_IMPLICIT_MIDPOINT, dt)
    begin = time.process_time()
    for given in inputs:
        unseen.step(given, steps)
    cost = 1e6 * (time.process_time() - begin) / TICKS
    plant, _ = make(manoeuvre, Solver.LINEARLY_IMPLICIT_MIDPOINT, dt)
    x, extra = np.empty(TICKS), np.zeros(TICKS + 1)
    for tick, given in enumerate(inputs):
        x[tick] = plant.step(given, steps).x
        extra[tick + 1] = getattr(plant, "extra_evaluations", 0)  # a fixed step has none
    return Run(x, 1.0 + extra[-1] / (TICKS * steps), steps + int(np.diff(extra).max()), cost)


def serve(seed: int, step: float) -> None:
    """Run the manoeuvres whose numbers come in."""
    for line in sys.stdin:
        found = run(draw(seed, int(line)), step)
        print(json.dumps([found.x.tolist(), *found[1:]]), flush=True)


if __name__ == "__main__":
    serve(int(sys.argv[1]), float(sys.argv[2]))
