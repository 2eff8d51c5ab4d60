"""The hydraulic motor as a plant of a bench."""

from collections.abc import Mapping, Sequence

from hil_bench.plants.hydraulic_cylinder.cylinder import FullOrderCylinder, seen_besides
from hil_bench.plants.hydraulic_cylinder.model.state import balanced_state
from hil_bench.plants.hydraulic_cylinder.quantities import P_A, P_B, P_S, SPOOL_POSITION
from hil_bench.plants.rotary.configuration import RotaryConfig
from hil_bench.plants.rotary.quantities import ANGLE, LOAD, SPEED

MotorOutput = tuple[float, ...]
"""angle [rad], speed [rad/s], P_A, P_B [Pa], spool position [m], torque [N m], Q_A, Q_B [m³/s].

With lines, the pressures at the valve's ends come last [Pa].
"""

_FASTEST = 1e5
"""Whatever is asked for, the shaft is not set to more than this [rad/s]."""


class HydraulicMotor:
    """The motor, moved on by the full-order model of the cylinder that it is to the equations.

    Args:
        axis: its record.
        dt: step [s].
        start: quantities to begin with [SI]; what is missing is as at rest.

    Attributes:
        model: the cylinder that it is to the equations.
    """

    def __init__(self, axis: RotaryConfig, dt: float, start: Mapping[str, float]) -> None:
        self._lever, self._displacement = axis.lever, axis.displacement
        cylinder = axis.cylinder
        parameters, options = cylinder.parameters, cylinder.options
        load = options.load_at(0.0)
        # Both pressures stay above that of the tank, however large the load that is held.
        mean = max(
            0.5 * (parameters.P_S + parameters.P_T),
            parameters.P_T + 0.5 * abs(load) / parameters.mean_area,
        )
        angle = start.get(ANGLE.name, axis.angle)
        state = balanced_state(parameters, x=angle * self._lever, mean_pressure=mean, F_L=load)
        self.model = FullOrderCylinder(
            parameters, options=options, solver=cylinder.solver, dt=dt, state=state
        )
        self._has_own_unit = cylinder.has_own_unit
        self._output = self._see(self.model.output)
        if start:
            self.go_to(start)

    @property
    def output(self) -> MotorOutput:
        """The present outputs in SI."""
        return self._output

    def drive(self, command: float, steps: int) -> MotorOutput:
        """Move the motor on under a spool set-point [m]."""
        self._output = self._see(self.model.drive(command, steps))
        return self._output

    def go_to(self, values: Mapping[str, float]) -> None:
        """Go on from other values, above the cavitation floor."""
        r, model = self._lever, self.model
        x = values[ANGLE.name] * r if ANGLE.name in values else model.state.x
        model.go_to({name: values[name] for name in (P_A, P_B) if name in values})
        if self._has_own_unit and P_S in values:
            model.supply_pressure = max(values[P_S], model.parameters.P_T)
        state = model.state._replace(x=x)
        if SPEED.name in values:
            state = state._replace(v=min(max(values[SPEED.name], -_FASTEST), _FASTEST) * r)
        if SPOOL_POSITION.name in values:
            state = state._replace(nu=values[SPOOL_POSITION.name])
        model.restart(state)
        self._output = self._see(model.output)

    def influence(self, name: str, value: float | None) -> None:
        """Set the load [N m], P_S [Pa] or a defect; the load is a force at the lever."""
        if name == LOAD and value is not None:
            value /= self._lever
        self.model.influence(name, value)

    def _see(self, seen: Sequence[float]) -> MotorOutput:
        x, v, pressure_a, pressure_b, nu, _, flow_a, flow_b = seen
        r = self._lever
        torque = (pressure_a - pressure_b) * self._displacement
        output = x / r, v / r, pressure_a, pressure_b, nu, torque, flow_a, flow_b
        return (*output, *seen_besides(self.model, has_own_unit=self._has_own_unit))
