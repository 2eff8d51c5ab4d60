"""The solvers against a reference integration, over oils, masses and the whole stroke.

    python benchmarks/solvers.py            # about two minutes; prints docs/solvers.md's tables

The reference is SciPy's LSODA at rtol 1e-10 on a right-hand side of its own, written here from the
paper's equations and sharing no code with the plant. It is split where the model is not smooth in
time: where the set-point jumps, and where the spool crosses an edge of dead-zone or saturation.
"""

import argparse
import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numba
import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import occasion
from hil_bench.plants.hydraulic_cylinder.model import (
    FullOrderPlant,
    PlantInput,
    PlantOptions,
    PlantParameters,
    PlantState,
    Solver,
    balanced_state,
    paper_parameters,
)
from hil_bench.plants.hydraulic_cylinder.model.full_order import largest_step
from hil_bench.plants.hydraulic_cylinder.model.stepping import DEFAULT_STEP

Array = npt.NDArray[np.float64]
Move = tuple[float, float, int]
"""Spool set-point [m], external load [N] and duration [ms]."""

TICK = 1e-3
BENCH_STEP, PAPER_STEP = DEFAULT_STEP, 1e-4
OPTIONS = PlantOptions.paper()
OILS = (1e8, 3e8, 7e8, 1e9, 1.7e9)
MASSES = (5.0, 20.0, 100.0, 500.0)
SHARES = (-0.8, 0.0, 0.8)
"""Positions at the start, in shares of the half-stroke."""

RTOL = 1e-10
SCALE = np.array([1e-3, 0.1, 1e6, 1e6, 1e-3, 1.0])
FRICTION_INTERVALS = 1024


def step_out_and_back() -> list[Move]:
    """Return a second of motion of 30 mm that breaks away and comes to rest four times."""
    return [(8e-4, 0.0, 200), (0.0, 0.0, 300), (-8e-4, 0.0, 200), (0.0, 0.0, 300)]


def mixed() -> list[Move]:
    """Return ten seconds: steps, sines, creeping in the falling Stribeck curve, loads, rest."""
    moves: list[Move] = [(8e-4, 0.0, 400), (0.0, 0.0, 300), (-1e-3, 0.0, 500), (0.0, 0.0, 300)]
    moves += [(1.4e-3, 0.0, 300), (-1.4e-3, 0.0, 300), (0.0, 0.0, 400)]
    moves += [(1e-3 * math.sin(2.0 * math.pi * k * TICK), 0.0, 1) for k in range(2000)]
    moves += [(0.0, 0.0, 500), (3.5e-4, 0.0, 500), (0.0, 0.0, 300), (-3.6e-4, 0.0, 700)]
    moves += [(4e-4, 2000.0, 500), (0.0, 2000.0, 300), (-5e-4, -1000.0, 400), (0.0, 0.0, 300)]
    moves += [(6e-4 * math.sin(10.0 * math.pi * k * TICK), 0.0, 1) for k in range(1000)]
    return [*moves, (0.0, 0.0, 1000)]


def right_hand_side(p: PlantParameters) -> Callable[..., list[float]]:
    """Return eqs. (3), (5), (6), (8)-(13) as a function of time, states, u and F_L."""
    K = p.C_d * p.w * math.sqrt(2.0 / p.rho)

    def flow(z: float, pressure: float) -> float:
        drop = p.P_S - pressure if z > 0.0 else pressure - p.P_T
        return z * K * math.copysign(math.sqrt(abs(drop)), drop)

    def rates(_t: float, y: Sequence[float], u: float, F_L: float) -> list[float]:
        x, v, P_A, P_B, nu, nu_dot = y
        z = math.copysign(min(max(abs(nu) - p.beta, 0.0), p.alpha), nu)
        x_V = max(min(x, p.h), -p.h)
        weakening = (p.F_s - p.F_c) * math.exp(-((abs(v) / p.chi) ** p.delta))
        friction = math.tanh(400.0 * v) * (p.F_c + weakening) + p.sigma * v
        leak = p.C_L * (P_A - P_B)
        return [
            v,
            (P_A * p.A_A - P_B * p.A_B - friction - F_L) / p.m,
            p.E / (p.V_A0 + p.A_A * x_V) * (flow(z, P_A) - p.A_A * v - leak),
            p.E / (p.V_B0 - p.A_B * x_V) * (flow(-z, P_B) + p.A_B * v + leak),
            nu_dot,
            p.omega_0**2 * (u - nu) - 2.0 * p.xi * p.omega_0 * nu_dot,
        ]

    return rates


