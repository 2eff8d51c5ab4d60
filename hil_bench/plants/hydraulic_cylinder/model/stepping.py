"""Common parts of both models of the plant: solvers, step sizes and their checks."""

import math
from enum import StrEnum
from typing import Protocol

from hil_bench.errors import ParameterError
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
