"""The cavitation floor: a chamber that is pulled below it opens a cavity, which oil fills again.

At the floor a chamber's pressure stays, and what flows out opens a cavity: no oil is lost. What
flows in closes the cavity first and compresses the oil after that. So at any time the cavity is
closed or the pressure is at the floor, and the balances of eqs. (8), (9) read

    V / E dP/dt - d(cavity)/dt = net flow into the chamber.

Over an implicit step both chambers and the piston depend on each other. Which chambers end at the
floor is a linear complementarity problem: pressure rise above the floor times cavity is 0 in each.
Its matrix is symmetric and positive definite with negative couplings, so that releasing a chamber
from the floor can only raise the other one: the solution is found by releasing, never taking back.
"""

from hil_bench.plants.hydraulic_cylinder.model.chamber import ChamberConstants
from hil_bench.plants.hydraulic_cylinder.model.constants import Constants
from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel

Oil = tuple[float, float, float, float, float, float]
"""(a, b, c, net_A, net_B, half) of a step: a dP_A - c dP_B = net_A - half A_A dv and, for B,
b dP_B - c dP_A = net_B + half A_B dv.

a and b are the chambers' compliances over dt and what damps there, c the share of the leakage
between both [m³/(s Pa)]; net_A and net_B are the flows that compress the oil at the start of the
step, less those that close the cavities [m³/s]; half is 1/2, and a little more with the end
correction of `model.coupling`.
"""

Response = tuple[float, float, float, float]
"""(dP_A, fall_A, dP_B, fall_B): the pressures change by dP - fall dv over the step."""


@kernel
def compress(
    pressure: float, cavity: float, net: float, dt: float, gain: float, floor: float
) -> tuple[float, float]:
    """Return a chamber's pressure [Pa] and cavity [m³] after an explicit step.

    Args:
        pressure: at the start of the step [Pa].
        cavity: at the start of the step [m³].
        net: flow that compresses the oil [m³/s].
        dt: step [s].
        gain: dt E / V, pressure per flow [Pa s/m³].
        floor: cavitation floor [Pa].
    """
    free = pressure + gain * (net - cavity / dt)
    if free < floor:
        return floor, dt * ((floor - free) / gain)
    return free, 0.0


@kernel
def fill(pressure: float, cavity: float, stiffness: float, floor: float) -> tuple[float, float]:
    """Return pressure [Pa] and cavity [m³] of the same oil, with one of both at its bound.

    Args:
        pressure: of a chamber, which may be below the floor [Pa].
        cavity: in it, which may be negative or open above the floor [m³].
        stiffness: E / V [Pa/m³].
        floor: cavitation floor [Pa].
    """
    if pressure >= floor and cavity == 0.0:
        return pressure, cavity
    above = pressure - floor - stiffness * cavity
    if above < 0.0:
        return floor, -above / stiffness
    return floor + above, 0.0


@kernel
def most(first: float, second: float) -> float:
    """Return the larger of two numbers."""
    return second if first < second else first


@kernel
def missing_flows(
    rise_A: float, rise_B: float, dv: float, oil: Oil, chambers: ChamberConstants
) -> tuple[float, float]:
    """Return the flows that both chambers lack for these pressure rises, into cavities [m³/s].

    Args:
        rise_A: of P_A over the step [Pa].
        rise_B: of P_B over the step [Pa].
        dv: velocity change over the step [m/s].
        oil: of the step.
        chambers: the constants.
    """
    a, b, c, net_A, net_B, half = oil
    return (
        a * rise_A - c * rise_B - net_A + chambers[2] * half * dv,
        b * rise_B - c * rise_A - net_B - chambers[3] * half * dv,
    )


@kernel
def hold(
    rise_A: float,
    rise_B: float,
    force: float,
    inertia: float,
    oil: Oil,
    constants: Constants,
) -> Response:
    """Return the pressures' response in a step that at least one chamber ends at the floor.

    Args:
        rise_A: from P_A at the start of the step to the floor [Pa].
        rise_B: from P_B at the start of the step to the floor [Pa].
        force: on the piston at the start of the step [N].
        inertia: m / dt and what damps the piston [N s/m].
        oil: of the step.
        constants: in their groups.
    """
    a, b, c, net_A, net_B, half = oil
    chambers, sigma = constants[5], constants[6][2]
    _, _, A_A, A_B, _, _, _ = chambers
    dv = (force + half * (A_A * rise_A - A_B * rise_B)) / (inertia + (half - 0.5) * sigma)
    missing_A, missing_B = missing_flows(rise_A, rise_B, dv, oil, chambers)
    if missing_A < 0.0:
        return (net_A + c * rise_B) / a, half * A_A / a, rise_B, 0.0
    if missing_B < 0.0:
        return rise_A, 0.0, (net_B + c * rise_A) / b, -half * A_B / b
    return rise_A, 0.0, rise_B, 0.0


@kernel
def share_out(
    rise_A: float, rise_B: float, dv: float, oil: Oil, chambers: ChamberConstants
) -> tuple[float, float, float, float]:
    """Return the rises of P_A, P_B [Pa] and the flows that open cavities in A and in B [m³/s].

    Args:
        rise_A: from P_A at the start of the step to the floor [Pa].
        rise_B: from P_B at the start of the step to the floor [Pa].
        dv: velocity change over the step [m/s].
        oil: of the step.
        chambers: the constants.
    """
    a, b, c, _, _, _ = oil
    missing_A, missing_B = missing_flows(rise_A, rise_B, dv, oil, chambers)
    if missing_A >= 0.0 and missing_B >= 0.0:
        return rise_A, rise_B, missing_A, missing_B
    # One alone at the floor: the other rises until it lacks nothing. Below 0 a flow is rounding.
    # As c is less than a and b, the one alone at the floor lacks more than the other would.
    more_A, more_B = -missing_A / a, -missing_B / b
    flow_A, flow_B = missing_A - c * more_B, missing_B - c * more_A
    if flow_A >= flow_B:
        return rise_A, rise_B + more_B, most(flow_A, 0.0), 0.0
    return rise_A + more_A, rise_B, 0.0, most(flow_B, 0.0)
