"""Common parts of both models' steps: solvers, step sizes, and the friction curve over a step."""

import math
from enum import StrEnum
from typing import Protocol

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model.friction import FrictionConstants, linearise_friction
from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.state import PlantInput, PlantOutput, PlantState
from hil_bench.plants.hydraulic_cylinder.model.validation import (
    require_count,
    require_number,
    require_positive,
)

DEFAULT_STEP = 5e-5
"""Step of a plant for which none is given, and of a bench's [s]."""

SPOOL_SETPOINT_LIMIT = 1.0
"""Largest spool set-point that the plant follows, a thousand times a real valve's [m]."""

LOAD_LIMIT = 1e9
"""Largest external load that the plant feels, a hundred thousand tonnes [N]."""


class Solver(StrEnum):
    """The method that integrates the plant's equations over one step."""

    FORWARD_EULER = "forward-euler"
    LINEARLY_IMPLICIT_MIDPOINT = "linearly-implicit-midpoint"
    RUNGE_KUTTA = "runge-kutta"


class PlantModel(Protocol):
    """Valve and cylinder as a bench runs them, whichever model stands behind.

    Attributes:
        parameters: of valve and cylinder.
        options: what the paper leaves open.
        solver: of the equations.
        dt: step [s].
        supply_pressure: P_S at the valve now [Pa]; what is written holds until it is written again,
            or, with a supply unit, is where the unit goes on from.
    """

    parameters: PlantParameters
    options: PlantOptions
    solver: Solver
    dt: float
    supply_pressure: float

    @property
    def state(self) -> PlantState:
        """The present state."""

    @property
    def output(self) -> PlantOutput:
        """The quantities of the present state."""

    def restart(self, state: PlantState) -> None:
        """Go on from another state."""

    def step(self, plant_input: PlantInput, steps: int = 1) -> PlantOutput:
        """Move the plant on by `steps` steps under a constant input; return what is seen then."""


def bound_input(plant_input: PlantInput, steps: int) -> tuple[float, float]:
    """Return u [m] and F_L [N] no larger than `SPOOL_SETPOINT_LIMIT` and `LOAD_LIMIT`.

    Raises:
        ParameterError: for an input that is not finite, or no count of steps.
    """
    if type(steps) is not int or steps < 0:
        require_count("steps", steps)
    u, F_L = _read_input(plant_input)
    is_within = (
        -SPOOL_SETPOINT_LIMIT <= u <= SPOOL_SETPOINT_LIMIT and -LOAD_LIMIT <= F_L <= LOAD_LIMIT
    )
    if not is_within:
        if not (math.isfinite(u) and math.isfinite(F_L)):
            raise ParameterError(f"u = {u} m, F_L = {F_L} N: both must be finite")
        u = math.copysign(min(abs(u), SPOOL_SETPOINT_LIMIT), u)
        F_L = math.copysign(min(abs(F_L), LOAD_LIMIT), F_L)
    return float(u), float(F_L)


def _read_input(plant_input: PlantInput) -> tuple[float, float]:
    """Return u and F_L.

    Raises:
        ParameterError: one of them is no number, or there are not two.
    """
    try:
        u, F_L = plant_input
    except (TypeError, ValueError):
        raise ParameterError(f"plant_input = {plant_input!r}: must be PlantInput(u, F_L)") from None
    if type(u) is not float or type(F_L) is not float:
        for symbol, value, unit in (("u", u, "m"), ("F_L", F_L, "N")):
            require_number(symbol, value, unit)
    return u, F_L


def check_solver(solver: Solver) -> Solver:
    """Return a solver, which may be given by its value.

    Raises:
        ParameterError: it is none.
    """
    try:
        return Solver(solver)
    except ValueError:
        names = ", ".join(known.value for known in Solver)
        raise ParameterError(f"solver = {solver!r}: must be one of {names}") from None


def check_step(dt: float, limit: float, options: PlantOptions, solver: Solver) -> None:
    """Refuse a step that its solver cannot take.

    Args:
        dt: step [s].
        limit: largest step that the solver can take [s].
        options: of the model.
        solver: of the equations.

    Raises:
        ParameterError: the step is too long, or the solver needs a slope where there is none.
    """
    require_positive("dt", dt, "s")
    if dt > limit:
        raise ParameterError(
            f"dt = {dt:g} s: {solver.value} {shortcoming(solver)} with these parameters; "
            f"{_remedy(limit)} is right"
        )
    if solver is Solver.FORWARD_EULER:
        return
    if options.tanh_gain == math.inf and options.bristles is None:
        raise ParameterError(
            f"tanh_gain = inf s/m: {solver.value} needs a slope, a finite gain; "
            f"take {Solver.FORWARD_EULER.value} for the printed sign"
        )


