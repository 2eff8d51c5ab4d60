"""Motions of a cylinder and its spool that a tick or a step does not resolve."""

import math
from collections.abc import Iterator

from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.waves import Line

_HALVINGS = 60

ROUNDING = 0.05
"""Share of a wave time by which whole steps may miss it."""
SAMPLES_PER_PERIOD = 4.0
"""Ticks that a controller needs at least to see an oscillation."""
STEPS_PER_PERIOD = 12.0
"""Steps that the solver needs: the midpoint rule's phase is off by (omega dt)²/12, so by 2 %."""


def find_unresolved(axis: CylinderConfig, tick_us: int, step_us: int) -> Iterator[str]:
    """Yield the oscillations that are too fast for the tick, or for the solver's step."""
    tick, step = tick_us * 1e-6, step_us * 1e-6
    at_centre, fastest = eigenfrequencies(axis)
    if at_centre * tick * SAMPLES_PER_PERIOD > 1.0:
        yield (
            f"the cylinder's eigenfrequency is {_short(at_centre)} Hz at mid-stroke, "
            f"{1.0 / (at_centre * tick):.2g} ticks of tick_us = {tick_us} a "
            f"period; {_right_us(at_centre, SAMPLES_PER_PERIOD)} us or less resolves it"
        )
    for side, line in (("A", axis.options.line_a), ("B", axis.options.line_b)):
        if line is not None:
            yield from _find_coarse(side, line, axis.parameters.rho, step_us)
    spool = axis.parameters.omega_0 / (2.0 * math.pi)
    for what, frequency in (
        ("the cylinder's eigenfrequency near its end stop", fastest),
        ("the spool's natural frequency", spool),
    ):
        if frequency * step * STEPS_PER_PERIOD > 1.0:
            steps = 1.0 / (frequency * step)
            yield (
                f"{what} is {_short(frequency)} Hz, {steps:.2g} steps of step_us = "
                f"{step_us} a period; "
                f"{_right_us(frequency, STEPS_PER_PERIOD)} us or less resolves it"
            )


def eigenfrequencies(axis: CylinderConfig) -> tuple[float, float]:
    """Return the cylinder's eigenfrequency at mid-stroke and at its stiffer end [Hz]."""
    h = axis.parameters.h
    return eigenfrequency(axis, 0.0), max(eigenfrequency(axis, -h), eigenfrequency(axis, h))


def _find_coarse(side: str, line: Line, density: float, step_us: int) -> Iterator[str]:
    """Yield a line whose wave time is off by more than `ROUNDING` in whole steps."""
    time = line.wave_time(density)
    steps = line.steps(density, step_us * 1e-6)
    if abs(steps * step_us * 1e-6 / time - 1.0) > ROUNDING:
        right = max(math.floor(time * 1e6 * 2.0 * ROUNDING), 1)
        yield (
            f"a wave passes line {side} in {time * 1e6:.3g} us, {steps} steps of step_us = "
            f"{step_us}; {right} us or less is within {ROUNDING:.0%} of it"
        )


def eigenfrequency(axis: CylinderConfig, x: float) -> float:
    """Return the cylinder's eigenfrequency at a piston position [Hz], as `swing_frequency`.

    Args:
        axis: the cylinder.
        x: position from mid-stroke [m].
    """
    return swing_frequency(axis.parameters, axis.options, x)


def swing_frequency(parameters: PlantParameters, options: PlantOptions, x: float) -> float:
    """Return the lowest frequency at which the piston swings on the oil, the valve shut [Hz].

    Both chambers are springs: omega² = E (A_A² / V_A + A_B² / V_B) / m. A line with waves adds the
    compliance tan(omega T) / (omega Z) of a line that is shut at its end to that of the chamber.

    Args:
        parameters: of the cylinder.
        options: of the cylinder.
        x: position from mid-stroke [m].
    """
    p = parameters
    mass = p.m + options.load_mass
    volume_a, volume_b = p.V_A0 + p.A_A * x, p.V_B0 - p.A_B * x
    if not options.has_lines:
        stiffness = p.A_A**2 / volume_a + p.A_B**2 / volume_b
        return math.sqrt(p.E * stiffness / mass) / (2.0 * math.pi)
    chambers = ((options.line_a, p.A_A, volume_a / p.E), (options.line_b, p.A_B, volume_b / p.E))

    def excess(omega: float) -> float:
        return -mass * omega**2 + math.fsum(
            area**2 / (oil + _line_compliance(line, p.rho, omega)) for line, area, oil in chambers
        )

    # The stiffness falls from that of the volumes until the first line swings by itself.
    low = 0.0
    high = min(
        2.0 * math.pi * line_frequency(line, p.rho, oil)
        for line, _, oil in chambers
        if line is not None
    )
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return high / (2.0 * math.pi)


def line_frequency(line: Line, density: float, compliance: float) -> float:
    """Return the lowest frequency of a line between a shut valve and a chamber [Hz].

    The piston stands: tan(omega T) / (omega Z) + C = 0, which is between the quarter wave 1 / (4 T)
    of a large chamber and the half wave 1 / (2 T) of none.

    Args:
        line: it.
        density: of the oil [kg/m³].
        compliance: C of the chamber [m³/Pa].
    """
    low, high = 0.5 * math.pi, math.pi
    share = compliance / line.compliance
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if math.tan(middle) / middle + share < 0.0 else (low, middle)
    return high / (2.0 * math.pi * line.wave_time(density))


def _line_compliance(line: Line | None, density: float, omega: float) -> float:
    """Return the volume per pressure that a line takes at a frequency [m³/Pa], shut at its end."""
    if line is None:
        return 0.0
    phase = omega * line.wave_time(density)
    return line.compliance * (math.tan(phase) / phase if phase else 1.0)


def _right_us(frequency: float, samples: float) -> str:
    limit = 1e6 / (frequency * samples)
    return f"{limit:.2g}" if limit < 10.0 else f"{math.floor(limit)}"


def _short(number: float) -> str:
    """Return a number with three digits that count, and no exponent where it has up to ten."""
    return f"{float(f'{number:.3g}'):.10g}"
