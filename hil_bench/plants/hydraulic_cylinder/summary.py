"""The key figures of an axis: speeds, forces, pressures, frequencies, energies.

`docs/data-sheets.md` has the formulas with their sources, and one machine by hand.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

from hil_bench.config.settings import Range
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.model.extensions import SupplyUnit
from hil_bench.plants.hydraulic_cylinder.model.models import Model
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.reduced_order import balanced_reduced_state
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import (
    SteadyMotion,
    state_of_rest,
    steady_motion,
)
from hil_bench.plants.hydraulic_cylinder.model.waves import line_drop
from hil_bench.plants.hydraulic_cylinder.resolution import eigenfrequency, line_frequency
from hil_bench.plants.plant import Fact
from hil_bench.units import BAR, LITRE_PER_MINUTE

_SPEED = "our choice: polyurethane seals take 0.5 m/s, servo-cylinders 5"
_ACCELERATION = "our choice: machines have some m/s², a hammer's piston 1000 g"
SWING: Final = Range(0.2, 1000.0, "our choice: cranes have 1 Hz, short test cylinders some hundred")

USUAL_RESULTS: Final[Mapping[str, Range]] = {
    "top speed extending": Range(0.0, 5000.0, _SPEED),
    "top speed retracting": Range(0.0, 5000.0, _SPEED),
    "largest acceleration": Range(0.0, 1e4, _ACCELERATION),
    "eigenfrequency, lowest": SWING,
}
"""What machines reach, in the units of the facts (decision 103)."""

_SWINGS = 1.0 / (2.0 * math.pi)
_ANY_FLOW = 1e3  # [m³/s]
_HALVINGS = 100  # more than a float has bits


def summarise(axis: CylinderConfig, tick_us: int, step_us: int) -> Sequence[Fact]:
    """Return the key figures of an axis that an engineer checks first.

    Args:
        axis: its record.
        tick_us: period of the loop [us].
        step_us: step of the solver [us].
    """
    return [
        *_motion_facts(axis),
        *_cushion_facts(axis),
        *_rest_facts(axis),
        *(() if axis.is_fed else filter_facts(axis.options.supply)),
        *line_facts(axis, step_us),
        *_swing_facts(axis, tick_us, step_us),
        *_impact_facts(axis),
    ]


def softest_position(parameters: PlantParameters) -> float:
    """Return the piston position with the lowest eigenfrequency [m].

    The derivative of A_A² / V_A + A_B² / V_B is 0 where V_A / V_B = (A_A / A_B)^1.5; an end of the
    stroke where that lies beyond it.
    """
    p = parameters
    ratio = (p.A_A / p.A_B) ** 1.5
    x = (ratio * p.V_B0 - p.V_A0) / (p.A_A + ratio * p.A_B)
    return float(min(max(x, -p.h), p.h))


def damping_ratio(axis: CylinderConfig, x: float) -> float:
    """Return the damping ratio of the piston on the oil with the valve closed.

    That of the oscillating pair among the eigenvalues of eqs. (8), (9) and (12), linearised in
    v, P_A and P_B with viscous friction and leakage; 1 where nothing oscillates. They are the roots
    of the characteristic polynomial, which is written out here.

    Args:
        axis: the cylinder.
        x: position from mid-stroke [m].
    """
    p, options = _with_lines(axis), axis.options
    mass = p.m + options.load_mass
    per_a, per_b = p.E / (p.V_A0 + p.A_A * x), p.E / (p.V_B0 - p.A_B * x)
    drag = p.sigma / mass
    loss_a, loss_b = (p.C_L + options.C_LA) * per_a, (p.C_L + options.C_LB) * per_b
    spring_a, spring_b = p.A_A**2 * per_a / mass, p.A_B**2 * per_b / mass
    leak = p.C_L**2 * per_a * per_b
    both = p.A_A * p.A_B * p.C_L * per_a * per_b / mass
    return _damping_of_pair(
        drag + loss_a + loss_b,
        drag * (loss_a + loss_b) + loss_a * loss_b - leak + spring_a + spring_b,
        drag * (loss_a * loss_b - leak) + spring_a * loss_b + spring_b * loss_a - 2.0 * both,
    )


def _damping_of_pair(a: float, b: float, c: float) -> float:
    """Return the damping ratio of the complex roots of s³ + a s² + b s + c; 1 where all are real.

    None of a, b, c and a b - c is negative: no root grows, and one is real, from -a to 0. What is
    left of the polynomial without that root is s² + (a + root) s + product.
    """
    low, high = -a, 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if ((middle + a) * middle + b) * middle + c > 0.0:
            high = middle
        else:
            low = middle
    rest = a + high
    product = b + high * rest
    if product <= 0.25 * rest**2:
        return 1.0
    return 0.5 * rest / math.sqrt(product)


def _with_lines(axis: CylinderConfig) -> PlantParameters:
    """Return the parameters with the oil of the lines in the chambers: the slow view of waves."""
    p, options = axis.parameters, axis.options
    if not options.has_lines:
        return p
    extra = [
        0.0 if line is None else line.compliance * p.E for line in (options.line_a, options.line_b)
    ]
    return replace(p, V_A0=p.V_A0 + extra[0], V_B0=p.V_B0 + extra[1])


def _motion_facts(axis: CylinderConfig) -> Iterator[Fact]:
    for word, extends in (("extending", True), ("retracting", False)):
        motion = steady_motion(axis.parameters, axis.options, extends=extends)
        note = _note(motion) + at_setting(axis.options.supply)
        yield Fact(f"top speed {word}", motion.speed * 1e3, "mm/s", note)
        yield Fact(f"  pressure A {word}", BAR.from_si(motion.P_A), "bar")
        yield Fact(f"  pressure B {word}", BAR.from_si(motion.P_B), "bar")
        flow = LITRE_PER_MINUTE.from_si(motion.supply_flow)
        yield Fact(f"  flow from the supply {word}", flow, "l/min")
        if (burst := burst_motion(axis, extends=extends)) is not None:
            speed = burst.speed * 1e3
            yield Fact(f"  with the accumulator {word}", speed, "mm/s", "until it is empty")


def burst_motion(
    axis: CylinderConfig, *, extends: bool, cushioned: bool = False
) -> SteadyMotion | None:
    """Return the motion while the accumulator of an own supply gives what its pump does not.

    It begins at the relief valve's pressure and falls with that of the gas. None where the pump
    does not limit the motion, and where there is no accumulator.
    """
    p, options, unit = axis.parameters, axis.options, axis.options.supply
    if axis.is_fed or unit is None or not unit.accumulator_volume:
        return None
    if not steady_motion(p, options, extends=extends, cushioned=cushioned).is_pump_limited:
        return None
    endless = replace(options, supply=replace(unit, pump_flow=_ANY_FLOW))
    return steady_motion(p, endless, extends=extends, cushioned=cushioned)


def _cushion_facts(axis: CylinderConfig) -> Iterator[Fact]:
    options = axis.options
    for word, extends in (("extending", True), ("retracting", False)):
        if (options.cushion_b if extends else options.cushion_a) is None:
            continue
        motion = steady_motion(axis.parameters, options, extends=extends, cushioned=True)
        speed, braked = motion.speed * 1e3, motion.P_B if extends else motion.P_A
        yield Fact(f"speed in the cushion {word}", speed, "mm/s", "steady, valve wide open")
        yield Fact("  pressure that brakes", BAR.from_si(braked), "bar")


def _note(motion: SteadyMotion) -> str:
    if not motion.speed:
        return "the load holds the piston"
    if motion.is_cavitating:
        return "the load runs ahead of the oil: the chamber cavitates"
    if motion.is_pump_limited:
        return "limited by the pump"
    if motion.is_compensated:
        return "held by the margin of compensator or pump"
    return "valve wide open, with friction and load"


def _rest_facts(axis: CylinderConfig) -> Iterator[Fact]:
    p = axis.parameters
    load = axis.options.load_at(axis.position)
    rest = (
        balanced_reduced_state(p, x=axis.position, F_L=load)
        if axis.model is Model.REDUCED
        else state_of_rest(p, axis.options, axis.position)
    )
    yield Fact("pressure A at rest", BAR.from_si(rest.P_A), "bar", "at the start of a run")
    yield Fact("pressure B at rest", BAR.from_si(rest.P_B), "bar")
    unit = axis.options.supply
    supply = p.P_S if unit is None else unit.relief_pressure
    note = "without friction" + at_setting(unit)
    yield Fact("largest push", (supply * p.A_A - p.P_T * p.A_B) * 1e-3, "kN", note)
    yield Fact("largest pull", (supply * p.A_B - p.P_T * p.A_A) * 1e-3, "kN", note)
    if load:
        yield Fact("load at the start", load * 1e-3, "kN", "positive against extension")


def at_setting(unit: SupplyUnit | None) -> str:
    """Return the words for a promise under P_S, which a unit can exceed by Q / G of its pump."""
    if unit is None or unit.variable is not None:
        return ""
    rise = BAR.from_si(unit.pump_flow / unit.relief_gradient)
    return f"; at the relief valve's setting, P_S rises by up to {rise:.3g} bar"


def filter_facts(unit: SupplyUnit | None) -> Iterator[Fact]:
    """Yield what the filter of a supply unit takes of the pressure at the pump's whole flow."""
    element = None if unit is None else unit.filter
    if unit is None or element is None:
        return
    drop = element.drop(unit.pump_flow)
    note = "through its bypass" if drop == element.bypass else "clean, at the pump's flow"
    yield Fact("drop of the filter", BAR.from_si(drop), "bar", note)


