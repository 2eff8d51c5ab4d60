"""The reduced model of the valve-controlled cylinder, Ruderman 2017 eqs. (13)-(17)."""

import math
from collections import deque
from types import NoneType

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model.checks import check_cavity, check_position
from hil_bench.plants.hydraulic_cylinder.model.constants import ORIFICE_P_S
from hil_bench.plants.hydraulic_cylinder.model.moving import bind_advance, make_plant_row
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import (
    PlantParameters,
    largest_reduced_midpoint_step,
)
from hil_bench.plants.hydraulic_cylinder.model.reduced_steps import (
    EXTRA,
    Motion,
    advance_reduced_euler,
    advance_reduced_midpoint,
    advance_reduced_runge_kutta,
    change_supply,
    pack_reduced,
)
from hil_bench.plants.hydraulic_cylinder.model.state import (
    PlantInput,
    PlantOutput,
    PlantState,
    require_finite_state,
)
from hil_bench.plants.hydraulic_cylinder.model.stepping import (
    DEFAULT_STEP,
    Solver,
    bound_input,
    check_solver,
    check_step,
    divergence,
)
from hil_bench.plants.hydraulic_cylinder.model.validation import (
    require_finite,
    require_kind,
    require_not_negative,
)

LONGEST_DELAY = 1.0
"""Longest delay in place of the spool's lag, hundreds of times a real one [s]."""

_ADVANCE = {
    Solver.FORWARD_EULER: advance_reduced_euler,
    Solver.LINEARLY_IMPLICIT_MIDPOINT: advance_reduced_midpoint,
    Solver.RUNGE_KUTTA: advance_reduced_runge_kutta,
}

_CAVITY = 3  # its place in the row of states


