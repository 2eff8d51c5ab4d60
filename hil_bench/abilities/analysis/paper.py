"""The paper's statements, those about linear models first."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from hil_bench.abilities.analysis.frequency_response import root_locus
from hil_bench.abilities.analysis.linearisation import (
    CoefficientForm,
    SecondOrderSystem,
    linearise_full,
    linearise_orifice,
    linearise_reduced,
    linearise_with_valve,
)
from hil_bench.abilities.analysis.model_statements import (
    PaperRuns,
    Statement,
    Verdict,
    model_statements,
    run_paper,
)
from hil_bench.abilities.analysis.operating_point import (
    find_operating_point,
    flow_pressure_curves,
    load_flow,
)
from hil_bench.abilities.analysis.simulation_statements import simulation_statements
from hil_bench.abilities.analysis.study import (
    Study,
    flow_pressure_study,
    measured_responses_study,
    operating_points_study,
    root_locus_study,
    trajectories_study,
    write_study,
)
from hil_bench.abilities.common.files import whole_file
from hil_bench.errors import about_file, check_replaceable
from hil_bench.plants.hydraulic_cylinder.model import PlantParameters

# Section IV-A: what the paper says about the linear model, checked.


def linear_statements(parameters: PlantParameters) -> list[Statement]:
    """Return the statements of section IV-A."""
    return [
        *_eigenfrequency(parameters),
        *_damping(parameters),
        *_locus_and_curves(parameters),
        *_coefficients(parameters),
        *_operating_points(parameters),
    ]


def _mode(parameters: PlantParameters, velocity: float, position: float) -> tuple[float, float]:
    """Return eigenfrequency [rad/s] and damping ratio of the full-order model in motion."""
    point = find_operating_point(parameters, velocity=velocity, position=position)
    return linearise_full(parameters, point).hydraulic_mode or (math.nan, math.nan)


def _eigenfrequency(parameters: PlantParameters) -> Iterator[Statement]:
    plain = linearise_reduced(parameters)
    middle, end = (_mode(parameters, 0.1, share * parameters.h) for share in (0.0, 0.95))
    yield Statement(
        "IV-A, (18)-(20)",
        "The linear model “offers a creditable estimation” of gain, eigenfrequency and damping.",
        f"ω_c = {plain.eigenfrequency:.2f} rad/s, ζ = {plain.damping_ratio:.4f}, poles "
        f"{plain.poles[0].real:.0f} ± {plain.poles[0].imag:.1f}j. The full model at 100 mm/s: "
        f"{middle[0]:.1f} rad/s, {middle[1]:.4f} at mid-stroke, but {end[0]:.0f} rad/s, "
        f"{end[1]:.4f} at 95 % of the half-stroke, where one chamber is small.",
        Verdict.CORRECTED,
    )


def _damping(parameters: PlantParameters) -> Iterator[Statement]:
    plain = linearise_reduced(parameters)
    slow = _mode(parameters, 0.015, 0.0)
    yield Statement(
        "IV-A",
        "Viscous friction alone is “an artificial case of the weakest mechanical damping”; real "
        "friction adds to it.",
        "Where the curve (13) falls it takes damping away: at 15 mm/s the full model has "
        f"ζ = {slow[1]:.3f}, so the motion is unstable there and ends in a limit cycle.",
        Verdict.FAILS,
    )
    wide = linearise_reduced(
        replace(parameters, A_A=2.0 * parameters.A_A, A_B=2.0 * parameters.A_B, h=0.1)
    )
    stiff = linearise_reduced(replace(parameters, E=10.0 * parameters.E))
    yield Statement(
        "IV-A",
        "“Increasing Ā proportionally reduces the system damping.”",
        f"With twice the areas ζ falls from {plain.damping_ratio:.4f} to {wide.damping_ratio:.4f}.",
        Verdict.HOLDS,
    )
    yield Statement(
        "IV-A",
        "“Unlike the mechanical stiffness, the bulk modulus influences the system damping as "
        "well.”",
        f"It does: with E = 1e9 Pa ζ falls to {stiff.damping_ratio:.4f}, by the root of 10. But so "
        "does a mechanical stiffness k in m s² + σ s + k, where ζ = σ / (2 √(k m)).",
        Verdict.CORRECTED,
    )
    yield Statement(
        "IV-A",
        "“The cylinders with larger Ā can achieve higher velocities.”",
        f"The gain of (18) is 1 / Ā: with twice the areas it falls from {plain.gain:.1f} to "
        f"{wide.gain:.1f} (m/s)/(m³/s), so the same flow moves the piston at half the velocity.",
        Verdict.FAILS,
    )
    loaded = _at(parameters, 0.95, 0.95)
    yield Statement(
        "IV-A",
        "Friction is “the single factor influencing the overall system damping” without acting on "
        "the eigenfrequency.",
        "Orifice (24) and leakage (16) do as much: at 0.95 α, 0.95 P_S the orifice takes ζ from "
        f"{plain.damping_ratio:.3f} to {loaded.damping_ratio:.3f} and ω_c up by "
        f"{100.0 * (loaded.eigenfrequency / plain.eigenfrequency - 1.0):.1f} % only.",
        Verdict.CORRECTED,
    )


def _locus_and_curves(parameters: PlantParameters) -> Iterator[Statement]:
    locus, with_spool = root_locus(parameters), root_locus(parameters, with_spool=True)
    yield Statement(
        "IV-A, fig. 2",
        "Position control “remains oscillating” and becomes “unstable starting from certain "
        "feedback gain”.",
        f"The pair stays complex for every k, and is unstable above k = σ Ā / m = "
        f"{locus.critical_gain:.3f} m²/s ({with_spool.critical_gain:.3f} m²/s with the spool's "
        f"lag, at {with_spool.critical_frequency:.0f} instead of "
        f"{locus.critical_frequency:.0f} rad/s).",
        Verdict.HOLDS,
    )
    alpha, half = parameters.alpha, 0.5 * parameters.P_S
    curves = flow_pressure_curves(parameters, orifice_states=[alpha], points=3)
    yield Statement(
        "IV-A, fig. 3",
        "The curves end at “max P_L = P_S”.",
        f"At z = α the flow falls from {curves.flow[0, 0] * 6e4:.1f} l/min to "
        f"{curves.flow[0, -1] * 6e4:.1f} l/min at P_L = P_S.",
        Verdict.HOLDS,
    )
    out, back, mirrored = (
        load_flow(parameters, state, pressure) * 6e4
        for state, pressure in ((alpha, half), (-alpha, -half), (-alpha, half))
    )
    yield Statement(
        "IV-A, fig. 3",
        "For negative load values the curves “are symmetrical with respect to both axes”.",
        f"To the origin only: {out:.1f} l/min at α and P_S / 2 become {back:.1f} l/min at -α and "
        f"-P_S / 2. Mirrored at one axis, -α at +P_S / 2, it is {mirrored:.1f} l/min.",
        Verdict.CORRECTED,
    )


def _coefficients(parameters: PlantParameters) -> Iterator[Statement]:
    printed, consistent = (
        linearise_orifice(
            parameters, orifice_state=0.5 * parameters.alpha, load_pressure=0.5e7, form=form
        )
        for form in (CoefficientForm.PRINTED, CoefficientForm.CONSISTENT)
    )
    yield Statement(
        "IV-A, (21), (22)",
        "C_q = K √(P_S - P_L) and C_qp = K z / (2 √(P_S - P_L)) are the derivatives of (14).",
        "The factor 1/2 under the root of (14) is lost: both are too large by "
        f"{printed.flow_gain / consistent.flow_gain:.4f} = √2. Consistent: C_q = K √((P_S - P_L) / "
        "2), C_qp = K z / (2 √(2 (P_S - P_L))). Fig. 4 is drawn with these; with the printed ones "
        f"it stands {20.0 * math.log10(printed.flow_gain / consistent.flow_gain):.1f} dB higher.",
        Verdict.FAILS,
    )
    small, large, closed = (
        linearise_orifice(
            parameters, orifice_state=share * parameters.alpha, load_pressure=0.95e7
        ).flow_pressure_coefficient
        for share in (0.05, 0.95, 0.0)
    )
    yield Statement(
        "IV-A",
        "C_qp “is rather low for small amplitudes” and “remains zero even for higher load "
        "pressures” at the closed valve.",
        f"At 0.95 P_S: {small:.2e} m³/(s Pa) at 0.05 α, {large:.2e} at 0.95 α, {closed:g} at "
        "z = 0.",
        Verdict.HOLDS,
    )


def _operating_points(parameters: PlantParameters) -> Iterator[Statement]:
    plain = linearise_reduced(parameters).damping_ratio
    systems = {(z, p): _at(parameters, z, p) for z in (0.05, 0.95) for p in (0.05, 0.95)}
    fall = 20.0 * math.log10(systems[0.05, 0.05].gain / systems[0.05, 0.95].gain)
    frequencies = [system.eigenfrequency for system in systems.values()]
    spread = 100.0 * (max(frequencies) / min(frequencies) - 1.0)
    yield Statement(
        "IV-A, fig. 4",
        "Load pressure changes “significantly the system gain, while the principal shape … remains "
        "quite similar”.",
        f"From 0.05 to 0.95 P_S the gain falls by {fall:.1f} dB; the eigenfrequencies of the four "
        f"points lie within {spread:.1f} %.",
        Verdict.HOLDS,
    )
    increase = {
        point: 100.0 * (system.damping_ratio / plain - 1.0) for point, system in systems.items()
    }
    yield Statement(
        "IV-A, fig. 4",
        "“An increased system damping is solely in case of the maximal orifice and load pressure.”",
        f"Mostly. Over the {plain:.4f} of (20) ζ rises by {increase[0.95, 0.95]:.0f} % there, but "
        f"also by {increase[0.95, 0.05]:.0f} % at high orifice and low pressure, by "
        f"{increase[0.05, 0.95]:.1f} % at low and high, by {increase[0.05, 0.05]:.1f} % where both "
        "are low.",
        Verdict.CORRECTED,
    )


def _at(parameters: PlantParameters, opening: float, pressure: float) -> SecondOrderSystem:
    return linearise_with_valve(
        parameters,
        orifice_state=opening * parameters.alpha,
        load_pressure=pressure * parameters.P_S,
    )


REPORT = "paper-report.md"
"""Name of the report's file."""

