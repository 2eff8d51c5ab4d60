"""Identification of virtual machines. Run: `python benchmarks/identification.py [MACHINES]`.

Each machine has parameters of its own: all that are sought within 30 % of Table I, leakage up to
2e-13 m³/(s Pa), and every third machine oil without air (bulk modulus 0.7 to 1.7 GPa). End stops,
cavitation floor and laminar transition are on, the sensors have noise and the position is rounded
to a micrometre. The search starts at Table I. Prints Markdown tables; progress goes to standard
error.
"""

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from hil_bench.analysis.simulation import Setup, simulate
from hil_bench.analysis.study import make_table
from hil_bench.identification.identify import Identification, identify
from hil_bench.identification.record import SIGNALS, AxisRecord
from hil_bench.identification.unknowns import KINDS
from hil_bench.plant import PlantOptions, PlantParameters, Solver, paper_parameters
from hil_bench.recording.channels import Channel, Recording

MACHINES = 20
STEP, TICK = 5e-5, 1e-3  # [s]
NOISE = {"position": 2e-6, "P_A": 5e3, "P_B": 5e3}  # [m], [Pa]
RESOLUTION = 1e-6  # of the position [m]
FULL_OPENING = paper_parameters().full_opening

Values = npt.NDArray[np.float64]


def draw_machine(number: int, source: np.random.Generator) -> PlantParameters:
    """Return the parameters of one machine."""
    table_1 = paper_parameters()
    values = {name: getattr(table_1, name) * source.uniform(0.7, 1.3) for name in KINDS}
    values["F_s"] = max(values["F_s"], 1.1 * values["F_c"])
    values["C_L"] = source.uniform(0.0, 2e-13)
    if number % 3 == 2:
        values["E"] = source.uniform(7e8, 1.7e9)
    return replace(table_1, **values)


def make_setpoints() -> Values:
    """Return what a commissioning run commands: slow ramps, steps, a chirp, random steps [m]."""
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
    """Return what the sensors of a machine show, as a recording."""
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


def try_machine(number: int) -> tuple[PlantParameters, Identification]:
    """Return a machine and what was identified of it."""
    source = np.random.default_rng(number + 1)
    machine = draw_machine(number, source)
    record = AxisRecord.of(record_machine(machine, source), "axis1", FULL_OPENING)
    start = time.perf_counter()
    found = identify(record, paper_parameters(), PlantOptions.bench(), step=STEP)
    print(
        f"machine {number + 1}: residual {found.residual:.2f}, "
        f"trial {found.trial.residual[0]:.2f}, "
        f"not told {[estimate.name for estimate in found.not_told]}, "
        f"left out {found.left_out}, E {machine.E:.3g} found {found.parameters.E:.4g}, "
        f"{time.perf_counter() - start:.0f} s",
        file=sys.stderr,
        flush=True,
    )
    return machine, found


def main() -> None:
    """Identify and print."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else MACHINES
    with ProcessPoolExecutor() as pool:
        tried = list(pool.map(try_machine, range(count)))
    print(f"{count} machines, {len(make_setpoints()) * TICK:.1f} s of record each\n")
    print("| | error, median | worst | standard deviation | error / deviation, worst | told |")
    print("|---|---|---|---|---|---|")
    for name in KINDS:
        print(_row(name, tried))
    position = [
        found.trial.residual[0] * found.record.noise[0] / NOISE["position"] for _, found in tried
    ]
    print(
        f"\nposition where nothing was fitted, in multiples of the sensor's noise: median "
        f"{np.median(position):.2f}, worst {max(position):.2f}"
    )
    ratios = np.array([ratio for name in KINDS for ratio in _ratios(name, tried)])
    print(
        f"{len(ratios)} errors over their stated deviations: root mean square "
        f"{np.sqrt(np.square(ratios).mean()):.2f}, {(ratios < 2.0).mean():.1%} below 2"
    )


def _ratios(name: str, tried: list[tuple[PlantParameters, Identification]]) -> list[float]:
    """Return the error of a parameter on each machine, in stated deviations."""
    return [
        abs(estimate.value - getattr(machine, name)) / estimate.deviation
        for machine, found in tried
        for estimate in found.told
        if estimate.name == name
    ]


def _row(name: str, tried: list[tuple[PlantParameters, Identification]]) -> str:
    """Return the row of a parameter; leakage goes by the largest that was drawn."""
    errors, deviations = [], []
    for machine, found in tried:
        estimate = next(estimate for estimate in found.estimates if estimate.name == name)
        if not estimate.is_told:
            continue
        scale = 2e-13 if name == "C_L" else getattr(machine, name)
        errors.append(abs(estimate.value - getattr(machine, name)) / scale)
        deviations.append(estimate.deviation / scale)
    told = f"{len(errors)} of {len(tried)}"
    if not errors:
        return f"| {name} | | | | | {told} |"
    worst = max(error / deviation for error, deviation in zip(errors, deviations, strict=True))
    return (
        f"| {name} | {100.0 * np.median(errors):.3f} % | {100.0 * max(errors):.3f} % | "
        f"{100.0 * np.median(deviations):.3f} % | {worst:.1f} | {told} |"
    )


def _hold(value: float, duration: float) -> Values:
    return np.full(round(duration / TICK), value)


if __name__ == "__main__":
    main()
