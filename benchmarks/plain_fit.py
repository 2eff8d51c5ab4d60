"""The plainest estimate by the bench's plant: whole strokes, SciPy's least squares, soft_l1.

It is the yardstick of `identification_strangers.py`: what a user's script of an hour reaches. All
unknowns are scaled to about one. First the few that matter most are sought on a third of the
strokes, then all of them on all; no cross-validation, no intervals, no advice.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import (
    ConstantLoad,
    EntrainedAir,
    MeteringLands,
    PlantParameters,
    PlantState,
)
from stranger_prediction import BenchPlant, Shown, Stroke, Values, run_bench

UNITS = (0.5e-3, 1e5, 1e5)  # a residual of one: position [m], pressures [Pa]
STEP = 1e-4  # [s] of the plant
ROWS = 4  # ticks between two residuals


class Unknown(NamedTuple):
    """A number that is sought: its start and bounds, as a factor of a unit or by itself."""

    name: str
    start: float
    low: float
    high: float


FIRST = (
    Unknown("flow", 0.0, -0.7, 0.7),  # logarithm of the factor of the data sheet's
    Unknown("saturation", 0.3, 0.0, 6.0),
    Unknown("dry", 0.0, -2.0, 2.0),
    Unknown("viscous", 0.0, -3.0, 2.0),
    Unknown("shift", 0.0, -0.1, 0.1),  # of the spool's centre, share of its stroke
    Unknown("overlap", 0.0, -0.2, 0.2),
    Unknown("load", 0.0, -3.0, 3.0),  # in breakaway forces
    Unknown("delay", 0.5, 0.0, 10.0),  # [ms]
)
REST = (
    Unknown("gain_at", 0.0, -0.4, 0.4),
    Unknown("gain_pb", 0.0, -0.4, 0.4),
    Unknown("gain_bt", 0.0, -0.4, 0.4),
    Unknown("lap_bt", 0.0, -0.1, 0.1),
    Unknown("lap_at", 0.0, -0.1, 0.1),
    Unknown("air", 0.3, 0.0, 6.0),  # [%]
    Unknown("modulus", 0.0, -1.5, 0.5),
    Unknown("hose_a", 0.3, 0.0, 8.0),  # [0.1 l]
    Unknown("hose_b", 0.3, 0.0, 8.0),
    Unknown("omega", 0.0, -1.0, 1.0),
    Unknown("supply", 0.0, -0.3, 0.1),
    Unknown("tank", 0.1, 0.0, 1.0),  # [MPa]
    Unknown("leakage", 0.1, 0.0, 5.0),
)


def build(known: BenchPlant, values: dict[str, float]) -> BenchPlant:
    """Return the plant of the data sheet with the numbers that are sought."""

    def get(name: str) -> float:
        return values.get(name, 0.0)

    p, o = known.parameters, known.options
    dry, full = np.exp(get("dry")), p.full_opening
    beta = max(p.beta + get("overlap") * full, 0.0)
    laps = {
        "overlap_pa": get("shift"),
        "overlap_bt": get("shift") + get("lap_bt"),
        "overlap_pb": -get("shift"),
        "overlap_at": -get("shift") + get("lap_at"),
    }
    parameters = replace(
        p,
        w=p.w * np.exp(get("flow")),
        alpha=full - beta,
        beta=beta,
        F_c=p.F_c * dry,
        F_s=p.F_s * dry,
        sigma=p.sigma * np.exp(get("viscous")),
        E=p.E * np.exp(get("modulus")),
        V_A0=p.V_A0 + 1e-4 * get("hose_a"),
        V_B0=p.V_B0 + 1e-4 * get("hose_b"),
        omega_0=p.omega_0 * np.exp(get("omega")),
        P_S=p.P_S * (1.0 + get("supply")),
        P_T=p.P_T + 1e6 * get("tank"),
        C_L=p.C_L + 1e-12 * get("leakage"),
    )
    lands = MeteringLands(
        saturation=get("saturation"),
        **{name: float(np.exp(get(name))) for name in ("gain_at", "gain_pb", "gain_bt")},
        **{name: beta + full * lap for name, lap in laps.items()},
    )
    air = EntrainedAir(air_fraction=0.01 * get("air")) if get("air") > 0.0 else None
    loads = (*o.loads, ConstantLoad(get("load") * p.F_s))
    options = replace(o, lands=lands, air=air, loads=loads)
    return known._replace(parameters=parameters, options=options, delay=1e-3 * get("delay"))


def start_of(stroke: Stroke, parameters: PlantParameters, force: float) -> PlantState:
    """Return a state at rest from the first rows; the pressure that is not measured balances."""
    rows = max(int(np.argmax(stroke.command != 0.0)) // 2, 1)
    x, first, second = (float(np.mean(one[:rows])) for one in (stroke.x, stroke.P_A, stroke.P_B))
    if np.isnan(first):
        first = (second * parameters.A_B + force) / parameters.A_A
    if np.isnan(second):
        second = max((first * parameters.A_A - force) / parameters.A_B, 0.0)
    return PlantState(x, 0.0, first, second, 0.0, 0.0)


def residuals(model: BenchPlant, strokes: Sequence[Stroke]) -> Values:
    """Return the residuals of all strokes, in `UNITS`; absent pressures are nought."""
    force = sum(load.force_at(0.0, 0.0) for load in model.options.loads)
    parts = []
    for stroke in strokes:
        start = start_of(stroke, model.parameters, force)
        fed = model.fed(stroke.supply)
        parts += _missed(stroke, run_bench(fed, stroke.command, start, ticks=ROWS))
    return np.nan_to_num(np.concatenate(parts), nan=0.0, posinf=1e3, neginf=-1e3)


def _missed(stroke: Stroke, shown: Shown) -> list[Values]:
    pairs = zip((stroke.x, stroke.P_A, stroke.P_B), shown, UNITS, strict=True)
    return [(true[::ROWS][: len(model)] - model) / unit for true, model, unit in pairs]


def fit(known: BenchPlant, strokes: Sequence[Stroke], evaluations: int = 20) -> BenchPlant:
    """Estimate a machine from its strokes, beginning with the data sheet.

    Args:
        known: the plant of the data sheet.
        strokes: that were logged.
        evaluations: of the residuals, beside those for slopes, in each of both stages.
    """
    known = known._replace(dt=STEP)
    values: dict[str, float] = {}
    for unknowns, used in ((FIRST, strokes[::3]), (FIRST + REST, strokes)):
        start = [values.get(one.name, one.start) for one in unknowns]
        values = _search(known, unknowns, start, used, evaluations)
    return build(known, values)._replace(dt=5e-5)


def _search(
    known: BenchPlant,
    unknowns: Sequence[Unknown],
    start: Sequence[float],
    strokes: Sequence[Stroke],
    evaluations: int,
) -> dict[str, float]:
    names = [one.name for one in unknowns]
    low = np.array([one.low for one in unknowns])
    scale = np.array([one.high for one in unknowns]) - low

    def missed(shares: Values) -> Values:
        numbers = (low + scale * shares).tolist()
        try:
            return residuals(build(known, dict(zip(names, numbers, strict=True))), strokes)
        except ParameterError:  # a swing that the step cannot follow
            return np.full(sum(3 * (len(one.x) // ROWS) for one in strokes), 1e2)

    def slopes(shares: Values) -> Values:
        base = missed(shares)
        sides = np.where(shares > 0.5, -1e-4, 1e-4)
        moved = [missed(shares + step) - base for step in np.diag(sides)]
        return np.array(moved).T / sides

    first = np.clip((np.array(start) - low) / scale, 1e-3, 1.0 - 1e-3)
    found = least_squares(
        missed, first, slopes, bounds=(0.0, 1.0), loss="soft_l1", max_nfev=evaluations
    )
    return dict(zip(names, (low + scale * found.x).tolist(), strict=True))