def edge_crossings(
    p: PlantParameters, nu: float, nu_dot: float, u: float, end: float
) -> list[float]:
    """Return the times at which the spool, on its way to u, crosses an edge of eqs. (2), (4)."""
    decay = p.xi * p.omega_0
    omega = p.omega_0 * math.sqrt(1.0 - p.xi**2)

    def spool(t: float) -> float:
        swing = (nu - u) * math.cos(omega * t)
        swing += (nu_dot + decay * (nu - u)) / omega * math.sin(omega * t)
        return u + math.exp(-decay * t) * swing

    times = np.linspace(0.0, min(end, 0.05), 2501 if end > TICK else 51)
    places = [spool(t) for t in times]
    crossings = []
    for edge in (-p.alpha - p.beta, -p.beta, p.beta, p.alpha + p.beta):
        for index in range(len(times) - 1):
            if (places[index] - edge) * (places[index + 1] - edge) < 0.0:
                between = times[index], times[index + 1]
                crossings.append(brentq(lambda t: spool(t) - edge, *between, xtol=1e-16))  # noqa: B023
    return sorted(crossings)


def reference(p: PlantParameters, start: PlantState, moves: list[Move]) -> Array:
    """Return the states at each millisecond, shape (ticks + 1, 6)."""
    rates, y = right_hand_side(p), np.array(start[:6])
    rows = [y]
    for u, F_L, ticks in moves:
        grid = np.arange(1, ticks + 1) * TICK
        splits = [0.0, *edge_crossings(p, y[4], y[5], u, ticks * TICK), ticks * TICK]
        for begin, end in itertools.pairwise(splits):
            if end - begin < 1e-14:
                continue
            inner = grid[(grid > begin + 1e-15) & (grid < end - 1e-15)]
            solution = solve_ivp(
                rates,
                (begin, end),
                y,
                method="LSODA",
                t_eval=[*inner, end],
                rtol=RTOL,
                atol=SCALE * RTOL * 0.1,
                args=(u, F_L),
            )
            y = solution.y[:, -1]
            rows.extend(solution.y[:, : len(inner)].T)
        rows.append(y)
    return np.array(rows)


def run(plant: FullOrderPlant, moves: list[Move]) -> Array:
    """Return the states of a plant at each millisecond, shape (ticks + 1, 6)."""
    steps = round(TICK / plant.dt)
    rows = [plant.state[:6]]
    for u, F_L, ticks in moves:
        for _ in range(ticks):
            plant.step(PlantInput(u, F_L), steps)
            rows.append(plant.state[:6])
    return np.array(rows)


class Errors:
    """The largest errors of some runs."""

    def __init__(self) -> None:
        self.worst = np.zeros(4)
        self.runs = self.refused = 0

    def add(self, found: Array, exact: Array, P_S: float) -> None:
        """Count one run: x [um], v [% of peak], P_A and P_B [% of P_S]."""
        error = np.abs(found - exact)[:, :4].max(axis=0)
        peak = np.abs(exact[:, 1]).max()
        self.worst = np.maximum(self.worst, error * [1e6, 100.0 / peak, 100.0 / P_S, 100.0 / P_S])
        self.runs += 1

    def cells(self) -> str:
        """Return the cells of a table's row."""
        if not self.runs:
            return "unstable, refused | | | "
        text = " | ".join(f"{value:.3g}" for value in self.worst)
        return text + (f" (refused: {self.refused})" if self.refused else "")


