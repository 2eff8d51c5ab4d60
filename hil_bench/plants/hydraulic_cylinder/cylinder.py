"""The paper's two models as plants of a bench."""

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, TypeGuard, cast

from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.model import FullOrderPlant, PlantInput, PlantState
from hil_bench.plants.hydraulic_cylinder.model.constants import ROW
from hil_bench.plants.hydraulic_cylinder.model.models import Model
from hil_bench.plants.hydraulic_cylinder.model.moving import (
    bind_group,
    is_machine_code,
    make_plant_row,
    piece_of,
)
from hil_bench.plants.hydraulic_cylinder.model.reduced_order import (
    ReducedOrderPlant,
    balanced_reduced_state,
)
from hil_bench.plants.hydraulic_cylinder.model.side_by_side import (
    ALL_MOVED,
    BLOCK,
    NONE_MOVED,
    SEEN,
    STATE,
    move_group,
)
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import state_of_rest
from hil_bench.plants.hydraulic_cylinder.model.stepping import (
    LOAD_LIMIT,
    SPOOL_SETPOINT_LIMIT,
    PlantModel,
)
from hil_bench.plants.hydraulic_cylinder.quantities import (
    LOAD,
    P_A,
    P_B,
    P_S,
    POSITION,
    SPEED,
    SPOOL_POSITION,
)
from hil_bench.plants.plant import SUPPLY, Plant

_FASTEST = 10.0
"""Whatever is asked for, the piston is not set to more than this [m/s] ..."""
_HIGHEST = 10.0
"""... nor a pressure to more than so many times that of the supply."""


class _Cylinder(PlantModel):
    """The bench's view of a plant, the same for both models.

    Attributes:
        load: what acts on the rod from outside [N].
    """

    load = 0.0

    def drive(self, command: float, steps: int) -> Sequence[float]:
        """Move the plant on under a spool set-point [m]."""
        return self.step(PlantInput(command, self.load), steps)

    def go_to(self, values: Mapping[str, float]) -> None:
        """Go on from other values, within the stroke and above the cavitation floor."""
        parameters, state, floor = self.parameters, self.state, self.options.cavitation_floor
        lowest, highest = -math.inf if floor is None else floor, _HIGHEST * parameters.P_S
        pressure_a = _within(lowest, values.get(P_A, state.P_A), highest)
        pressure_b = _within(lowest, values.get(P_B, state.P_B), highest)
        half = parameters.h
        self.restart(
            state._replace(
                x=_within(-half, values.get(POSITION.name, state.x), half),
                v=_within(-_FASTEST, values.get(SPEED.name, state.v), _FASTEST),
                P_A=pressure_a,
                P_B=pressure_b,
                nu=values.get(SPOOL_POSITION.name, state.nu),
                V_CA=state.V_CA if floor == pressure_a else 0.0,
                V_CB=state.V_CB if floor == pressure_b else 0.0,
            )
        )

    def influence(self, name: str, value: float | None) -> None:
        """Set the load [N] or P_S [Pa]; let go, a constant P_S is what it was, a unit fills up."""
        if name == LOAD:
            self.load = 0.0 if value is None else value
        elif name != SUPPLY:
            self._wear(name, 0.0 if value is None else value)
        elif value is not None:
            self.supply_pressure = value
        elif self.options.supply is None:
            self.supply_pressure = self.parameters.P_S

    def _wear(self, name: str, amount: float) -> None:
        """Set a defect; a model that can have none is not asked for any."""


class FullOrderCylinder(FullOrderPlant, _Cylinder):
    """The full-order model on a bench."""

    @property
    def model(self) -> "FullOrderCylinder":
        """The model that solves the equations: itself."""
        return self

    def drive(self, command: float, steps: int) -> Sequence[float]:
        """Move the plant on as `step` does, but ask less of an input that is within the limits."""
        load = self.load
        is_within = (
            -SPOOL_SETPOINT_LIMIT <= command <= SPOOL_SETPOINT_LIMIT
            and -LOAD_LIMIT <= load <= LOAD_LIMIT
        )
        if is_within and type(command) is float and type(load) is float:
            try:
                self.seen = seen = self._advance(command, load, steps)
            except FloatingPointError:
                self._refuse_divergence()
            return seen
        return self.step(PlantInput(command, load), steps)

    def _wear(self, name: str, amount: float) -> None:
        self.defects = replace(self.defects, **{name: amount})


