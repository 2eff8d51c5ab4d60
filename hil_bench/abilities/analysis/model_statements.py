"""Sections II and III: what the paper says about both models, checked."""

import cmath
import math
from collections.abc import Iterator

import numpy as np

from hil_bench.abilities.analysis.operating_point import find_operating_point
from hil_bench.abilities.analysis.paper_runs import PaperRuns
from hil_bench.abilities.analysis.simulation import Signal
from hil_bench.abilities.analysis.statement import Statement, Verdict
from hil_bench.outside.recording.channels import Recording
from hil_bench.plants.hydraulic_cylinder.model import PlantParameters


def model_statements(runs: PaperRuns) -> list[Statement]:
    """Return the statements of the abstract and of sections II and III."""
    return [*_full_order(runs), *_reduced(runs.parameters)]


def _full_order(runs: PaperRuns) -> Iterator[Statement]:
    h, drop = runs.parameters.h, smallest_drop(runs)
    negative = {
        name: [float(drop) for drops in _drops(runs.parameters, run) for drop in drops[drops < 0.0]]
        for name, run in (("sign", runs.empty_with_sign), ("tanh", runs.empty_with_tanh))
    }
    farthest = float(np.abs(runs.trajectories[1].full_order["x"]).max())
    yield Statement(
        "abstract",
        "The full model “is the fifth-order and nonlinear in states”.",
        "Six states: x, v, P_A, P_B, ν and its rate. The volumes (10), (11) need x. About a steady "
        "motion x is a mere integral of v, and five are left.",
        Verdict.CORRECTED,
    )
    yield Statement(
        "II, (3)",
        "The spool's equation has ω.",
        "It is the ω₀ of (1); Table I writes ω, too.",
        Verdict.CORRECTED,
    )
    yield Statement(
        "II, (10), (11)",
        "“The drive displacement is subject to saturation, captured by sat_h.”",
        f"The volumes are; the motion (12) is not. In fig. 6 the piston reaches x = "
        f"{farthest * 1e3:.0f} mm with h = {h * 1e3:.0f} mm. A bench needs an end stop.",
        Verdict.FAILS,
    )
    yield Statement(
        "II, Table I",
        "C_L has the unit 1/s.",
        "In (8), C_L times a pressure is a flow: m³/(s Pa). Its value, 0, is the same in any unit.",
        Verdict.FAILS,
    )
    yield Statement(
        "II, IV-B",
        "During fast transients the argument of the root “can yield temporary negative”, hence "
        "tanh(400 v).",
        "From rest at balanced pressures it never does, with either sign: the smallest drop over "
        f"an open orifice in figs. 5 and 6 is {drop / 1e5:.1f} bar. From P_A = P_B = 0 the printed "
        f"sign leads to {min(negative['sign']):.0f} Pa in {len(negative['sign'])} steps of 10 s at "
        f"0.4 mm, tanh(400 v) in {len(negative['tanh'])}. Under a load beyond P_S A_A it does with "
        "both.",
        Verdict.CORRECTED,
    )


def smallest_drop(runs: PaperRuns) -> float:
    """Return the smallest pressure drop over an open orifice in the full-order runs [Pa]."""
    recordings = [
        *(run.recording for run in runs.chirps[:2]),
        *(pair.full_order for pair in runs.trajectories),
    ]
    return min(float(drops.min()) for run in recordings for drops in _drops(runs.parameters, run))


def _drops(parameters: PlantParameters, run: Recording) -> Iterator[Signal]:
    out, back = run[run["z"] > 0.0], run[run["z"] < 0.0]
    yield parameters.P_S - out["P_A"]
    yield out["P_B"] - parameters.P_T
    yield back["P_A"] - parameters.P_T
    yield parameters.P_S - back["P_B"]


def _reduced(parameters: PlantParameters) -> Iterator[Statement]:
    ratio = parameters.omega_0 / parameters.omega_c
    # Phase of eq. (1)'s denominator at s = j omega_c, in units of omega_c
    lag = math.degrees(cmath.phase(ratio**2 - 1.0 + 2j * parameters.xi * ratio))
    yield Statement(
        "III",
        "Hydraulic and mechanical time-constants are larger than the valve's “by two to three "
        "orders of magnitude”.",
        f"By Table I, ω₀ / ω_c = {ratio:.2f}. At ω_c the spool lags by {lag:.0f}°, which the "
        "reduced model lacks.",
        Verdict.FAILS,
    )
    out, back = (find_operating_point(parameters, spool_position=u) for u in (1e-3, -1e-3))
    yield Statement(
        "III",
        "“A closed hydraulic circuit, i.e. |Q_A| = |Q_B|.”",
        "In steady motion Q_A / Q_B = A_A / A_B = "
        f"{parameters.A_A / parameters.A_B:.3f}; a double rod has 1.",
        Verdict.CORRECTED,
    )
    sums = [(point.pressure_a + point.pressure_b) / parameters.P_S for point in (out, back)]
    yield Statement(
        "III, (15)",
        "P_A and P_B are (P_S ± P_L) / 2, so P_A + P_B = P_S.",
        f"In steady motion at |u| = 1 mm the full model has P_A + P_B = {sums[0]:.3f} P_S out and "
        f"{sums[1]:.3f} P_S back; a double rod has P_S.",
        Verdict.CORRECTED,
    )
    error, rod = parameters.A_A - parameters.mean_area, parameters.A_A - parameters.A_B
    yield Statement(
        "III, (16)",
        "For single rods the mean area “bears an averaging error of the half of the rod "
        "cross-section area”.",
        f"A_A - Ā = {error * 1e4:.2f} cm², half of the rod's {rod * 1e4:.2f} cm². The steady "
        f"velocities at |u| = 1 mm are {out.velocity * 1e3:+.1f} and {back.velocity * 1e3:+.1f} "
        "mm/s, of which the reduced model knows the mean.",
        Verdict.HOLDS,
    )
