"""A plant under test, and its closed forms beside it."""

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import pairwise

from hil_bench.abilities.analysis.linearisation import linearise_full
from hil_bench.abilities.analysis.operating_point import find_operating_point
from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import (
    FullOrderPlant,
    PlantInput,
    PlantOptions,
    PlantParameters,
    PlantState,
    Solver,
    balanced_state,
)
from hil_bench.plants.hydraulic_cylinder.model.stepping import DEFAULT_STEP

# The plant under validation, and a check of it.


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


# The full-order model against closed forms of the equations (1)-(13), without leakage.
#
# The closed forms are written out here; nothing of them is taken from the model.


_OPENING = 0.5  # of the valve's full opening, in the steady motions
_REACH = 0.9  # of the half-stroke, where they begin and end
_TIME_CONSTANTS = 10.0  # leave 5e-5 of what a motion begins with
_STEADY = "P_S A_in - P_T A_out - f(v) = (A_A³ + A_B³) (v / (z K))², from eqs. (5)-(13)"
_LONGEST = 20.0  # [s] of one run
_LOAD = 0.1  # of what the supply can hold
_SWINGS = 4


def closed_form_checks(subject: Subject) -> Iterator[ValidationCheck]:
    """Yield all checks that need no more than the parameters.

    Yields:
        One check after the other.
    """
    yield from _spool(subject)
    for sign in (1.0, -1.0):
        yield from _steady_motion(subject, sign)
    yield from _rest(subject)
    yield from _swing(subject)
    yield _oil(subject)


def _spool(subject: Subject) -> Iterator[ValidationCheck]:
    p = subject.parameters
    steps = subject.steps(2.0 / p.omega_0)
    time = steps * subject.dt
    setpoint = 0.5 * p.beta or 0.5 * p.alpha
    found = subject.plant().step(PlantInput(setpoint), steps)
    yield ValidationCheck(
        subject=subject.name,
        name=f"spool {time * 1e3:.3g} ms after a step of {setpoint * 1e3:.3g} mm",
        unit="m",
        source="step response of eq. (1): 1 - (s2 exp(s1 t) - s1 exp(s2 t)) / (s2 - s1)",
        expected=setpoint * _step_response(p.xi, p.omega_0 * time),
        found=found.nu,
        tolerance=1e-3 * setpoint,
    )
    if p.beta:
        settled = subject.plant().step(PlantInput(setpoint), subject.steps(20.0 / p.omega_0))
        yield ValidationCheck(
            subject=subject.name,
            name="speed with the spool inside the dead zone",
            unit="m/s",
            source="eq. (2): z = 0 for |nu| < beta; balanced chambers then stay at rest",
            expected=0.0,
            found=settled.v,
            tolerance=1e-9,
        )
    opened = subject.plant().step(PlantInput(2.0 * (p.alpha + p.beta)), subject.steps(0.02))
    yield ValidationCheck(
        subject=subject.name,
        name="orifice state at twice the full opening",
        unit="m",
        source="eq. (2): saturated at alpha",
        expected=p.alpha,
        found=opened.z,
        tolerance=1e-12,
    )


def _step_response(damping: float, angle: float) -> float:
    """Return the unit step response of a second-order lag at omega t."""
    if damping == 1.0:
        return 1.0 - (1.0 + angle) * math.exp(-angle)
    root = cmath.sqrt(damping**2 - 1.0)
    s1, s2 = -damping + root, -damping - root
    fading = (s2 * cmath.exp(s1 * angle) - s1 * cmath.exp(s2 * angle)) / (s2 - s1)
    return 1.0 - fading.real


