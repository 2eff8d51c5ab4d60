"""Throughput of a batch, beside a loop of single runs. Run: `python benchmarks/batch.py`.

Prints a Markdown table: nanoseconds a plant and step, medians of repeats measured in turn. Every
variant runs the same 64 plants, with parameters of their own, on the bench's default solver.
"""

import argparse
import os
import statistics
import time
from dataclasses import replace

import numba
import numpy as np

import occasion
from hil_bench.abilities.analysis.simulation import Setup, build_plant, simulate, simulate_batch
from hil_bench.plants.hydraulic_cylinder.model import (
    PlantInput,
    PlantOptions,
    Solver,
    paper_parameters,
)

PLANTS = 64
STEPS = 10_000  # half a second
EVERY = 20
REPEATS = 7
DT = 5e-5


def make_setups() -> list[Setup]:
    """Return plants whose parameters are within 30 % of Table I."""
    source = np.random.default_rng(1)
    table_1 = paper_parameters()
    names = ("E", "m", "F_c", "sigma", "omega_0")
    return [
        Setup(
            parameters=replace(
                table_1,
                **{name: getattr(table_1, name) * source.uniform(0.7, 1.0) for name in names},
            ),
            options=PlantOptions.bench(),
            solver=Solver.LINEARLY_IMPLICIT_MIDPOINT,
            dt=DT,
        )
        for _ in range(PLANTS)
    ]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=REPEATS)
    repeats = occasion.arguments(parser, repeats=1).repeats
    setups = make_setups()
    time_s = np.arange(STEPS) * DT
    setpoints = 1e-3 * np.sin(2.0 * np.pi * 4.0 * time_s)
    plants = [build_plant(setup) for setup in setups]

    def single_calls() -> None:
        for plant in plants:
            for direction in (1e-3, -1e-3):
                plant.step(PlantInput(direction), STEPS // 2)

    variants = {
        "a loop of single runs, each in two calls": single_calls,
        "a loop of `simulate`, a call a step": lambda: [
            simulate(setup, setpoints, every=EVERY) for setup in setups
        ],
        "`simulate_batch`, one thread": lambda: simulate_batch(
            setups, setpoints, every=EVERY, threads=1
        ),
        f"`simulate_batch`, {os.cpu_count()} threads": lambda: simulate_batch(
            setups, setpoints, every=EVERY
        ),
    }
    costs: dict[str, list[float]] = {name: [] for name in variants}
    for run in variants.values():
        run()
    for _ in range(repeats):
        for name, run in variants.items():
            start = time.perf_counter_ns()
            run()
            costs[name].append((time.perf_counter_ns() - start) / (PLANTS * STEPS))
    first = statistics.median(next(iter(costs.values())))
    print(f"Numba {numba.__version__}, {PLANTS} plants\n")
    print("| variant | ns a plant and step | times as fast as the first |\n|---|---|---|")
    for name, values in costs.items():
        cost = statistics.median(values)
        print(f"| {name} | {cost:.1f} | {first / cost:.1f} |")


if __name__ == "__main__":
    main()