class ReducedOrderPlant:
    """Valve and cylinder without spool dynamics, with one load pressure P_L = P_A - P_B.

    Eq. (15) ties both pressures to it: P_A + P_B = P_S, and the tank is at 0. The spool is where
    its set-point is, or was `delay` ago. The constructor runs the stepping kernel once, so that
    nothing is compiled later.

    Args:
        parameters: of valve and cylinder; V_A0 and V_B0 count by their sum, A_A and A_B by their
            mean, omega_0 and xi not at all.
        options: what the paper leaves open; None for `PlantOptions.bench()`.
        solver: of the equations.
        dt: step [s].
        state: at the start, with P_A + P_B = P_S and the spool at rest; None for the balanced state
            at mid-stroke.
        delay: constant time in place of the spool's lag, section III [s]; `spool_delay` gives the
            equivalent one.

    Raises:
        ParameterError: for a state, a step, a delay or an option that this model cannot have.

    Attributes:
        parameters: of valve and cylinder.
        options: what the paper leaves open.
        solver: of the equations.
        dt: step [s].
        delay: of the spool [s].
    """

    def __init__(
        self,
        parameters: PlantParameters,
        *,
        options: PlantOptions | None = None,
        solver: Solver = Solver.LINEARLY_IMPLICIT_MIDPOINT,
        dt: float = DEFAULT_STEP,
        state: PlantState | None = None,
        delay: float = 0.0,
    ) -> None:
        require_kind("parameters", parameters, PlantParameters)
        require_kind("options", options, PlantOptions, NoneType)
        self.parameters = parameters
        self.options = PlantOptions.bench() if options is None else options
        self.solver = solver = check_solver(solver)
        self.dt = dt
        self.delay = delay
        check_reduced_model(parameters, self.options)
        check_step(dt, largest_reduced_step(parameters, self.options, solver), self.options, solver)
        check_delay(delay)
        F_L = self.options.load_at(0.0, 0.0)
        start = balanced_reduced_state(parameters, F_L=F_L) if state is None else state
        _check_state(start, parameters, self.options)
        self._constants = make_plant_row(pack_reduced(parameters, self.options, dt))
        self._state = make_plant_row((*_motion(start), 0.0, 0.0, 0.0))
        self._advance = bind_advance(_ADVANCE[solver], self._state, self._constants)
        self._nu = start.nu
        self._delay_steps = round(delay / dt)
        self._made = 0
        self._arriving: deque[tuple[int, float]] = deque()
        self._output = self._advance_by(self._nu, 0.0, 0)

    @property
    def state(self) -> PlantState:
        """The present state."""
        x, v, P_A, P_B = self._output[:4]
        cavity = float(self._state[_CAVITY])
        return PlantState(x, v, P_A, P_B, self._nu, 0.0, max(-cavity, 0.0), max(cavity, 0.0))

    @property
    def output(self) -> PlantOutput:
        """The quantities of the present state."""
        return self._output

    @property
    def extra_evaluations(self) -> int:
        """Evaluations beyond one a step so far; 0 for the solvers with a fixed step."""
        return int(self._state[EXTRA])

    @property
    def supply_pressure(self) -> float:
        """P_S at the valve now [Pa]."""
        return 2.0 * float(self._constants[ORIFICE_P_S])

    @supply_pressure.setter
    def supply_pressure(self, pressure: float) -> None:
        require_not_negative("supply_pressure", pressure, "Pa")
        change_supply(self._constants, pressure)

    def restart(self, state: PlantState) -> None:
        """Go on from another state: its x, v and P_A - P_B, eq. (15) does the rest."""
        require_kind("state", state, PlantState)
        P_S, floor = self.parameters.P_S, self.options.cavitation_floor
        P_L = state.P_A - state.P_B
        if floor is not None:
            P_L = math.copysign(min(abs(P_L), P_S - 2.0 * floor), P_L)
        balanced = state._replace(P_A=0.5 * (P_S + P_L), P_B=0.5 * (P_S - P_L), nu_dot=0.0)
        _check_state(balanced, self.parameters, self.options)
        for place, value in enumerate(_motion(balanced)):
            self._state[place] = value
        self._nu = state.nu
        self._output = self._advance_by(self._nu, 0.0, 0)

    def step(self, plant_input: PlantInput, steps: int = 1) -> PlantOutput:
        """Move the plant on, as `FullOrderPlant.step` does; return what is seen then."""
        u, F_L = bound_input(plant_input, steps)
        if self._delay_steps == 0:
            self._nu = u
            return self._advance_by(u, F_L, steps)
        self._schedule(u)
        end = self._made + steps
        while self._arriving and self._arriving[0][0] < end:
            when, arrived = self._arriving.popleft()
            self._advance_by(self._nu, F_L, when - self._made)
            self._nu = arrived
        return self._advance_by(self._nu, F_L, end - self._made)

    def _schedule(self, u: float) -> None:
        """Note a set-point that differs from the last one, to act after the delay."""
        last = self._arriving[-1][1] if self._arriving else self._nu
        if u != last:
            self._arriving.append((self._made + self._delay_steps, u))

    def _advance_by(self, nu: float, F_L: float, steps: int) -> PlantOutput:
        try:
            seen = self._advance(nu, F_L, steps)
        except FloatingPointError:
            raise divergence(self.dt, self.solver) from None
        self._made += steps
        self._output = PlantOutput._make(seen)
        return self._output


def spool_delay(parameters: PlantParameters) -> float:
    """Return the constant time [s] that stands for the spool's lag at low frequencies.

    The phase of eq. (1) falls by 2 xi / omega_0 per rad/s there, as that of a delay does.
    """
    return 2.0 * parameters.xi / parameters.omega_0


def balanced_reduced_state(
    parameters: PlantParameters, *, x: float = 0.0, F_L: float = 0.0
) -> PlantState:
    """Return the state of rest in which the load pressure holds the piston: P_L = F_L / mean area.

    Args:
        parameters: of the plant.
        x: piston position [m].
        F_L: external load [N].
    """
    require_finite("x", x, "m")
    require_finite("F_L", F_L, "N")
    P_L = F_L / parameters.mean_area
    P_S = parameters.P_S
    return PlantState(x=x, v=0.0, P_A=0.5 * (P_S + P_L), P_B=0.5 * (P_S - P_L), nu=0.0, nu_dot=0.0)