IMAGES = "images"
"""Name of the directory of figures and data beside it."""

_CAPTIONS = {
    "paper-fig2": "Root locus for the open loop k G(s) / s.",
    "paper-fig3": "Static load flow-pressure characteristic curves.",
    "paper-fig4": "Responses of the linearised system (24) at four operating points.",
    "paper-fig5": "Measured responses of both models; input nonlinearities left out.",
    "paper-fig6": "Velocity trajectories and phase portraits for sinusoidal inputs.",
}

_HEAD = """\
# The paper, checked

M. Ruderman, "Full- and Reduced-order Model of Hydraulic Cylinder for Motion Control", IECON 2017,
with the parameters of its Table I. `hil-bench analyse paper --output DIR` writes this report, the
figures (PNG, SVG) and their data (CSV).

Sections IV-B and IV-C are simulated as the paper says: forward Euler at 1e-4 s, tanh(400 v) for the
sign. What it does not say was decided: a run starts from rest at mid-stroke with P_A A_A = P_B A_B;
the chirp is linear in time and lasts {duration:g} s; spectra are by Welch's method (Hann windows of
4 s, three quarters of each in common), smoothed over 1/48 of an octave; they are corrected for the
set-point's hold over a step. Nothing was tuned to the paper's pictures.
"""