def seen_besides(model: FullOrderPlant, *, has_own_unit: bool) -> tuple[float, ...]:
    """Return the pressures at the valve's ends of lines [Pa], and what its own unit shows.

    That is P_S [Pa], the flow drawn from it [m³/s] and the drop over its filter [Pa].
    """
    options = model.options
    seen = _at_valve(model) if options.has_lines else ()
    if not has_own_unit or options.supply is None:
        return seen
    drawn, drop = model.drawn
    seen = (*seen, model.supply_pressure, drawn)
    return seen if options.supply.filter is None else (*seen, drop)


def _at_valve(model: FullOrderPlant) -> tuple[float, ...]:
    at_a, at_b = model.valve_pressures
    options = model.options
    if options.line_a is not None and options.line_b is not None:
        return at_a, at_b
    return (at_a if options.line_a is not None else at_b,)


class ExtendedCylinder:
    """The full-order model with lines or a supply unit, of which it shows more.

    Args:
        model: it.
        has_own_unit: whether its supply unit is its own.

    Attributes:
        model: as passed in.
    """

    def __init__(self, model: FullOrderCylinder, *, has_own_unit: bool) -> None:
        self.model = model
        self._has_own_unit = has_own_unit

    @property
    def output(self) -> Sequence[float]:
        """The model's output, and what `seen_besides` returns."""
        return self._see(self.model.output)

    def drive(self, command: float, steps: int) -> Sequence[float]:
        """Move the model on under a spool set-point [m]."""
        return self._see(self.model.drive(command, steps))

    def go_to(self, values: Mapping[str, float]) -> None:
        """Go on from other values; the waves in the lines go on as they are."""
        self.model.go_to(values)
        if self._has_own_unit and P_S in values:
            self.model.supply_pressure = max(values[P_S], self.model.parameters.P_T)

    def influence(self, name: str, value: float | None) -> None:
        """Set what acts on the model."""
        self.model.influence(name, value)

    def _see(self, seen: Sequence[float]) -> Sequence[float]:
        return (*seen, *seen_besides(self.model, has_own_unit=self._has_own_unit))


class ReducedOrderCylinder(ReducedOrderPlant, _Cylinder):
    """The reduced model on a bench."""


def build_cylinder(
    axis: CylinderConfig, dt: float, start: Mapping[str, float] | None = None
) -> Plant:
    """Return the plant of an axis, at rest where no whole state is given to start with."""
    start = start or {}
    x = start.get(POSITION.name, axis.position)
    parameters, options = axis.parameters, axis.options
    if axis.model is Model.REDUCED:
        return ReducedOrderCylinder(
            parameters,
            options=options,
            solver=axis.solver,
            dt=dt,
            state=balanced_reduced_state(parameters, x=x, F_L=options.load_at(x)),
            delay=axis.spool_delay,
        )
    state = state_of_rest(parameters, options, x)
    names = (POSITION.name, SPEED.name, P_A, P_B, SPOOL_POSITION.name)
    if start.keys() >= set(names):
        position, speed, pressure_a, pressure_b, spool = (start[name] for name in names)
        state = PlantState(position, speed, pressure_a, pressure_b, spool, 0.0)
    model = FullOrderCylinder(parameters, options=options, solver=axis.solver, dt=dt, state=state)
    if not (options.has_lines or axis.has_own_unit):
        return model
    return ExtendedCylinder(model, has_own_unit=axis.has_own_unit)


def _within(low: float, value: float, high: float) -> float:
    return min(max(value, low), high)


# Cylinders of a bench that one call moves on.


