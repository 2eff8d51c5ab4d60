"""Cost of one plant step, beside the same equations in C. Run: `python benchmarks/plant_step.py`.

Prints Markdown tables. Each figure is a median of repeats, Numba and C interleaved in one process.
The C source, `plant_step.c`, is built with `gcc -O3 -march=native` into a temporary directory.
"""

import argparse
import ctypes
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numba
import numpy as np

import occasion
from hil_bench.plants.hydraulic_cylinder.model import (
    ConstantLoad,
    CounterbalanceValve,
    Cushion,
    EntrainedAir,
    FullOrderPlant,
    Line,
    LoadSeries,
    LuGreFriction,
    MassOnSlope,
    MeteringLands,
    PlantInput,
    PlantOptions,
    ReducedOrderPlant,
    Solver,
    SpringLoad,
    SupplyUnit,
    VariablePump,
    balanced_state,
)
from hil_bench.plants.hydraulic_cylinder.model.constants import pack
from hil_bench.plants.hydraulic_cylinder.model.parameters import paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.stepping import DEFAULT_STEP

DT = DEFAULT_STEP
STEPS_PER_MOVE = 10_000  # half a second each way, so that the piston stays off its stops
MOVES = 20
REPEATS = 15
SPOOL_SETPOINT = 1e-3
SOURCE = Path(__file__).with_suffix(".c")
FUNCTIONS = {
    Solver.FORWARD_EULER: "advance_forward_euler",
    Solver.LINEARLY_IMPLICIT_MIDPOINT: "advance_implicit_midpoint",
}

HOSE = Line(length=6.0, inner=0.016, bulk_modulus=7e8)
CUSHION = Cushion(length=0.05, orifice=2e-3)
EXTENSIONS = {
    "none": {},
    "asymmetric valve": {"alpha_negative": 8e-4, "beta_negative": 2e-4},
    "external leakage": {"C_LA": 1e-13, "C_LB": 1e-13},
    "load: constant, spring, mass on slope": {
        "loads": (ConstantLoad(500.0), SpringLoad(1e3), MassOnSlope(20.0, 0.3))
    },
    "load: time series": {"loads": (LoadSeries((0.0, 1.0, 2.0), (0.0, 500.0, 0.0)),)},
    "entrained air": {"air": EntrainedAir(air_fraction=0.01)},
    "LuGre friction": {"bristles": LuGreFriction()},
    "metering edges": {"lands": MeteringLands(gain_pb=0.84, saturation=1.0)},
    "four edges with null leakage": {"lands": MeteringLands(null_opening=5e-6)},
    "pressure compensator": {"compensator_margin": 1e6},
    "cushions": {"cushion_a": CUSHION, "cushion_b": CUSHION},
    "supply unit": {"supply": SupplyUnit()},
}
MOVING = {
    "counterbalance valves": {
        "counterbalance": CounterbalanceValve(
            in_line_a=True, in_line_b=True, setting=1e7, pilot_ratio=3.0, conductance=1e-6
        )
    },
    "lines with waves": {"line_a": HOSE, "line_b": HOSE},
    "load-sensing pump": {
        "supply": SupplyUnit(
            accumulator_volume=0.0,
            precharge_pressure=0.0,
            variable=VariablePump(senses_load=True),
        )
    },
}
EXTENSIONS["all of them"] = {
    name: value for extension in EXTENSIONS.values() for name, value in extension.items()
}

Advance = Callable[[float, int], object]
Variant = TypeVar("Variant")


def build_c(directory: Path) -> ctypes.CDLL:
    """Return the C plant, compiled into `directory`."""
    library = directory / "plant_step.so"
    flags = ["-O3", "-march=native", "-std=c17", "-shared", "-fPIC"]
    subprocess.run(["gcc", *flags, SOURCE, "-o", library, "-lm"], check=True)  # noqa: S603, S607
    return ctypes.CDLL(str(library))


def c_plant(library: ctypes.CDLL, solver: Solver, options: PlantOptions) -> Advance:
    """Return a callable that advances a C plant by (u, steps)."""
    parameters = paper_parameters()
    state = np.array(balanced_state(parameters), dtype=np.float64)
    constants = np.array(pack(parameters, options, DT), dtype=np.float64)
    function = library[FUNCTIONS[solver]]
    pointer = ctypes.c_void_p
    function.argtypes = [pointer, pointer, ctypes.c_double, ctypes.c_double, ctypes.c_long]
    function.restype = None
    return lambda u, steps: function(state.ctypes.data, constants.ctypes.data, u, 0.0, steps)


def bench_plant(solver: Solver, options: PlantOptions) -> Advance:
    """Return a callable that advances a bench plant by (u, steps)."""
    plant = FullOrderPlant(paper_parameters(), options=options, solver=solver, dt=DT)
    return lambda u, steps: plant.step(PlantInput(u, 0.0), steps)