def largest_reduced_step(
    parameters: PlantParameters, options: PlantOptions, solver: Solver
) -> float:
    """Return the largest step that a solver can take with the reduced model [s].

    As `model.full_order.largest_step`.
    """
    if solver is Solver.LINEARLY_IMPLICIT_MIDPOINT:
        return largest_reduced_midpoint_step(parameters, options)
    from hil_bench.plants.hydraulic_cylinder.model import stability  # noqa: PLC0415 - wants NumPy

    modes = stability.find_reduced_modes(parameters, options)
    if solver is Solver.FORWARD_EULER:
        return stability.euler_limit(modes)
    return stability.runge_kutta_limit(modes)


def check_reduced_model(parameters: PlantParameters, options: PlantOptions) -> None:
    """Refuse what needs two chambers, a tank pressure or a further state.

    Raises:
        ParameterError: for the first of them; the message names the symbol.
    """
    if parameters.P_T != 0.0:
        raise ParameterError(
            f"P_T = {parameters.P_T:g} Pa: must be 0, for eqs. (14), (15) have no tank pressure",
            "P_T",
        )
    given = {
        "spool_speed": options.spool_speed is not None,
        "C_LA": bool(options.C_LA),
        "C_LB": bool(options.C_LB),
        "air_fraction": options.air is not None,
        "bristles": options.bristles is not None,
        "lands": options.lands is not None,
        "counterbalance": options.counterbalance is not None,
        "compensator_margin": options.compensator_margin is not None,
        "cushion": options.cushion_a is not None or options.cushion_b is not None,
        "lines": options.has_lines,
        "supply_unit": options.supply is not None,
    }
    for symbol, is_given in given.items():
        if is_given:
            raise ParameterError(
                f"the reduced model has no place for {symbol}: the full-order model is right",
                symbol,
            )


def check_delay(delay: float) -> None:
    """Refuse what is no delay of a spool.

    Raises:
        ParameterError: for a delay that is negative or above `LONGEST_DELAY`.
    """
    require_not_negative("delay", delay, "s")
    if delay > LONGEST_DELAY:
        raise ParameterError(f"delay = {delay:g} s: must be {LONGEST_DELAY:g} s or less", "delay")


def check_reduced_rest(parameters: PlantParameters, options: PlantOptions, x: float) -> None:
    """Refuse a load that the supply cannot hold, for both pressures add up to it, eq. (15).

    Args:
        parameters: of the plant.
        options: of the plant.
        x: piston position at the start [m].

    Raises:
        ParameterError: one of the pressures would be below the cavitation floor.
    """
    floor, load = options.cavitation_floor, options.load_at(x)
    if floor is None:
        return
    largest = (parameters.P_S - 2.0 * floor) * parameters.mean_area
    if abs(load) > largest:
        raise ParameterError(
            f"load at the start = {load:g} N: must be within {largest:g} N, which the supply can "
            "hold in the reduced model",
            "load_force",
        )


def _motion(state: PlantState) -> Motion:
    """Return the part of the state that the kernels move on."""
    return state.x, state.v, state.P_A - state.P_B, state.V_CB - state.V_CA


def _check_state(state: PlantState, parameters: PlantParameters, options: PlantOptions) -> None:
    require_kind("state", state, PlantState)
    require_finite_state(state)
    P_S = parameters.P_S
    if abs(state.P_A + state.P_B - P_S) > 1e-6 * P_S:
        raise ParameterError(
            f"P_A + P_B = {state.P_A + state.P_B:g} Pa: must be P_S = {P_S:g} Pa, eq. (15)"
        )
    if state.nu_dot != 0.0:
        raise ParameterError(f"nu_dot = {state.nu_dot:g} m/s: must be 0, for the spool has no lag")
    floor = options.cavitation_floor
    if floor is not None and min(state.P_A, state.P_B) < floor:
        raise ParameterError(
            f"P_A = {state.P_A:g} Pa, P_B = {state.P_B:g} Pa: "
            f"must be at least the cavitation floor, {floor:g} Pa"
        )
    for chamber, pressure, cavity in (
        ("A", state.P_A, state.V_CA),
        ("B", state.P_B, state.V_CB),
    ):
        check_cavity(chamber, cavity, parameters.total_volume, pressure, floor)
    check_position(state.x, parameters, options)
