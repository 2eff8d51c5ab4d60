"""Parts of a step: where its error is too large, a step is made again in four, those again in four.

A step of the linearly implicit midpoint rule estimates the error of its velocity from what it has
at hand: the tangents at both ends of its way along the friction curve, the change of the pressure
drops relative to the drops, the way of the spool across an edge, contact with an end stop, a cavity
that opens or closes. A step whose estimate exceeds `TOLERANCE` is made in parts of a quarter, a
sixteenth or a sixty-fourth. That bounds the work: a step takes at most 85 evaluations, 64 accepted
and 21 rejected ones. Smooth motion takes one evaluation a step
(`docs/decisions/0042-a-step-in-parts.md`).
"""

import math

from hil_bench.plants.hydraulic_cylinder.model.constants import Constants
from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel
from hil_bench.plants.hydraulic_cylinder.model.spool import orifice_state

Ports = tuple[float, float, float, float]
"""(secant_A, secant_B, Q_A, Q_B): of both orifices at the start of a step."""

PARTS = 64
"""Smallest parts in a step."""

RATIO = 4
"""Parts into which a step or a part is cut."""

TOLERANCE = 1e-5
"""Largest error of the velocity at which a step or a part is accepted [m/s]."""

_RATE = 1000.0
"""Rate at which an error of the oil's volume becomes one of the velocity, a swing's [1/s]."""

_KINK = 0.125
"""Change of a pressure drop over a step, as a share of the drop, that a tangent stands for."""


@kernel
def shorten(constants: Constants, size: int) -> Constants:
    """Return the constants for a step of `size` parts of 64."""
    (dt, m, per_E_dt, floor), spool, opening, transition, orifice, chambers, friction, stop = (
        constants
    )
    share = size / PARTS  # a power of two: exact
    step = (dt * share, m, per_E_dt / share, floor)
    return step, spool, opening, transition, orifice, chambers, friction, stop


@kernel
def place_between(ends: tuple[float, float], done: int) -> float:
    """Return the value after `done` parts of 64 on the way from the first to the second."""
    share = done / PARTS
    return (1.0 - share) * ends[0] + share * ends[1]


@kernel
def largest_part(done: int, size: int) -> int:
    """Return the largest size of part with which the step can go on.

    Args:
        done: parts of 64 that have been made.
        size: of the part before.
    """
    while size < PARTS and done % (RATIO * size) == 0:
        size *= RATIO
    return size


@kernel
def flow_error(rises: tuple[float, float], ports: Ports, constants: Constants) -> float:
    """Return the velocity error from the change of the pressure drops over a step [m/s].

    The mean of a square root over a step misses (change / drop)² / 24 of the flow; where the drop
    turns round, some of secant times change.

    Args:
        rises: of P_A and P_B over the step [Pa].
        ports: of the step.
        constants: in their groups.
    """
    (dt, _, _, _), _, _, _, _, (_, _, A_A, A_B, _, _, _), _, _ = constants
    secant_A, secant_B, Q_A, Q_B = ports
    change_A, change_B = secant_A * abs(rises[0]), secant_B * abs(rises[1])
    error = change_A / A_A if change_A > _KINK * abs(Q_A) else 0.0
    error += change_B / A_B if change_B > _KINK * abs(Q_B) else 0.0
    return _RATE / 24.0 * dt * error


@kernel
def edge_error(spool: tuple[float, float], z: float, constants: Constants) -> float:
    """Return the velocity error from the spool's crossing of an edge of eq. (2) [m/s].

    Args:
        spool: spool position at the start and at the end of the step [m].
        z: orifice state in the middle [m].
        constants: in their groups.
    """
    (dt, _, _, _), _, opening, _, (K, P_S, P_T, _, _), (_, _, A_A, _, _, _, _), _, _ = constants
    bend = abs(z - 0.5 * (orifice_state(spool[0], opening) + orifice_state(spool[1], opening)))
    return _RATE * dt * bend * K * math.sqrt(abs(P_S - P_T)) / A_A


@kernel
def oil_error(
    rises: tuple[float, float],
    ports: Ports,
    spool: tuple[float, float],
    z: float,
    constants: Constants,
) -> float:
    """Return the velocity error from the oil: pressure drops and edges [m/s].

    Args:
        rises: of P_A and P_B over the step [Pa].
        ports: of the step.
        spool: spool position at the start and at the end of the step [m].
        z: orifice state in the middle [m].
        constants: in their groups.
    """
    return flow_error(rises, ports, constants) + edge_error(spool, z, constants)