def reduced_plant(solver: Solver) -> Advance:
    """Return a callable that advances a reduced plant by (u, steps)."""
    plant = ReducedOrderPlant(paper_parameters(), solver=solver, dt=DT)
    return lambda u, steps: plant.step(PlantInput(u, 0.0), steps)


def ns_per_step(advance: Advance, moves: int, steps: int) -> float:
    """Return the processor time of one step [ns] while the piston goes back and forth."""
    start = time.thread_time_ns()
    for move in range(moves):
        advance(-SPOOL_SETPOINT if move % 2 else SPOOL_SETPOINT, steps)
    return (time.thread_time_ns() - start) / (moves * steps)


def interleaved_medians(
    variants: dict[Variant, Advance], moves: int, steps: int, repeats: int
) -> dict[Variant, float]:
    """Return the median cost of one step [ns] of each variant, all measured in turn."""
    costs: dict[Variant, list[float]] = {name: [] for name in variants}
    for _ in range(repeats):
        for name, advance in variants.items():
            costs[name].append(ns_per_step(advance, moves, steps))
    return {name: statistics.median(values) for name, values in costs.items()}


def pure_python_ns(solver: Solver, options_name: str) -> float:
    """Return the cost of one step [ns] in plain Python, measured in a process of its own."""
    command = [sys.executable, __file__, "--pure", solver.value, options_name]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    answer = subprocess.run(command, env=environment, check=True, capture_output=True)  # noqa: S603
    return float(answer.stdout)


def print_pure(solver: Solver, options_name: str) -> None:
    """Print the cost of one step [ns] in this process, for `pure_python_ns`."""
    advance = bench_plant(solver, getattr(PlantOptions, options_name)())
    print(statistics.median(ns_per_step(advance, 10, 500) for _ in range(REPEATS)))


def print_report(library: ctypes.CDLL, repeats: int) -> None:
    """Print the table."""
    print(f"{compilers()}\n")
    print("| solver | options | Numba ns/step | C ns/step | Numba / C | plain Python ns/step |")
    print("|---|---|---|---|---|---|")
    for solver in FUNCTIONS:
        for name in ("paper", "bench"):
            options = getattr(PlantOptions, name)()
            variants = {
                "Numba": bench_plant(solver, options),
                "C": c_plant(library, solver, options),
            }
            cost = interleaved_medians(variants, MOVES, STEPS_PER_MOVE, repeats)
            pure = pure_python_ns(solver, name)
            ratio = cost["Numba"] / cost["C"]
            print(
                f"| {solver.value} | {name} | {cost['Numba']:.1f} | {cost['C']:.1f} "
                f"| {ratio:.2f} | {pure:.0f} |"
            )
    print("\n| call from Python, bench defaults | ns |\n|---|---|")
    advance = bench_plant(Solver.LINEARLY_IMPLICIT_MIDPOINT, PlantOptions.bench())
    for steps in (1, 10):
        per_call = statistics.median(
            ns_per_step(advance, 20_000, steps) * steps for _ in range(repeats)
        )
        print(f"| `plant.step(input, {steps})` | {per_call:.0f} |")


def print_extensions(repeats: int) -> None:
    """Print the cost of a step with each extension on, all measured in turn."""
    print(
        "\n| extension, beside the bench's options | forward-euler | linearly-implicit-midpoint "
        "| runge-kutta |"
    )
    print("|---|---|---|---|")
    variants = {
        (name, solver): bench_plant(solver, replace(PlantOptions.bench(), **change))
        for name, change in EXTENSIONS.items()
        for solver in Solver
    } | {("reduced model", solver): reduced_plant(solver) for solver in Solver}
    default = Solver.LINEARLY_IMPLICIT_MIDPOINT
    variants |= {
        (name, default): bench_plant(default, replace(PlantOptions.bench(), **change))
        for name, change in MOVING.items()
    }
    cost = interleaved_medians(variants, MOVES // 4, STEPS_PER_MOVE, repeats)
    for name in (*EXTENSIONS, "reduced model"):
        print(f"| {name} | {' | '.join(f'{cost[name, solver]:.1f}' for solver in Solver)} |")
    for name in MOVING:
        print(f"| {name} | - | {cost[name, default]:.1f} | - |")


def compilers() -> str:
    """Return the versions of both compilers."""
    gcc = subprocess.run(["gcc", "-dumpfullversion"], check=True, capture_output=True, text=True)  # noqa: S607
    return f"Numba {numba.__version__}, gcc {gcc.stdout.strip()}"


def main() -> None:
    """Measure and print."""
    if sys.argv[1:2] == ["--pure"]:
        print_pure(Solver(sys.argv[2]), sys.argv[3])
        return
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=REPEATS)
    repeats = occasion.arguments(parser, repeats=1).repeats
    with tempfile.TemporaryDirectory() as directory:
        print_report(build_c(Path(directory)), repeats)
    print_extensions(repeats)


if __name__ == "__main__":
    main()