def check_paper(runs: PaperRuns) -> list[Statement]:
    """Return every statement that was checked, in the order of the paper."""
    return [
        *model_statements(runs),
        *linear_statements(runs.parameters),
        *simulation_statements(runs),
    ]


def paper_studies(runs: PaperRuns) -> list[Study]:
    """Return the studies that draw figures 2 to 6."""
    return [
        root_locus_study(runs.parameters, name="paper-fig2"),
        flow_pressure_study(runs.parameters, name="paper-fig3"),
        operating_points_study(runs.parameters, name="paper-fig4"),
        measured_responses_study(runs.chirps, name="paper-fig5"),
        trajectories_study(runs.trajectories, name="paper-fig6"),
    ]


def write_paper(directory: Path, runs: PaperRuns | None = None) -> list[Path]:
    """Write figures, data and report; return the files, the report first.

    Args:
        directory: that is there.
        runs: what was simulated; None to simulate it now.
    """
    report = directory / REPORT
    images = directory / IMAGES
    with about_file(directory, right="give a directory of yours"):
        images.mkdir(exist_ok=True)
        check_replaceable(report)
        report.touch()
    runs = run_paper() if runs is None else runs
    files = [path for study in paper_studies(runs) for path in write_study(study, images)]
    with about_file(report), whole_file(report) as file:
        file.write_text(report_text(runs), encoding="utf-8")
    return [report, *files]


def report_text(runs: PaperRuns) -> str:
    """Return the report as Markdown."""
    statements = check_paper(runs)
    parts = [_HEAD.format(duration=runs.chirps[0].chirp.duration), _counts(statements)]
    parts += ["## Statements\n", _table(statements), "## Figures\n"]
    parts += [
        f"![{caption}]({IMAGES}/{name}.png)\n\nFig. {name[-1]}. {caption}\n"
        for name, caption in _CAPTIONS.items()
    ]
    return "\n".join(parts)


def _counts(statements: Sequence[Statement]) -> str:
    verdicts = [statement.verdict for statement in statements]
    counts = [f"{verdict}: {verdicts.count(verdict)}" for verdict in Verdict]
    return f"{len(statements)} statements. {'; '.join(counts)}.\n"


def _table(statements: Sequence[Statement]) -> str:
    rows = ["| where | the paper | found | verdict |", "|---|---|---|---|"]
    for place, claim, found, verdict in statements:
        cells = (place, claim, found, f"**{verdict}**")
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(rows) + "\n"
