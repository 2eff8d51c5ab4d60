"""The validation of a plant: all checks, those against published figures included."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

from hil_bench.abilities.analysis.closed_forms import (
    Subject,
    ValidationCheck,
    closed_form_checks,
)
from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.model import Model, PlantInput, Solver, paper_parameters
from hil_bench.plants.plant import AxisConfig

# The model with the parameters of the paper against what the paper and other tools print.

TABLE_I = {
    "alpha": (1e-3, "m"),
    "beta": (3e-4, "m"),
    "omega_0": (1200.0, "rad/s"),
    "xi": (0.7, "-"),
    "C_d": (0.65, "-"),
    "w": (0.02, "m"),
    "rho": (850.0, "kg/m³"),
    "E": (1e8, "Pa"),
    "P_S": (1e7, "Pa"),
    "P_T": (0.0, "Pa"),
    "C_L": (0.0, "m³/(s Pa)"),
    "A_A": (5e-3, "m²"),
    "A_B": (4.7e-3, "m²"),
    "V_A0": (1.2e-3, "m³"),
    "V_B0": (1.15e-3, "m³"),
    "m": (20.0, "kg"),
    "F_c": (600.0, "N"),
    "F_s": (900.0, "N"),
    "sigma": (2000.0, "kg/s"),
    "chi": (0.02, "m/s"),
    "delta": (0.8, "-"),
    "h": (0.2, "m"),
}
"""Table I of Ruderman, IECON 2017, as printed; the unit of C_L there is a misprint."""

_HOPSAN_RANGE = 67.36e-3
_FINE_RANGE = 67.45e-3
_FINE_SPEED = 0.20507
_AMPLITUDE = 1e-3  # [m], the larger one of section IV-C


def published_checks(subject: Subject) -> Iterator[ValidationCheck]:
    """Yield the checks of a plant that should have the parameters of Table I.

    Yields:
        One check after the other.
    """
    yield from _table(subject)
    yield from _linear(subject)
    yield from _sinusoid(subject)
    yield _reference(subject)


def _table(subject: Subject) -> Iterator[ValidationCheck]:
    for symbol, (expected, unit) in TABLE_I.items():
        yield ValidationCheck(
            subject=subject.name,
            name=f"parameter {symbol}",
            unit=unit,
            source="Table I, Ruderman, IECON 2017",
            expected=expected,
            found=getattr(subject.parameters, symbol),
            tolerance=1e-12 * expected,
        )


def _linear(subject: Subject) -> Iterator[ValidationCheck]:
    """Yield (7), (19) and (20) from the printed values, beside what the model works with."""
    value = {symbol: number for symbol, (number, _) in TABLE_I.items()}
    area, volume = 0.5 * (value["A_A"] + value["A_B"]), value["V_A0"] + value["V_B0"]
    p = subject.parameters
    rows = (
        (
            "K",
            "m²/(s √Pa)",
            "eq. (7) with Table I: C_d w √(2 / rho)",
            value["C_d"] * value["w"] * math.sqrt(2.0 / value["rho"]),
            p.K,
        ),
        (
            "ω_c",
            "rad/s",
            "eq. (19) with Table I: 2 Ā √(E / (V_t m))",
            2.0 * area * math.sqrt(value["E"] / (volume * value["m"])),
            p.omega_c,
        ),
        (
            "ζ",
            "-",
            "eq. (20) with Table I: σ / (4 Ā) √(V_t / (E m))",
            value["sigma"] / (4.0 * area) * math.sqrt(volume / (value["E"] * value["m"])),
            p.zeta,
        ),
    )
    for name, unit, source, expected, found in rows:
        yield ValidationCheck(
            subject=subject.name,
            name=name,
            unit=unit,
            source=source,
            expected=expected,
            found=found,
            tolerance=1e-9 * expected,
        )


def _sinusoid(subject: Subject) -> Iterator[ValidationCheck]:
    """Yield what ten seconds of u = 1 mm sin(2 pi t) do from the balanced rest (section IV-C)."""
    plant = subject.plant()
    held = subject.steps(1e-3)
    positions, speeds = [], []
    for number in range(10_000):
        seen = plant.step(PlantInput(_AMPLITUDE * math.sin(2.0 * math.pi * number * 1e-3)), held)
        positions.append(seen.x)
        speeds.append(seen.v)
    travel = max(positions) - min(positions)
    rows = (
        ("range of the position", "m", "Hopsan's own solution", _HOPSAN_RANGE, travel, 2e-4),
        ("range of the position", "m", "integration of high order", _FINE_RANGE, travel, 2e-5),
        ("largest speed", "m/s", "integration of high order", _FINE_SPEED, max(speeds), 2e-5),
    )
    for name, unit, source, expected, found, tolerance in rows:
        yield ValidationCheck(
            subject=subject.name,
            name=f"{name} under u = 1 mm sin(2 π t), 10 s",
            unit=unit,
            source=f"{source} of Table I with this input",
            expected=expected,
            found=found,
            tolerance=tolerance,
        )


def _reference(subject: Subject) -> ValidationCheck:
    """Return the position against Runge-Kutta of fourth order at a tenth of the step."""
    fine = Subject(
        name=subject.name,
        parameters=subject.parameters,
        solver=Solver.RUNGE_KUTTA,
        dt=subject.dt / 10.0,
    )
    plants = [(each.plant(), each.steps(1e-3)) for each in (subject, fine)]
    largest = 0.0
    for setpoint in [1e-3] * 300 + [0.0] * 200 + [-1e-3] * 300 + [0.0] * 200:
        here, there = (plant.step(PlantInput(setpoint), steps).x for plant, steps in plants)
        largest = max(largest, abs(here - there))
    return ValidationCheck(
        subject=subject.name,
        name="largest difference of the position from a reference, out, stop, back, stop",
        unit="m",
        source="Runge-Kutta of fourth order at a tenth of the step",
        expected=0.0,
        found=largest,
        tolerance=1e-6,
    )


# All checks of the plant: the paper's cylinder, and those of a bench.

PAPER = "Table I"
"""Name of the paper's cylinder."""


def validate(axes: Iterable[AxisConfig], dt: float) -> Iterator[ValidationCheck]:
    """Check the model with the paper's parameters, and with those of each cylinder of a bench.

    Extensions of a cylinder and its leakage are off: their closed forms are those of tests.

    Args:
        axes: of the bench.
        dt: step of its solvers [s].

    Yields:
        One check after the other.
    """
    paper = Subject(name=PAPER, parameters=paper_parameters())
    yield from published_checks(paper)
    yield from closed_form_checks(paper)
    for axis in axes:
        yield from _axis_checks(axis, dt)


def _axis_checks(axis: AxisConfig, dt: float) -> Iterator[ValidationCheck]:
    if not isinstance(axis, CylinderConfig):
        yield _without_checks(axis, f"it is a {axis.kind.name}, not a cylinder")
        return
    if axis.model is not Model.FULL_ORDER:
        yield _without_checks(axis, "the closed forms are those of the full-order model")
        return
    parameters = replace(axis.parameters, C_L=0.0)
    subject = Subject(name=axis.name, parameters=parameters, solver=axis.solver, dt=dt)
    try:
        yield from closed_form_checks(subject)
    except ParameterError as error:
        yield _without_checks(axis, str(error))


def _without_checks(axis: AxisConfig, reason: str) -> ValidationCheck:
    return ValidationCheck(
        subject=axis.name, name="closed forms", unit="-", source="equations (1)-(13)", detail=reason
    )