FEWEST: Final = 3
"""Cylinders for which a call for all is cheaper than one for each."""


class CylinderGroup:
    """Cylinders on one bench: those without extensions move side by side, the others one by one.

    Args:
        cylinders: of the bench, in the order of the axes.
    """

    def __init__(self, cylinders: Sequence[Plant]) -> None:
        self._cylinders = tuple(cylinders)
        self._arrange()

    def drive(self, commands: Sequence[float], steps: int) -> Sequence[Sequence[float]]:
        """Move the cylinders on, each under its spool set-point [m]."""
        if not self._single:
            return self._side_by_side.drive(commands, steps)
        outputs: list[Sequence[float]] = [()] * len(commands)
        given = [commands[place] for place in self._joined]
        moved = self._side_by_side.drive(given, steps)
        for place, output in zip(self._joined, moved, strict=True):
            outputs[place] = output
        for place in self._single:
            outputs[place] = self._cylinders[place].drive(commands[place], steps)
        return outputs

    def _arrange(self) -> None:
        """Find which cylinders can move side by side; again when one of them can no longer."""
        plain = [cylinder for cylinder in self._cylinders if is_plain(cylinder)]
        if len(plain) < FEWEST:
            plain = []
        self._joined = [n for n, each in enumerate(self._cylinders) if each in plain]
        self._single = [n for n, each in enumerate(self._cylinders) if each not in plain]
        self._side_by_side = SideBySide(plain, self._arrange)


class SideBySide:
    """Cylinders without extensions whose rows lie one behind another.

    Args:
        cylinders: they keep their states and constants there from now on.
        leave: called when one of them no longer does.
    """

    def __init__(self, cylinders: Sequence[FullOrderCylinder], leave: Callable[[], None]) -> None:
        self._cylinders = tuple(cylinders)
        count = self._count = len(cylinders)
        rows = max(count, 1)  # no memory has a shape without rows
        commands, states, constants, seen, block = (
            make_plant_row([0.0] * size)
            for size in (2 * count, count * STATE, count * ROW, rows * SEEN, BLOCK)
        )
        self._commands = memoryview(cast("Any", commands))
        self._write = struct.Struct(f"={2 * count}d").pack_into
        self._seen = memoryview(cast("Any", seen)).cast("B").cast("d", (rows, SEEN))
        for number, cylinder in enumerate(cylinders):
            state = piece_of(states, number * STATE, STATE)
            cylinder.move_rows(state, piece_of(constants, number * ROW, ROW), leave)
        self._move = bind_group(move_group, commands, states, constants, seen, block)
        self.drive([0.0] * count, 0)

    def drive(self, commands: Sequence[float], steps: int) -> Sequence[Sequence[float]]:
        """Move the cylinders on, each under its spool set-point [m].

        A command that is not finite and a solver that has diverged are refused.
        """
        cylinders = self._cylinders
        if not cylinders:
            return []
        self._write(self._commands, 0, *commands, *[cylinder.load for cylinder in cylinders])
        moved = self._move(self._count, steps)
        if moved == NONE_MOVED:
            return [
                cylinder.drive(command, steps)
                for cylinder, command in zip(cylinders, commands, strict=True)
            ]
        if moved != ALL_MOVED:
            cylinders[moved].drive(commands[moved], 0)  # which refuses its state
        outputs = cast("list[list[float]]", self._seen.tolist())  # of two dimensions
        for cylinder, seen in zip(cylinders, outputs, strict=True):
            cylinder.seen = seen
        return outputs


def is_plain(cylinder: Plant) -> TypeGuard[FullOrderCylinder]:
    """Return True if a plant is a cylinder that can move side by side with others."""
    return isinstance(cylinder, FullOrderCylinder) and not cylinder.is_extended


def group_cylinders(cylinders: Sequence[Plant]) -> CylinderGroup | None:
    """Return a group of cylinders; None where too few can move side by side."""
    if not is_machine_code() or sum(map(is_plain, cylinders)) < FEWEST:
        return None
    return CylinderGroup(cylinders)
