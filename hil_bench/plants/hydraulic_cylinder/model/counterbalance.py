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
    share = (pressure + ratio * pilot - P_set) * per_span
    if share < 0.0:
        return 0.0
    return 1.0 if share > 1.0 else share


@kernel
def counterbalance_resistance(share: float, is_there: float, full_opening: float) -> float:
    """Return what oil has to pass in a counterbalance valve [1/m]; infinite while it is shut."""
    if is_there == 0.0:
        return 0.0
    if share <= 0.0:
        return math.inf
    return 1.0 / (share * full_opening)


@kernel
def move_counterbalance(share: float, target: float, k: float) -> tuple[float, float]:
    """Return the share of the opening in the middle and at the end of a step [-].

    Args:
        share: at the start of the step [-].
        target: in its middle [-].
        k: dt / (2 tau) [-].
    """
    middle = (share + k * target) / (1.0 + k)
    return middle, middle + middle - share
