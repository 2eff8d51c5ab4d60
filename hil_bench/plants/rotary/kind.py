"""The hydraulic motor as a kind of plant."""

import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from hil_bench.config.settings import Range
from hil_bench.plants.hydraulic_cylinder.cylinder import FullOrderCylinder, seen_besides
from hil_bench.plants.hydraulic_cylinder.kind import VALVE_NODES, ValveControlled
from hil_bench.plants.hydraulic_cylinder.model.state import balanced_state
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import SteadyMotion, steady_motion
from hil_bench.plants.hydraulic_cylinder.picture import WIDTH, circuit_of
from hil_bench.plants.hydraulic_cylinder.quantities import P_A, P_B, P_S, SPOOL_POSITION
from hil_bench.plants.hydraulic_cylinder.resolution import (
    SAMPLES_PER_PERIOD,
    STEPS_PER_PERIOD,
    eigenfrequency,
)
from hil_bench.plants.hydraulic_cylinder.summary import (
    SWING,
    at_setting,
    burst_motion,
    damping_ratio,
    filter_facts,
    line_facts,
    verdict,
)
from hil_bench.plants.plant import Fact, Page, Quantity
from hil_bench.plants.rotary import configuration
from hil_bench.plants.rotary.configuration import (
    ANGLE,
    LOAD,
    QUANTITIES,
    ROTARY_KEYS,
    SPEED,
    RotaryConfig,
)
from hil_bench.units import BAR, LITRE_PER_MINUTE, REVOLUTION_PER_MINUTE

# The key figures of a motor: speeds, torques, pressures, frequencies, times.


_TURNS = Range(0.0, 10_000.0, "our choice: small axial pistons reach it")

USUAL_RESULTS: Final[Mapping[str, Range]] = {
    "top speed forwards": _TURNS,
    "top speed backwards": _TURNS,
    "eigenfrequency": SWING,
}
"""Ranges that machines reach, in the units of the facts."""


def find_unresolved(axis: RotaryConfig, tick_us: int, step_us: int) -> Iterator[str]:
    """Yield the oscillations that are too fast for the tick, or for the solver's step."""
    swing = eigenfrequency(axis.cylinder, 0.0)
    spool = axis.cylinder.parameters.omega_0 / (2.0 * math.pi)
    for what, frequency, period, key, needed in (
        ("the motor's eigenfrequency", swing, tick_us, "tick_us", SAMPLES_PER_PERIOD),
        ("the motor's eigenfrequency", swing, step_us, "step_us", STEPS_PER_PERIOD),
        ("the spool's natural frequency", spool, step_us, "step_us", STEPS_PER_PERIOD),
    ):
        samples = 1e6 / (frequency * period)
        if samples < needed:
            right = math.floor(1e6 / (frequency * needed))
            yield (
                f"{what} is {frequency:.3g} Hz, {samples:.2g} of {key} = {period} a period; "
                f"{right} us or less resolves it"
            )


def _motion_facts(axis: RotaryConfig) -> Iterator[Fact]:
    cylinder = axis.cylinder
    for word, forward in (("forwards", True), ("backwards", False)):
        motion = steady_motion(cylinder.parameters, cylinder.options, extends=forward)
        speed = REVOLUTION_PER_MINUTE.from_si(motion.speed / axis.lever)
        note = _note(motion) + at_setting(cylinder.options.supply)
        yield Fact(f"top speed {word}", speed, "rpm", note)
        flow = LITRE_PER_MINUTE.from_si(motion.supply_flow)
        yield Fact(f"  flow from the supply {word}", flow, "l/min", "without leakage")
        if (burst := burst_motion(cylinder, extends=forward)) is not None:
            speed = REVOLUTION_PER_MINUTE.from_si(burst.speed / axis.lever)
            yield Fact(f"  with the accumulator {word}", speed, "rpm", "until it is empty")
        yield Fact(f"  pressure A {word}", BAR.from_si(motion.P_A), "bar")
        yield Fact(f"  pressure B {word}", BAR.from_si(motion.P_B), "bar")


def _note(motion: SteadyMotion) -> str:
    if not motion.speed:
        return "the load holds the shaft"
    if motion.is_cavitating:
        return "the load runs ahead of the oil: a line cavitates"
    if motion.is_pump_limited:
        return "limited by the pump"
    return "valve wide open, with friction and load"


def _torque_facts(axis: RotaryConfig) -> Iterator[Fact]:
    p, options = axis.cylinder.parameters, axis.cylinder.options
    supply = p.P_S if options.supply is None else options.supply.relief_pressure
    ideal = (supply - p.P_T) * axis.displacement
    started = max(ideal - p.F_s * axis.lever, 0.0)
    note = "(P_S - P_T) D, without friction and leakage" + at_setting(options.supply)
    yield Fact("stall torque", ideal, "N m", note)
    yield Fact("  at the start", started, "N m", "less the friction at rest")
    load = options.load_at(0.0) * axis.lever
    if load:
        yield Fact("load at the start", load, "N m", "positive against positive rotation")


