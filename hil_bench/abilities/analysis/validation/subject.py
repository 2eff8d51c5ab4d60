"""The plant under validation, and a check of it."""

import math
from dataclasses import dataclass, replace
from enum import StrEnum

from hil_bench.plants.hydraulic_cylinder.model import (
    FullOrderPlant,
    PlantOptions,
    PlantParameters,
    PlantState,
    Solver,
)
from hil_bench.plants.hydraulic_cylinder.model.stepping import DEFAULT_STEP

# The subject of a validation: the full-order model with the parameters of one cylinder.

_HALVINGS = 200  # until the interval holds no further number


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """The equations (1)-(13) with the parameters of one cylinder.

    Attributes:
        name: of the cylinder.
        parameters: those that closed forms are computed from.
        solver: of the bench.
        dt: step of the bench [s].
    """

    name: str
    parameters: PlantParameters
    solver: Solver = Solver.LINEARLY_IMPLICIT_MIDPOINT
    dt: float = DEFAULT_STEP

    def without_friction(self) -> "Subject":
        """Return the same with viscous friction alone."""
        return replace(self, parameters=replace(self.parameters, F_c=0.0, F_s=0.0))

    def plant(self, state: PlantState | None = None) -> FullOrderPlant:
        """Return the plant, by default in the balanced rest at mid-stroke."""
        return FullOrderPlant(
            self.parameters,
            options=PlantOptions.paper(),
            solver=self.solver,
            dt=self.dt,
            state=state,
        )

    def steps(self, time: float) -> int:
        """Return the number of steps in a time [s], at least one."""
        return max(1, round(time / self.dt))


def friction(parameters: PlantParameters, velocity: float) -> float:
    """Return the friction [N] by eq. (13), with tanh(400 v) for the sign (section II)."""
    stribeck = math.exp(-((abs(velocity) / parameters.chi) ** parameters.delta))
    level = parameters.F_c + (parameters.F_s - parameters.F_c) * stribeck
    return level * math.tanh(400.0 * velocity) + parameters.sigma * velocity


def flow_coefficient(parameters: PlantParameters) -> float:
    """Return K of eq. (7) [m²/s per sqrt(Pa)]."""
    return parameters.C_d * parameters.w * math.sqrt(2.0 / parameters.rho)


def steady_speed(parameters: PlantParameters, opening: float, sign: float) -> float:
    """Return the speed [m/s] at an orifice state [m], out for a positive sign, back otherwise.

    With both pressures constant, (5), (6), (8), (9) and (12) leave one equation,
    P_S A_in - P_T A_out - f(v) = (A_A³ + A_B³) (v / (z K))², which bisection solves.
    """
    p = parameters
    driving, driven = (p.A_A, p.A_B) if sign > 0.0 else (p.A_B, p.A_A)
    force = p.P_S * driving - p.P_T * driven
    resistance = (p.A_A**3 + p.A_B**3) / (opening * flow_coefficient(p)) ** 2
    low, high = 0.0, math.sqrt(force / resistance)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        left = force - friction(p, middle) - resistance * middle**2
        low, high = (middle, high) if left > 0.0 else (low, middle)
    return low


def steady_pressures(
    parameters: PlantParameters, opening: float, velocity: float
) -> tuple[float, float]:
    """Return P_A and P_B [Pa] at an orifice state [m] and a constant velocity [m/s]."""
    p = parameters
    per_area = (velocity / (opening * flow_coefficient(p))) ** 2
    if velocity > 0.0:
        return p.P_S - p.A_A**2 * per_area, p.P_T + p.A_B**2 * per_area
    return p.P_T + p.A_A**2 * per_area, p.P_S - p.A_B**2 * per_area


def held_displacement(
    parameters: PlantParameters, pressures: tuple[float, float], load: float
) -> float:
    """Return the displacement [m] by which a load [N] moves a closed cylinder from mid-stroke.

    A closed chamber keeps V exp(P / E), eqs. (8)-(11); at rest P_A A_A - P_B A_B is the load.
    """
    low, high = -parameters.h, parameters.h
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        P_A, P_B = closed_pressures(parameters, pressures, middle)
        left = P_A * parameters.A_A - P_B * parameters.A_B - load
        low, high = (middle, high) if left > 0.0 else (low, middle)
    return low


def closed_pressures(
    parameters: PlantParameters, pressures: tuple[float, float], x: float
) -> tuple[float, float]:
    """Return P_A and P_B [Pa] of a closed cylinder that was moved from mid-stroke to x [m]."""
    p = parameters
    P_A, P_B = pressures
    return (
        P_A - p.E * math.log((p.V_A0 + p.A_A * x) / p.V_A0),
        P_B - p.E * math.log((p.V_B0 - p.A_B * x) / p.V_B0),
    )


# One quantity of the plant beside the value that it must have.


class CheckVerdict(StrEnum):
    """The verdict of a check."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_APPLICABLE = "not applicable"


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidationCheck:
    """One quantity of the plant beside the value that it must have.

    Attributes:
        subject: the plant, as in ``Table I``.
        name: of the quantity, and where it is looked at.
        unit: its symbol; ``-`` for a pure number.
        source: where the expected value comes from.
        expected: the value that is right; None where there is none.
        found: what the plant has; None where it was not asked.
        tolerance: largest difference that passes, in the same unit.
        detail: why the check does not apply, or what else is worth knowing.
    """

    subject: str
    name: str
    unit: str
    source: str
    expected: float | None = None
    found: float | None = None
    tolerance: float = 0.0
    detail: str = ""

    @property
    def verdict(self) -> CheckVerdict:
        """The verdict: passed where the value found is within the tolerance; NaN never passes."""
        if self.expected is None or self.found is None:
            return CheckVerdict.NOT_APPLICABLE
        is_right = abs(self.found - self.expected) <= self.tolerance
        return CheckVerdict.PASSED if is_right else CheckVerdict.FAILED