VARIANTS = (
    (Solver.FORWARD_EULER, PAPER_STEP),
    (Solver.LINEARLY_IMPLICIT_MIDPOINT, PAPER_STEP),
    (Solver.LINEARLY_IMPLICIT_MIDPOINT, BENCH_STEP),
    (Solver.LINEARLY_IMPLICIT_MIDPOINT, 2e-5),
    (Solver.RUNGE_KUTTA, BENCH_STEP),
    (Solver.RUNGE_KUTTA, 1e-5),
)


def print_errors() -> None:
    """Print the errors over oils, masses and positions."""
    print("\n| solver | step [us] | E [Pa] | x [um] | v [% of peak] | P_A [% of P_S] | P_B |")
    print("|---|---|---|---|---|---|---|")
    tables = {(E, variant): Errors() for E in OILS for variant in VARIANTS}
    for E, m, share in itertools.product(OILS, MASSES, SHARES):
        p = replace(paper_parameters(), E=E, m=m)
        start = balanced_state(p, x=share * p.h)
        exact = reference(p, start, step_out_and_back())
        for variant in VARIANTS:
            solver, dt = variant
            if dt > largest_step(p, OPTIONS, solver):
                tables[E, variant].refused += 1
                continue
            plant = FullOrderPlant(p, options=OPTIONS, solver=solver, dt=dt, state=start)
            tables[E, variant].add(run(plant, step_out_and_back()), exact, p.P_S)
    for variant in VARIANTS:
        for E in OILS:
            solver, dt = variant
            print(f"| {solver} | {dt * 1e6:g} | {E:.2g} | {tables[E, variant].cells()} |")


def print_orders() -> None:
    """Print the order of convergence on a smooth stretch: in motion, no edge crossed.

    The exact solution is taken from Runge-Kutta at 2 us, which LSODA meets to 1e-9 m/s.
    """
    p = paper_parameters()
    start = PlantState(*reference(p, balanced_state(p), [(8e-4, 0.0, 200)])[-1])
    moves: list[Move] = [(8.5e-4, 0.0, 20)]
    fine = FullOrderPlant(p, options=OPTIONS, solver=Solver.RUNGE_KUTTA, dt=2e-6, state=start)
    exact = run(fine, moves)
    print("\n| solver | error of v at 100, 50, 25, 12.5 us [m/s] | order |")
    print("|---|---|---|")
    for solver in Solver:
        errors = []
        for halvings in range(4):
            plant = FullOrderPlant(
                p, options=OPTIONS, solver=solver, dt=PAPER_STEP / 2**halvings, state=start
            )
            errors.append(float(np.abs(run(plant, moves) - exact)[:, 1].max()))
        order = math.log2(errors[0] / errors[2]) / 2.0
        print(f"| {solver} | {', '.join(f'{error:.2g}' for error in errors)} | {order:.2f} |")


def print_mixed() -> None:
    """Print the position error over the mixed manoeuvre."""
    p = paper_parameters()
    moves = mixed()
    exact = reference(p, balanced_state(p), moves)
    duration = sum(ticks for _, _, ticks in moves) * TICK
    print(f"\n| solver | step [us] | largest position error over {duration:g} s [um] |")
    print("|---|---|---|")
    for solver, dt in VARIANTS:
        plant = FullOrderPlant(p, options=OPTIONS, solver=solver, dt=dt)
        error = np.abs(run(plant, moves) - exact)[:, 0].max() * 1e6
        print(f"| {solver} | {dt * 1e6:g} | {error:.2f} |")


def print_limits() -> None:
    """Print the largest stable steps."""
    print("\n| E [Pa] | m [kg] | forward-euler [us] | runge-kutta [us] |")
    print("|---|---|---|---|")
    for E, m in itertools.product(OILS, MASSES):
        p = replace(paper_parameters(), E=E, m=m)
        euler, kutta = (
            largest_step(p, OPTIONS, solver) * 1e6
            for solver in (Solver.FORWARD_EULER, Solver.RUNGE_KUTTA)
        )
        print(f"| {E:.2g} | {m:g} | {euler:.1f} | {kutta:.1f} |")


