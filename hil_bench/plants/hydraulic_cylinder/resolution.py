"""Motions of a cylinder and its spool that a tick or a step does not resolve."""

import math
from collections.abc import Iterator

from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig

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


def eigenfrequency(axis: CylinderConfig, x: float) -> float:
    """Return the cylinder's eigenfrequency at a piston position [Hz].

    Both chambers are springs: omega² = E (A_A² / V_A + A_B² / V_B) / m.

    Args:
        axis: the cylinder.
        x: position from mid-stroke [m].
    """
    p = axis.parameters
    mass = p.m + axis.options.load_mass
    stiffness = p.A_A**2 / (p.V_A0 + p.A_A * x) + p.A_B**2 / (p.V_B0 - p.A_B * x)
    return math.sqrt(p.E * stiffness / mass) / (2.0 * math.pi)


def _right_us(frequency: float, samples: float) -> str:
    limit = 1e6 / (frequency * samples)
    return f"{limit:.2g}" if limit < 10.0 else f"{math.floor(limit)}"


def _short(number: float) -> str:
    """Return a number with three digits that count, and no exponent where it has up to ten."""
    return f"{float(f'{number:.3g}'):.10g}"
