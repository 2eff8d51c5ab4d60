"""Counterbalance valves: they hold a load until the pressure of the other line opens them.

    y_target = (P + R P_pilot - P_set) / span, between 0 and 1,   tau dy/dt = y_target - y

with the pressure P of the chamber that carries the load, the pilot ratio R and the share y of the
opening: the balance of forces of Simscape's block Counterbalance Valve (IL), of a valve whose
spring chamber is vented, so that pressure behind it does not add to the setting. The time constant
stands for spool and damping nozzle.

The lag takes the implicit midpoint rule, y_mid = (y + k y_target) / (1 + k) with k = dt / (2 tau),
so it is stable at every step.
"""

import math

from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel

CounterbalanceConstants = tuple[float, float, float, float, float, float, float]
"""(in line A, in line B, P_set [Pa], R, 1 / span [1/Pa], full opening [m], 1 / tau [1/s])."""

Shares = tuple[float, float]
"""By how much the valves in line A and in line B are open [-]."""


@kernel
def within(share: float) -> float:
    """Return a share that is no less than 0 and no more than 1 [-]."""
    if share < 0.0:
        return 0.0
    return 1.0 if share > 1.0 else share


@kernel
def opening_target(
    pressure: float, pilot: float, P_set: float, ratio: float, per_span: float
) -> float:
    """Return the share of its opening to which a counterbalance valve moves [-].

    Args:
        pressure: of the load [Pa].
        pilot: pressure of the other line [Pa].
        P_set: setting [Pa].
        ratio: of the pilot area to that of the load [-].
        per_span: inverse of the pressure from the first opening to the full one [1/Pa].
    """
    return within((pressure + ratio * pilot - P_set) * per_span)


@kernel
def behind(resistance: float, share: float, is_there: float, full_opening: float) -> float:
    """Return a resistance [1/m] with a counterbalance valve in series; infinite while it is shut.

    Args:
        resistance: of what else oil has to pass [1/m].
        share: by how much the valve is open [-].
        is_there: 0 for no valve.
        full_opening: of the valve [m].
    """
    if is_there == 0.0:
        return resistance
    if share <= 0.0:
        return math.inf
    own = 1.0 / (share * full_opening)
    return math.sqrt(resistance * resistance + own * own)


@kernel
def lag(share: float, target: float, k: float) -> tuple[float, float]:
    """Return the share of the opening in the middle and at the end of a step [-].

    Args:
        share: at the start of the step [-].
        target: of the step [-].
        k: dt / (2 tau) [-].
    """
    middle = (share + k * target) / (1.0 + k)
    return middle, middle + middle - share


@kernel
def move_valves(
    shares: Shares, pressures: tuple[float, float], dt: float, valve: CounterbalanceConstants
) -> tuple[Shares, Shares]:
    """Return the shares of both openings in the middle and at the end of a step.

    Args:
        shares: at the start of the step.
        pressures: P_A and P_B that open the valves in the step [Pa].
        dt: step [s].
        valve: the constants.
    """
    in_A, in_B, P_set, ratio, per_span, _, rate = valve
    k = 0.5 * dt * rate
    middle_A = end_A = middle_B = end_B = 0.0
    if in_A != 0.0:
        target = opening_target(pressures[0], pressures[1], P_set, ratio, per_span)
        middle_A, end_A = lag(shares[0], target, k)
    if in_B != 0.0:
        target = opening_target(pressures[1], pressures[0], P_set, ratio, per_span)
        middle_B, end_B = lag(shares[1], target, k)
    # The midpoint rule overshoots a target that it cannot follow.
    return (middle_A, middle_B), (within(end_A), within(end_B))