def friction_curve(v: Array, p: PlantParameters) -> Array:
    """Return eq. (13) without its viscous part [N], for velocities of 0 and above [m/s]."""
    weakening = (p.F_s - p.F_c) * np.exp(-((v / p.chi) ** p.delta))
    return np.tanh(400.0 * v) * (p.F_c + weakening)


def friction_table(p: PlantParameters) -> Array:
    """Return cubic pieces, even in sqrt(v), of the curve up to 1 m/s; shape (intervals, 4)."""
    nodes = np.linspace(0.0, 1.0, FRICTION_INTERVALS + 1)
    value = friction_curve(nodes**2, p)
    fine = 1e-6
    ahead, behind = (friction_curve((nodes + sign * fine) ** 2, p) for sign in (1.0, -1.0))
    slope = (ahead - behind) / (2.0 * fine) / FRICTION_INTERVALS
    rise = np.diff(value)
    quadratic = 3.0 * rise - 2.0 * slope[:-1] - slope[1:]
    cubic = slope[:-1] + slope[1:] - 2.0 * rise
    return np.stack([value[:-1], slope[:-1], quadratic, cubic], axis=1)


@numba.njit
def look_up(v: float, table: Array) -> float:
    """Return the friction without its viscous part [N] from the table."""
    place = math.sqrt(v) * len(table)
    index = min(int(place), len(table) - 1)
    w = place - index
    a, b, c, d = table[index]
    return a + w * (b + w * (c + w * d))


@numba.njit
def compute(v: float, constants: Array) -> float:
    """Return the same from tanh, exp and pow."""
    F_c, weakening, chi, delta = constants
    level = F_c + weakening * math.exp(-((v / chi) ** delta))
    return math.tanh(400.0 * v) * level


@numba.njit
def chase(function: Callable[[float, Array], float], data: Array, count: int) -> float:
    """Evaluate a form `count` times, each at a velocity that depends on the value before."""
    v = 0.01
    for _ in range(count):
        v = 0.01 + 1e-9 * function(v, data)
    return v


def print_friction_forms() -> None:
    """Print cost and error of the friction curve by formula and by table."""
    p = paper_parameters()
    table = friction_table(p)
    constants = np.array([p.F_c, p.F_s - p.F_c, p.chi, p.delta])
    velocities = np.linspace(0.0, 1.0, 200_001)[1:] ** 3
    found = np.array([look_up(v, table) for v in velocities])
    error = np.abs(found - friction_curve(velocities, p)).max() / p.F_s
    print("\n| form | ns an evaluation, dependent chain | largest error [F_s] |")
    print("|---|---|---|")
    for name, function, data in (("formula", compute, constants), ("table", look_up, table)):
        chase(function, data, 10)
        cost = min(_seconds(function, data) for _ in range(5)) * 1e9
        print(f"| {name} | {cost:.1f} | {0.0 if name == 'formula' else error:.1e} |")


def _seconds(function: Callable[[float, Array], float], data: Array) -> float:
    count = 1_000_000
    begin = time.perf_counter()
    chase(function, data, count)
    return (time.perf_counter() - begin) / count


SECTIONS: dict[str, Callable[[], None]] = {
    "mixed": print_mixed,
    "errors": print_errors,
    "orders": print_orders,
    "limits": print_limits,
    "friction": print_friction_forms,
}


def main() -> None:
    """Print the chosen tables, or all."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("section", nargs="*", choices=[[], *SECTIONS], help="one table only")
    arguments = occasion.arguments(parser)
    chosen = arguments.section or (["orders"] if arguments.brief else SECTIONS)
    print(f"Numba {numba.__version__}, SciPy LSODA, {RTOL:g}")
    for section in chosen:
        SECTIONS[section]()


if __name__ == "__main__":
    main()
