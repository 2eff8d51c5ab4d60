"""The full-order model of the valve-controlled cylinder, Ruderman 2017 eqs. (1)-(13)."""

from collections.abc import Callable, Sequence
from functools import partial
from inspect import unwrap
from types import NoneType
from typing import NoReturn

from hil_bench.plants.hydraulic_cylinder.model.checks import (
    check_components,
    check_extension,
    check_full_model,
    check_lines,
    check_state,
)
from hil_bench.plants.hydraulic_cylinder.model.constants import (
    LINE_COMPLIANCE,
    ORIFICE_P_S,
    PUMP_FLOW,
    RELIEF_GRADIENT,
    RELIEF_PRESSURE,
    ExtensionState,
    edge_constants,
    pack,
    pack_extended,
)
from hil_bench.plants.hydraulic_cylinder.model.defects import Defects, pack_defective
from hil_bench.plants.hydraulic_cylinder.model.extended_midpoint import advance_extended_midpoint
from hil_bench.plants.hydraulic_cylinder.model.forward_euler import advance_forward_euler
from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import advance_implicit_midpoint
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, ready
from hil_bench.plants.hydraulic_cylinder.model.lined_midpoint import (
    advance_lined_midpoint,
    see_lined_supply,
)
from hil_bench.plants.hydraulic_cylinder.model.moving import Advance, bind_advance, make_plant_row
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import (
    PlantParameters,
    largest_midpoint_step,
)
from hil_bench.plants.hydraulic_cylinder.model.runge_kutta import advance_runge_kutta
from hil_bench.plants.hydraulic_cylinder.model.state import (
    EXTRA,
    INNER,
    LINES,
    PLAIN_EXTRA,
    STEPS,
    SUPPLY,
    PlantInput,
    PlantOutput,
    PlantState,
    Seen,
    balanced_state,
    see_supply,
)
from hil_bench.plants.hydraulic_cylinder.model.stepping import (
    DEFAULT_STEP,
    Solver,
    bound_input,
    check_solver,
    check_step,
    divergence,
)
from hil_bench.plants.hydraulic_cylinder.model.supply import (
    AS_GIVEN,
    OilNow,
    sensed_pressure,
    warmed,
)
from hil_bench.plants.hydraulic_cylinder.model.validation import require_kind, require_not_negative
from hil_bench.plants.hydraulic_cylinder.model.waves import (
    CAVITY,
    QUEUE,
    SHOWN,
    WAS_VALVE,
    require_waves,
)

_ADVANCE = {
    (Solver.FORWARD_EULER, True): advance_forward_euler,
    (Solver.LINEARLY_IMPLICIT_MIDPOINT, False): advance_implicit_midpoint,
    (Solver.LINEARLY_IMPLICIT_MIDPOINT, True): advance_extended_midpoint,
    (Solver.RUNGE_KUTTA, True): advance_runge_kutta,
}

# From Python, a compiled kernel with its tuples costs more than this one, and wants Numba.
_sensed_pressure: Callable[..., float] = unwrap(sensed_pressure)

_Z_F = 9  # its place in the state of an extended plant

_make_output: Callable[[Sequence[float]], PlantOutput] = partial(tuple.__new__, PlantOutput)
"""As `PlantOutput._make`, but quicker."""