def _steady_motion(subject: Subject, sign: float) -> Iterator[ValidationCheck]:
    """Yield speed, pressures and flow of a steady motion that the plant must find by itself."""
    p = subject.parameters
    opening = _OPENING * p.alpha
    speed = steady_speed(p, opening, sign)
    way = f"{'out' if sign > 0.0 else 'back'} at an opening of {opening * 1e3:.3g} mm"
    spool = sign * (opening + p.beta)
    time = min(2.0 * _REACH * p.h / speed, _LONGEST)
    reason = _unsteady(subject, spool, time)
    if reason:
        yield ValidationCheck(
            subject=subject.name, name=f"speed {way}", unit="m/s", source=_STEADY, detail=reason
        )
        return
    start = balanced_state(p, x=-sign * _REACH * p.h)._replace(v=0.8 * sign * speed, nu=spool)
    found = subject.plant(start).step(PlantInput(spool), subject.steps(time))
    P_A, P_B = steady_pressures(p, opening, sign * speed)
    flow = p.A_A * sign * speed
    for name, unit, source, expected, value, scale in (
        ("speed", "m/s", _STEADY, sign * speed, found.v, speed),
        ("P_A", "Pa", "eqs. (5), (6) at that speed", P_A, found.P_A, p.P_S),
        ("P_B", "Pa", "eqs. (5), (6) at that speed", P_B, found.P_B, p.P_S),
        ("Q_A", "m³/s", "eq. (8) at constant pressure: A_A v", flow, found.Q_A, abs(flow)),
    ):
        yield ValidationCheck(
            subject=subject.name,
            name=f"{name} {way}",
            unit=unit,
            source=source,
            expected=expected,
            found=value,
            tolerance=1e-4 * scale,
        )


def _unsteady(subject: Subject, spool: float, time: float) -> str:
    """Return why a motion does not settle in a time [s]; empty where it does."""
    p = subject.parameters
    try:
        point = find_operating_point(p, spool_position=spool)
        poles = linearise_full(p, point).hydraulic_poles
    except ParameterError as error:
        return str(error)
    slowest = -float(poles.real.max())
    if slowest <= 0.0:
        return "the friction curve falls there, so the motion is unstable (section IV-A)"
    if slowest * time < _TIME_CONSTANTS:
        return "the motion does not settle within the stroke"
    return ""


def _rest(subject: Subject) -> Iterator[ValidationCheck]:
    """Yield position and pressures of a closed cylinder under a load."""
    p = subject.parameters
    plant = subject.plant()
    pressures = plant.output.P_A, plant.output.P_B
    load = -_LOAD * p.P_S * min(p.A_A, p.A_B)  # pulls
    x = held_displacement(p, pressures, load)
    stiffness = p.E * (p.A_A**2 / p.V_A0 + p.A_B**2 / p.V_B0)
    damping = 400.0 * p.F_s + p.sigma  # slope of eq. (13) with tanh(400 v) at rest
    time = 30.0 * (damping / stiffness + p.m / damping)
    if time > _LONGEST:
        yield ValidationCheck(
            subject=subject.name,
            name="position of the closed cylinder under a load",
            unit="m",
            source="V exp(P / E) = const, eqs. (8)-(12)",
            detail=f"comes to rest after {time:.3g} s only",
        )
        return
    found = plant.step(PlantInput(0.0, load), subject.steps(time))
    P_A, P_B = closed_pressures(p, pressures, x)
    where = f"closed, under {load / 1e3:.3g} kN"
    for name, unit, expected, value, tolerance in (
        ("position", "m", x, found.x, 1e-4 * abs(x)),
        ("P_A", "Pa", P_A, found.P_A, 1e-4 * p.P_S),
        ("P_B", "Pa", P_B, found.P_B, 1e-4 * p.P_S),
    ):
        yield ValidationCheck(
            subject=subject.name,
            name=f"{name} at rest, {where}",
            unit=unit,
            source="closed chambers, V exp(P / E) = const, and P_A A_A - P_B A_B = F_L",
            expected=expected,
            found=value,
            tolerance=tolerance,
        )