def line_facts(axis: CylinderConfig, step_us: int) -> Iterator[Fact]:
    """Yield time, frequency, drop and surge of the lines with waves."""
    p, options = axis.parameters, axis.options
    top = _fastest(axis, cushioned=False)
    for side, line, area, volume in (
        ("A", options.line_a, p.A_A, p.V_A0),
        ("B", options.line_b, p.A_B, p.V_B0),
    ):
        if line is None:
            continue
        time, steps = line.wave_time(p.rho), line.steps(p.rho, step_us * 1e-6)
        note = f"at {line.wave_speed(p.rho):.4g} m/s; {steps} steps"
        yield Fact(f"wave time of line {side}", time * 1e3, "ms", note)
        frequency = line_frequency(line, p.rho, volume / p.E)
        yield Fact("  its eigenfrequency", frequency, "Hz", "valve shut, held at mid-stroke")
        drop = line_drop(line, p.rho, area * top)
        yield Fact("  its pressure drop", BAR.from_si(drop), "bar", "at the higher top speed")
        surge = line.impedance(p.rho) * area * top
        yield Fact(
            "  surge of a valve that shuts", BAR.from_si(surge), "bar", "rho c v at that speed"
        )


def _swing_facts(axis: CylinderConfig, tick_us: int, step_us: int) -> Iterator[Fact]:
    p = axis.parameters
    x = softest_position(_with_lines(axis))
    lowest = eigenfrequency(axis, x)
    highest = max(eigenfrequency(axis, -p.h), eigenfrequency(axis, p.h))
    yield Fact("eigenfrequency, retracted", eigenfrequency(axis, -p.h), "Hz")
    yield Fact("eigenfrequency, mid-stroke", eigenfrequency(axis, 0.0), "Hz")
    yield Fact("eigenfrequency, extended", eigenfrequency(axis, p.h), "Hz")
    yield Fact("eigenfrequency, lowest", lowest, "Hz", f"at {x * 1e3:.4g} mm from mid-stroke")
    omega = 2.0 * math.pi * lowest
    damping = damping_ratio(axis, x)
    yield Fact("damping ratio there", damping, "-", "by friction and leakage, valve closed")
    yield Fact("limit of a position controller", 2.0 * damping * omega, "1/s", "gain 2 D omega")
    yield Fact("valve at -90 degrees", p.omega_0 * _SWINGS, "Hz", f"{p.omega_0 / omega:.3g} times")
    yield Fact("ticks a swing", 1e6 / (lowest * tick_us), "-", verdict(lowest, tick_us, 4.0))
    yield Fact("steps a swing", 1e6 / (highest * step_us), "-", verdict(highest, step_us, 12.0))