def shortcoming(solver: Solver) -> str:
    """Describe the behaviour of a solver above its largest step."""
    if solver is Solver.LINEARLY_IMPLICIT_MIDPOINT:
        return "cannot follow the piston's swing on the oil"
    return "is unstable"


def divergence(dt: float, solver: Solver) -> ParameterError:
    """Return the error for a step that has left the finite numbers."""
    return ParameterError(
        f"dt = {dt:g} s: {solver.value} has diverged with these parameters; it needs a shorter step"
    )


def _remedy(limit: float) -> str:
    """Return the remedy for a step above `limit` [s]."""
    if limit == 0.0:
        return f"{Solver.LINEARLY_IMPLICIT_MIDPOINT.value}, for no step is short enough,"
    digit = 10.0 ** (math.floor(math.log10(limit)) - 2)
    return f"{math.floor(limit / digit) * digit:g} s or less"


# The friction curve over an implicit step: damped where it is stiff, followed where it bends.


Drag = tuple[float, float, float]
"""The friction curve at the start of a step: (secant, tangent, implicit share) [N s/m]."""

NO_DRAG: Drag = (math.inf, 0.0, 0.0)
"""In place of the friction curve where bristles hold the piston."""


@kernel
def implicit_share(secant: float, tangent: float, inertia: float) -> float:
    """Return the addition of a damping element to the inertia that it works on, in one step.

    tangent / 2 is the midpoint rule's share, secant that of a backward Euler step on the secant.
    Between them, secant² / (8 inertia) brings the step close to the exact solution of both
    dy/dt = -y and dy/dt = -sqrt(y), and keeps it from overshooting.

    Args:
        secant: flow / drop or force / velocity.
        tangent: d flow / d drop or d force / d velocity.
        inertia: V / (E dt) or m / dt, in the unit of the two.
    """
    share = 0.5 * tangent + 0.125 * secant * secant / inertia
    if share > secant:
        return secant
    least = -0.25 * inertia
    return least if share < least else share


@kernel
def linearise_drag(v: float, inertia: float, friction: FrictionConstants) -> Drag:
    """Return secant, tangent and implicit share of the friction curve, eq. (13) [N s/m].

    Args:
        v: piston velocity at the start of the step [m/s].
        inertia: m / dt [N s/m].
        friction: the constants.
    """
    secant, tangent = linearise_friction(v, friction)
    return secant, tangent, implicit_share(secant, tangent, inertia)


@kernel
def follow_friction(
    dv: float,
    v: float,
    resistance: float,
    drag: Drag,
    inertia: float,
    friction: FrictionConstants,
) -> tuple[float, float]:
    """Return the velocity change over the step along the friction curve, and what it is off by.

    The mean from v to v + dv is that of the cubic through both ends with their tangents; one Newton
    step brings dv there. Where the secant exceeds the inertia, a step is too long to follow the
    curve, and dv stays: so no piston turns round further than without this.

    The error is judged by what the tangents at both ends leave of the curve between them: by the
    part that a straight slope does not explain, and by the slope's own change.

    Args:
        dv: velocity change with the friction as linearised at the start of the step [m/s].
        v: piston velocity at the start of the step [m/s].
        resistance: force per velocity change of everything [N s/m].
        drag: the friction curve at the start of the step.
        inertia: m / dt [N s/m].
        friction: the constants.
    """
    secant, tangent, share = drag
    if secant > inertia:
        return dv, 0.25 * abs(dv) if secant < math.inf else 0.0
    end = v + dv
    secant_end, tangent_end = linearise_friction(end, friction)
    before, after = secant * v, secant_end * end
    bend = (tangent_end - tangent) * dv / 12.0
    excess = 0.5 * (before + after) - bend - before - share * dv
    slope = 0.5 * tangent_end if tangent_end > 0.0 else 0.0
    unexplained = 0.25 * abs(after - before - 0.5 * (tangent + tangent_end) * dv)
    error = (unexplained + abs(bend)) / resistance
    return dv - excess / (resistance - share + slope), error
