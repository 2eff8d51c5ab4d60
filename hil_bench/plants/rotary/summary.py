"""The key figures of a motor: speeds, torques, pressures, frequencies, times."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from hil_bench.config.settings import Range
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import SteadyMotion, steady_motion
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
from hil_bench.plants.kind import Fact
from hil_bench.plants.rotary.configuration import RotaryConfig
from hil_bench.units import BAR, LITRE_PER_MINUTE, REVOLUTION_PER_MINUTE

_TURNS = Range(0.0, 10_000.0, "our choice: small axial pistons reach it")

USUAL_RESULTS: Final[Mapping[str, Range]] = {
    "top speed forwards": _TURNS,
    "top speed backwards": _TURNS,
    "eigenfrequency": SWING,
}
"""What machines reach, in the units of the facts."""


def summarise(axis: RotaryConfig, tick_us: int, step_us: int) -> Sequence[Fact]:
    """Return the key figures of a motor that an engineer checks first.

    Args:
        axis: its record.
        tick_us: period of the loop [us].
        step_us: step of the solver [us].
    """
    own = None if axis.cylinder.is_fed else axis.cylinder.options.supply
    return [
        *_motion_facts(axis),
        *_torque_facts(axis),
        *filter_facts(own),
        *line_facts(axis.cylinder, step_us),
        *_swing_facts(axis, tick_us, step_us),
    ]


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