def verdict(frequency: float, period_us: int, needed: float) -> str:
    """Judge the resolution of a frequency by a sampling period, with the samples needed."""
    verdict = "resolved" if 1e6 / (frequency * period_us) >= needed else "not resolved"
    return f"{verdict}: {needed:g} are needed"


def _impact_facts(axis: CylinderConfig) -> Iterator[Fact]:
    p = axis.parameters
    mass = p.m + axis.options.load_mass
    top = _fastest(axis, cushioned=False)
    speed = _fastest(axis, cushioned=True)
    push = max(p.P_S * p.A_A, p.P_S * p.A_B)
    yield Fact("moving mass", mass, "kg")
    yield Fact("largest acceleration", push / mass, "m/s²", "full force by mass")
    yield Fact("time to top speed, at least", 1e3 * mass * top / push, "ms", "mass by full force")
    yield Fact(
        "energy at the end stop",
        0.5 * mass * speed * speed,
        "J",
        "at the higher speed there",
    )
    stop = axis.options.end_stop
    if stop is not None:
        depth = speed * math.sqrt(mass / stop.stiffness)
        yield Fact("  depth of impact, at most", 1e3 * depth, "mm", "without the stop's damping")


def _fastest(axis: CylinderConfig, *, cushioned: bool) -> float:
    """Return the higher of both speeds with the valve wide open, an accumulator's too [m/s]."""
    p, options = axis.parameters, axis.options
    motions = [
        burst_motion(axis, extends=extends, cushioned=cushioned)
        or steady_motion(p, options, extends=extends, cushioned=cushioned)
        for extends in (True, False)
    ]
    return max(motion.speed for motion in motions)