def _swing_facts(axis: RotaryConfig, tick_us: int, step_us: int) -> Iterator[Fact]:
    cylinder, r = axis.cylinder, axis.lever
    p = cylinder.parameters
    inertia = (p.m + cylinder.options.load_mass) * r * r
    swing = eigenfrequency(cylinder, 0.0)
    omega = 2.0 * math.pi * swing
    damping = damping_ratio(cylinder, 0.0)
    yield Fact("moving inertia", inertia, "kg m²", "motor and load")
    yield Fact("eigenfrequency", swing, "Hz", "D sqrt(E (1 / V_A + 1 / V_B) / J), valve closed")
    yield Fact("damping ratio", damping, "-", "by friction and leakage, valve closed")
    yield Fact("limit of a position controller", 2.0 * damping * omega, "1/s", "gain 2 D omega")
    if p.sigma:
        coast = 1e3 * inertia / (p.sigma * r * r)
        yield Fact("mechanical time constant", coast, "ms", "J / b: coasting without oil")
    speed = steady_motion(p, cylinder.options, extends=True).speed / r
    torque = (p.P_S - p.P_T) * axis.displacement
    yield Fact("time to top speed, at least", 1e3 * inertia * speed / torque, "ms", "J by torque")
    valve = p.omega_0 / (2.0 * math.pi)
    yield Fact("valve at -90 degrees", valve, "Hz", f"{valve / swing:.3g} times")
    ticks, steps = 1e6 / (swing * tick_us), 1e6 / (swing * step_us)
    yield Fact("ticks a swing", ticks, "-", verdict(swing, tick_us, SAMPLES_PER_PERIOD))
    yield Fact("steps a swing", steps, "-", verdict(swing, step_us, STEPS_PER_PERIOD))


# The hydraulic motor as a plant of a bench.

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


# The hydraulic motor as a kind of plant.

# The picture of a hydraulic motor: its symbol of ISO 1219, and the drum that it turns.

_SPOKES = "".join(
    f'<path class="spoke" d="M 0 0 L {44 * math.cos(turn):.1f} {44 * math.sin(turn):.1f}"/>'
    for turn in (math.radians(120 * number) for number in range(3))
)
_RADIUS = 34.0


def motor_page(axis: RotaryConfig) -> Page:
    """Return the picture of a motor with its circuit, and what is plotted first.

    Args:
        axis: its record.
    """
    top = circuit_of(axis.cylinder, axis.displacement, axis.displacement)
    plots = ("speed", "spool_setpoint", SPOOL_POSITION.name, "P_A", "P_B", P_S)
    turn = f"{ANGLE.name} 0 {2 * math.pi:.8f} 0 -360"
    hub = "translate(292 76)"
    svg = (
        f'<svg viewBox="0 0 {WIDTH:g} 150">'
        f'<path class="shaft" d="M {160 + _RADIUS:g} 76 H 292"/>'
        f'<g transform="{hub}"><circle class="mass" r="46"/><g data-turn="{turn}">{_SPOKES}'
        '<circle class="steel" r="7"/></g></g>'
        f'<path class="half" d="M {160 - _RADIUS:g} 76 a 34 34 0 0 1 68 0 z" '
        f'data-fill="P_B 0 {top.pressure:.6g}"/>'
        f'<path class="half" d="M {160 - _RADIUS:g} 76 a 34 34 0 0 0 68 0 z" '
        f'data-fill="P_A 0 {top.pressure:.6g}"/>'
        f'<circle class="barrel" cx="160" cy="76" r="{_RADIUS:g}"/>'
        '<path class="sign" d="M 160 110 l -8 -13 h 16 z M 160 42 l -8 13 h 16 z"/>'
        f'<circle class="port" data-port="A" cx="150" cy="{76 + 33:g}" r="2.5"/>'
        f'<circle class="port" data-port="B" cx="170" cy="{76 + 33:g}" r="2.5"/>'
        f'<text x="10" y="20" class="huge" data-text="{ANGLE.name}"/>'
        f'<text x="{WIDTH - 10:g}" y="20" class="right" data-text="speed"/>'
        f'<text x="{WIDTH - 10:g}" y="140" class="right" data-text="torque"/></svg>'
    )
    return Page(svg, plots, top)


class Rotary(ValveControlled[RotaryConfig]):
    """A valve-controlled hydraulic motor with an inertia and a load torque."""

    name = "rotary"
    keys = ROTARY_KEYS
    quantities: tuple[Quantity, ...] = QUANTITIES
    usual_results = USUAL_RESULTS
    default_nodes = MappingProxyType(
        {**VALVE_NODES, "encoder": {"profile": "rotary_encoder_406", "node_id": 4}}
    )

    configure = configuration.configure
    derive = staticmethod(configuration.apply_data_sheet)
    find_leftovers = staticmethod(configuration.find_leftovers)
    page = staticmethod(motor_page)
    find_doubts = staticmethod(find_unresolved)

    def summarise(self, axis: RotaryConfig, tick_us: int, step_us: int) -> Sequence[Fact]:
        """Return speeds, torques, pressures, frequencies and times of an axis."""
        own = None if axis.cylinder.is_fed else axis.cylinder.options.supply
        return [
            *_motion_facts(axis),
            *_torque_facts(axis),
            *filter_facts(own),
            *line_facts(axis.cylinder, step_us),
            *_swing_facts(axis, tick_us, step_us),
        ]

    def build(
        self, axis: RotaryConfig, dt: float, start: Mapping[str, float] | None = None
    ) -> HydraulicMotor:
        """Return the motor of an axis."""
        return HydraulicMotor(axis, dt, start or {})


ROTARY: Final = Rotary()
