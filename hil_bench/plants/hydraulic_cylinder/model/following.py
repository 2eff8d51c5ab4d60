"""The friction curve over an implicit step: damped where it is stiff, followed where it bends."""

import math

from hil_bench.plants.hydraulic_cylinder.model.friction import FrictionConstants, linearise_friction
from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel

Drag = tuple[float, float, float]
"""What the friction curve is at the start of a step: (secant, tangent, implicit share) [N s/m]."""

NO_DRAG: Drag = (math.inf, 0.0, 0.0)
"""In place of the friction curve where bristles hold the piston."""


@kernel
def implicit_share(secant: float, tangent: float, inertia: float) -> float:
    """Return the addition of a damping element to the inertia that it works on, in one step.

    tangent / 2 is the midpoint rule's share, secant that of a backward Euler step on the secant.
    Between them, secant² / (8 inertia) brings the step close to the exact solution of both
    dy/dt = -y and dy/dt = -sqrt(y), and keeps it from overshooting.

    Args:
        secant: flow / drop or force / velocity.
        tangent: d flow / d drop or d force / d velocity.
        inertia: V / (E dt) or m / dt, in the unit of the two.
    """
    share = 0.5 * tangent + 0.125 * secant * secant / inertia
    if share > secant:
        return secant
    least = -0.25 * inertia
    return least if share < least else share


@kernel
def linearise_drag(v: float, inertia: float, friction: FrictionConstants) -> Drag:
    """Return secant, tangent and implicit share of the friction curve, eq. (13) [N s/m].

    Args:
        v: piston velocity at the start of the step [m/s].
        inertia: m / dt [N s/m].
        friction: the constants.
    """
    secant, tangent = linearise_friction(v, friction)
    return secant, tangent, implicit_share(secant, tangent, inertia)


@kernel
def follow_friction(
    dv: float,
    v: float,
    resistance: float,
    drag: Drag,
    inertia: float,
    friction: FrictionConstants,
) -> tuple[float, float]:
    """Return the velocity change over the step along the friction curve, and what it is off by.

    The mean from v to v + dv is that of the cubic through both ends with their tangents; one Newton
    step brings dv there. Where the secant exceeds the inertia, a step is too long to follow the
    curve, and dv stays: so no piston turns round further than without this.

    The error is judged by what the tangents at both ends leave of the curve between them: by the
    part that a straight slope does not explain, and by the slope's own change.

    Args:
        dv: velocity change with the friction as linearised at the start of the step [m/s].
        v: piston velocity at the start of the step [m/s].
        resistance: force per velocity change of everything [N s/m].
        drag: the friction curve at the start of the step.
        inertia: m / dt [N s/m].
        friction: the constants.
    """
    secant, tangent, share = drag
    if secant > inertia:
        return dv, 0.25 * abs(dv) if secant < math.inf else 0.0
    end = v + dv
    secant_end, tangent_end = linearise_friction(end, friction)
    before, after = secant * v, secant_end * end
    bend = (tangent_end - tangent) * dv / 12.0
    excess = 0.5 * (before + after) - bend - before - share * dv
    slope = 0.5 * tangent_end if tangent_end > 0.0 else 0.0
    unexplained = 0.25 * abs(after - before - 0.5 * (tangent + tangent_end) * dv)
    error = (unexplained + abs(bend)) / resistance
    return dv - excess / (resistance - share + slope), error