class FullOrderPlant:
    """Valve and cylinder: six states, moved on in fixed steps.

    The constructor runs the stepping kernel once, so that nothing is compiled later.

    Args:
        parameters: of valve and cylinder.
        options: what the paper leaves open; None for `PlantOptions.bench()`.
        solver: of the equations.
        dt: step [s].
        state: at the start; None for the balanced state of rest at mid-stroke.
        extension: states of the options' extensions at the start; None for time 0, straight
            bristles and the P_S of the parameters.

    Raises:
        ParameterError: for a state or a step that makes no sense with these parameters.

    Attributes:
        parameters: of valve and cylinder.
        options: what the paper leaves open.
        solver: of the equations.
        dt: step [s].
        is_extended: whether it runs the kernels with extensions.
        seen: the output of the present state, as the kernels give it.
    """

    seen: Sequence[float]

    def __init__(
        self,
        parameters: PlantParameters,
        *,
        options: PlantOptions | None = None,
        solver: Solver = Solver.LINEARLY_IMPLICIT_MIDPOINT,
        dt: float = DEFAULT_STEP,
        state: PlantState | None = None,
        extension: ExtensionState | None = None,
    ) -> None:
        require_kind("parameters", parameters, PlantParameters)
        require_kind("options", options, PlantOptions, NoneType)
        self.parameters = parameters
        self.options = PlantOptions.bench() if options is None else options
        self.solver = solver = check_solver(solver)
        self.dt = dt
        check_full_model(parameters, self.options)
        check_components(self.options, solver)
        check_lines(parameters, self.options, dt)
        check_step(dt, largest_step(parameters, self.options, solver), self.options, solver)
        t, z_f, P_S, *inner, waves = check_extension(extension, parameters, self.options)
        F_L = self.options.load_at(0.0, t)
        start = balanced_state(parameters, F_L=F_L) if state is None else state
        check_state(start, parameters, self.options)
        # Only the bench's solver has a second kernel, shorter by what no extension needs.
        is_midpoint = solver is Solver.LINEARLY_IMPLICIT_MIDPOINT
        self.is_extended = is_extended = self.options.is_extended or not is_midpoint
        self._kernel: Advance = (
            advance_lined_midpoint if self.options.has_lines else _ADVANCE[solver, is_extended]
        )
        self._defects = Defects()
        self._oil = AS_GIVEN
        self._leave: Callable[[], None] | None = None
        self._constants = make_plant_row(
            (pack_extended if is_extended else pack)(parameters, self.options, dt)
        )
        lines = self._lines_at_start(start, waves)
        self._state = make_plant_row(
            (*start, t / dt, z_f, P_S, 0.0, 0.0, *inner, *lines) if is_extended else (*start, 0.0)
        )
        self._bind()
        self._move(0.0, 0.0, 0)

    @property
    def state(self) -> PlantState:
        """The present state."""
        row = self._state
        return PlantState(*(float(row[place]) for place in range(len(PlantState._fields))))

    @property
    def extension(self) -> ExtensionState:
        """The present states of the extensions; without any, those of the start."""
        row = self._state
        if not self.is_extended:
            return ExtensionState(0.0, 0.0, self.parameters.P_S)
        Y_A, Y_B, Q_P, *waves = (float(row[place]) for place in range(INNER, len(row)))
        t, z_f, P_S = float(row[STEPS]) * self.dt, float(row[_Z_F]), float(row[SUPPLY])
        return ExtensionState(t, z_f, P_S, Y_A, Y_B, Q_P, tuple(waves))

    @property
    def valve_pressures(self) -> tuple[float, float]:
        """Pressures at the valve's ports A and B [Pa]; without a line that of the chamber."""
        options, seen = self.options, self.output
        at = LINES + SHOWN
        return (
            seen.P_A if options.line_a is None else float(self._state[at]),
            seen.P_B if options.line_b is None else float(self._state[at + 1]),
        )

    @property
    def drawn(self) -> tuple[float, float]:
        """Flow from the plant's supply unit now [m³/s], and the drop over its filter [Pa]."""
        see = see_lined_supply if self.options.has_lines else see_supply
        return ready(see)(self._state, self._constants)

    @property
    def output(self) -> PlantOutput:
        """The quantities of the present state."""
        return _make_output(self.seen)

    @property
    def extra_evaluations(self) -> int:
        """Evaluations beyond one a step so far; 0 for the solvers with a fixed step."""
        return int(self._state[EXTRA if self.is_extended else PLAIN_EXTRA])

    @property
    def supply_pressure(self) -> float:
        """P_S at the valve now [Pa]."""
        return float(self._state[SUPPLY] if self.is_extended else self._constants[ORIFICE_P_S])

    @supply_pressure.setter
    def supply_pressure(self, pressure: float) -> None:
        require_not_negative("supply_pressure", pressure, "Pa")
        if self.is_extended:
            self._state[SUPPLY] = pressure
        else:
            self._constants[ORIFICE_P_S] = pressure

    def feed(self, pressure: float, flow: float) -> None:
        """Let the plant's supply unit go on from a pressure [Pa] with a flow of its pump [m³/s]."""
        self._state[SUPPLY] = pressure
        self._constants[PUMP_FLOW] = flow

    def lend(self, line: float, opens_at: float, gradient: float) -> None:
        """Let line and relief valve of the plant's supply unit be others.

        Args:
            line: compliance of the line [m³/Pa].
            opens_at: setting of the relief valve [Pa].
            gradient: its flow per pressure above that [m³/(s Pa)].
        """
        self._constants[LINE_COMPLIANCE] = line
        self._constants[RELIEF_PRESSURE] = opens_at
        self._constants[RELIEF_GRADIENT] = gradient

    @property
    def time(self) -> float:
        """That of the load series, of a plant that is extended [s]."""
        return float(self._state[STEPS]) * self.dt

    @property
    def sensed_pressure(self) -> float:
        """Pressure that the plant shows to a load-sensing pump [Pa]."""
        edges = edge_constants(self.parameters, self.options)
        return _sensed_pressure(self.seen[4], self.valve_pressures, self.parameters.P_T, edges)

    @property
    def defects(self) -> Defects:
        """The defects; an assigned value holds until the next one."""
        return self._defects

    @defects.setter
    def defects(self, defects: Defects) -> None:
        if defects == self._defects:
            return
        P_S = self.supply_pressure
        if defects.needs_extension:
            self._extend()
        self._defects = defects
        self._pack(P_S)

    def warm(self, oil: OilNow) -> None:
        """Go on with warmer or colder oil."""
        self._oil = oil
        self._pack(self.supply_pressure)

    @property
    def modulus(self) -> float:
        """Bulk modulus of the oil in the chambers now, without air [Pa]."""
        return self.parameters.E if self._oil is AS_GIVEN else self._oil.modulus(self.parameters.E)

    def _pack(self, P_S: float) -> None:
        """Take defects and oil into the constants, and go on from P_S [Pa]."""
        parameters, options = warmed(self.parameters, self.options, self._oil)
        constants = pack_defective(
            parameters, options, self.dt, self._defects, is_extended=self.is_extended
        )
        if self.is_extended:
            self._constants = make_plant_row(constants)
            self._state[SUPPLY] = P_S
            self._bind()
            return
        for place, value in enumerate(constants):  # in place: a group may hold the row
            self._constants[place] = value
        self._constants[ORIFICE_P_S] = P_S

    def move_rows(self, state: Floats, constants: Floats, leave: Callable[[], None]) -> None:
        """Keep states and constants elsewhere from now on, where others may move them on.

        Args:
            state: takes the states of a plant that is not extended.
            constants: takes its constants.
            leave: called once, when a defect has extended the plant and it has left both.
        """
        for row, values in ((state, self._state), (constants, self._constants)):
            for place in range(len(values)):
                row[place] = values[place]
        self._state, self._constants, self._leave = state, constants, leave
        self._bind()

    def _extend(self) -> None:
        """Go on with the extended kernels, which give the same while nothing is extended."""
        if self.is_extended:
            return
        P_S, states = self.supply_pressure, self.state
        extra = float(self._state[PLAIN_EXTRA])
        self._state = make_plant_row((*states, 0.0, 0.0, P_S, 0.0, extra, 0.0, 0.0, 0.0))
        self._kernel = _ADVANCE[self.solver, True]
        self.is_extended = True
        if self._leave is not None:
            self._leave()
            self._leave = None

    def restart(self, state: PlantState) -> None:
        """Go on from another state; what the extensions hold stays."""
        check_state(state, self.parameters, self.options)
        for number, value in enumerate(state):
            self._state[number] = value
        self._move(state.nu, 0.0, 0)

    def step(self, plant_input: PlantInput, steps: int = 1) -> PlantOutput:
        """Move the plant on by `steps` steps under a constant input; return what is seen then.

        Inputs of any finite size are taken: beyond `SPOOL_SETPOINT_LIMIT` and `LOAD_LIMIT` of
        `model.stepping` they act as the limit does.

        An input that is not finite, a number of steps that is no count and a solver that has
        diverged are refused.
        """
        u, F_L = bound_input(plant_input, steps)
        return _make_output(self._move(u, F_L, steps))

    def _lines_at_start(self, start: PlantState, waves: tuple[float, ...]) -> Sequence[float]:
        """Return the lines' part of the row of states, at rest where nothing else is given."""
        lines = (self.options.line_a, self.options.line_b)
        if not self.options.has_lines:
            return ()
        sizes = [0 if line is None else line.steps(self.parameters.rho, self.dt) for line in lines]
        if waves:
            require_waves(waves, QUEUE + 2 * sum(sizes))
            return waves
        valve, P_T = self.options.counterbalance, self.parameters.P_T
        # Behind a counterbalance valve nothing holds a pressure.
        A = P_T if valve is not None and valve.in_line_a else start.P_A
        B = P_T if valve is not None and valve.in_line_b else start.P_B
        queues = (A,) * (2 * sizes[0]) + (B,) * (2 * sizes[1])
        rest = (0.0,) * (WAS_VALVE - CAVITY)
        return 0.0, 0.0, A, B, *rest, A, B, A, B, A, B, *queues

    def _move(self, u: float, F_L: float, steps: int) -> Seen:
        try:
            self.seen = seen = self._advance(u, F_L, steps)
        except FloatingPointError:
            self._refuse_divergence()
        return seen

    def _refuse_divergence(self) -> NoReturn:
        raise divergence(self.dt, self.solver) from None

    def _bind(self) -> None:
        """Have the kernel move on the rows as they are now."""
        self._advance = bind_advance(self._kernel, self._state, self._constants)


def largest_step(parameters: PlantParameters, options: PlantOptions, solver: Solver) -> float:
    """Return the largest step that a solver can take over the operating range [s].

    That is where forward Euler and Runge-Kutta are stable, 0 where forward Euler is at no step; and
    where the linearly implicit midpoint rule, stable at every step, follows the piston's swing.
    """
    if solver is Solver.LINEARLY_IMPLICIT_MIDPOINT:
        return largest_midpoint_step(parameters, options)
    from hil_bench.plants.hydraulic_cylinder.model import stability  # noqa: PLC0415 - wants NumPy

    if solver is Solver.FORWARD_EULER:
        return stability.largest_euler_step(parameters, options)
    return stability.largest_runge_kutta_step(parameters, options)