def _swing(subject: Subject) -> Iterator[ValidationCheck]:
    """Yield eigenfrequency and damping of the piston on oil, with viscous friction alone."""
    p = subject.parameters
    stiffness = p.E * (p.A_A**2 / p.V_A0 + p.A_B**2 / p.V_B0)
    omega, zeta = math.sqrt(stiffness / p.m), p.sigma / (2.0 * math.sqrt(stiffness * p.m))
    source = "eqs. (8)-(12) linearised: m s² + sigma s + E (A_A² / V_A + A_B² / V_B)"
    names = (("eigenfrequency", "rad/s"), ("damping ratio", "-"))
    if not 0.005 < zeta < 0.4:
        for name, unit in names:
            yield ValidationCheck(
                subject=subject.name,
                name=f"{name} of the closed cylinder",
                unit=unit,
                source=source,
                detail=f"a damping ratio of {zeta:.3g} leaves no swings to measure",
            )
        return
    found = _measured_swing(subject.without_friction(), omega)
    for (name, unit), expected, value, share in zip(
        names, (omega, zeta), found, (1e-3, 1e-2), strict=True
    ):
        yield ValidationCheck(
            subject=subject.name,
            name=f"{name} of the closed cylinder, viscous friction alone",
            unit=unit,
            source=source,
            expected=expected,
            found=value,
            tolerance=share * expected,
        )


def _measured_swing(subject: Subject, omega: float) -> tuple[float, float]:
    """Return eigenfrequency [rad/s] and damping ratio of a free swing after a blow.

    By the crossings of zero and the largest speeds between them, a logarithmic decrement.
    """
    start = subject.plant().state._replace(v=1e-3)
    plant = subject.plant(start)
    steps = subject.steps((2 * _SWINGS + 2) * math.pi / omega)
    speeds = [1e-3, *(plant.step(PlantInput(0.0)).v for _ in range(steps))]
    crossings = [
        number + a / (a - b)
        for number, (a, b) in enumerate(pairwise(speeds))
        if (a > 0.0) is not (b > 0.0)
    ]
    if len(crossings) < 2 * _SWINGS:
        return math.nan, math.nan
    damped = math.pi / (subject.dt * (crossings[-1] - crossings[0]) / (len(crossings) - 1))
    peaks = [
        max(abs(speed) for speed in speeds[math.ceil(a) : math.ceil(b)])
        for a, b in pairwise(crossings)
    ]
    decrement = math.log(peaks[0] / peaks[-1]) / (len(peaks) - 1)  # over half a swing
    zeta = decrement / math.hypot(math.pi, decrement)
    return damped / math.sqrt(1.0 - zeta**2), zeta


def _oil(subject: Subject) -> ValidationCheck:
    """Return the balance of the oil of chamber A over a motion out and back."""
    p = subject.parameters
    plant = subject.plant()
    u = 0.7 * p.alpha + p.beta
    stretch = subject.steps(min(0.4 * p.h / steady_speed(p, 0.7 * p.alpha, 1.0), 1.0))
    before = plant.output
    through = stored = displaced = 0.0
    for setpoint in (u, 0.0, -u, 0.0):
        for _ in range(stretch):
            after = plant.step(PlantInput(setpoint))
            through += 0.5 * (before.Q_A + after.Q_A) * subject.dt
            volume = p.V_A0 + p.A_A * 0.5 * (before.x + after.x)
            stored += volume / p.E * (after.P_A - before.P_A)
            displaced += p.A_A * abs(after.x - before.x)
            before = after
    swept = p.A_A * (before.x - subject.plant().output.x)
    return ValidationCheck(
        subject=subject.name,
        name="oil of chamber A that is lost or made, of the oil displaced out and back",
        unit="-",
        source="eq. (8) integrated: port A gives A_A dx + integral of (V_A / E) dP_A",
        expected=0.0,
        found=(through - swept - stored) / displaced,
        tolerance=1e-5,
    )
