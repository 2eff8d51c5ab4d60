"""Restrictions that oil passes: orifices, eqs. (5)-(7), edges, cushions, counterbalance valves.

Port A sees the orifice state z, port B sees -z: for both, a positive opening joins the chamber to
the supply and a negative one joins it to the tank, which is eqs. (5) and (6) in one.
"""

import math

from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel
from hil_bench.plants.hydraulic_cylinder.model.spool import LandConstants

OrificeConstants = tuple[float, float, float, float, float]
"""(K, P_S, P_T, p_tr², signed): `signed` is 1.0 for the signed root, 0.0 for the clamped one."""


@kernel
def linearise_flow(
    opening: float, pressure: float, orifice: OrificeConstants
) -> tuple[float, float, float]:
    """Return the flow into a chamber and how it falls with the chamber's pressure.

    Q = opening K dp / (dp² + p_tr²)^(1/4) with dp = P_S - P or P - P_T: the square root of
    eqs. (5), (6) for |dp| well above the laminar transition p_tr, linear well below it.

    Args:
        opening: z for port A, -z for port B [m].
        pressure: of the chamber [Pa].
        orifice: the constants.

    Returns:
        The flow [m³/s], its secant |Q / dp| and its tangent |dQ / dP|, both [m³/(s Pa)].
    """
    K, P_S, P_T, transition_squared, signed = orifice
    drop = P_S - pressure if opening > 0.0 else pressure - P_T
    square = drop * drop
    total = square + transition_squared
    is_blocked = total == 0.0 or (drop < 0.0 and signed == 0.0)
    total = 1.0 if is_blocked else total
    gain = 0.0 if is_blocked else opening * K / math.sqrt(math.sqrt(total))
    secant = abs(gain)
    # + 0.0: a closed orifice passes 0, never -0
    return gain * drop + 0.0, secant, secant * (1.0 - 0.5 * square / total)


@kernel
def port_flow(opening: float, pressure: float, orifice: OrificeConstants) -> float:
    """Return the flow into a chamber [m³/s], eqs. (5), (6); arguments as `linearise_flow`."""
    return linearise_flow(opening, pressure, orifice)[0]


# The valve as four metering edges, each with an overlap of its own and never quite closed.
#
# Both edges of a port can pass oil at once: those of a valve with underlap, and those that
# leak. An edge that is open by s beyond its overlap passes what an orifice of
#
#     a(s) = x_0 + s   for s >= 0,   x_0² / (x_0 - s)   for s < 0
#
# passes: the law of B. Eryilmaz and B. Wilson (Combining leakage and orifice flows in a
# hydraulic servovalve model, ASME Journal of Dynamic Systems, Measurement and Control 122,
# 2000), with one slope to both sides of s = 0. x_0 is what leaks in the centre of a valve
# without overlap.
#
# Oil that leaves a chamber may have to pass a cushion and a counterbalance valve before the
# edge; what flows in does not, through their check valves. Orifices in series pass the same
# flow, so an edge of opening a behind a resistance r [1/m] acts as one of a / sqrt(1 + (a r)²).
#
# A pressure compensator before the valve lets no more than its margin drop over an edge that
# feeds, so that the flow does not depend on the load; its check valve lets nothing back to the
# supply.


EdgeConstants = tuple[float, float, float, float, float, float, float, float]
"""(is on, x_0 [m], overlaps of P-A, A-T, P-B and B-T [m], travel of the spool to either side [m]).

Not on: one edge a port, as in eqs. (4) to (6).
"""

Edge = tuple[float, float, float]
"""Flow into the chamber [m³/s], secant and tangent [m³/(s Pa)], as `linearise_flow` gives them."""

Edges = tuple[Edge, Edge, Edge, Edge]
"""P-A, A-T, P-B, B-T."""

Resistances = tuple[float, float]
"""The resistance before the edge to oil that leaves A, and B [1/m]; infinite where no oil can."""


@kernel
def edge_opening(
    beyond: float, largest: float, gain: float, x_0: float, saturation: float
) -> float:
    """Return the opening of an edge [m], with its gain, its leakage and its saturation.

    Args:
        beyond: spool position beyond the edge's overlap [m].
        largest: that of the spool's travel [m].
        gain: of the edge [-].
        x_0: opening that leaks [m].
        saturation: s of the flow a sqrt((1 + s) / (1 + s a²)) at a share a of the opening [-].
    """
    if beyond < 0.0:
        opening = x_0 * (x_0 / (x_0 - beyond))
    else:
        opening = x_0 + beyond
        opening = largest if opening > largest else opening
    share = opening / largest
    return gain * opening * math.sqrt((1.0 + saturation) / (1.0 + saturation * share * share))


@kernel
def edge_openings(
    nu: float, edges: EdgeConstants, lands: LandConstants
) -> tuple[float, float, float, float]:
    """Return the openings of P-A, A-T, P-B and B-T [m] at a spool position [m]."""
    _, x_0, P_A, A_T, P_B, B_T, forth, back = edges
    gain_PA, gain_AT, gain_PB, gain_BT, s = lands
    nu = forth if nu > forth else nu
    nu = -back if nu < -back else nu
    return (
        edge_opening(nu - P_A, forth - P_A, gain_PA, x_0, s),
        edge_opening(-nu - A_T, back - A_T, gain_AT, x_0, s),
        edge_opening(-nu - P_B, back - P_B, gain_PB, x_0, s),
        edge_opening(nu - B_T, forth - B_T, gain_BT, x_0, s),
    )


@kernel
def throttle(opening: float, resistance: float) -> float:
    """Return the opening [m] of an edge behind a resistance [1/m]."""
    if opening == 0.0 or resistance == 0.0:
        return opening
    product = opening * resistance
    return opening / math.sqrt(1.0 + product * product)


@kernel
def flow_from_supply(
    opening: float, pressure: float, resistance: float, margin: float, orifice: OrificeConstants
) -> Edge:
    """Return the flow through the edge between the supply and a chamber.

    Args:
        opening: of the edge [m].
        pressure: in the chamber [Pa].
        resistance: for oil that leaves the chamber [1/m].
        margin: of a pressure compensator [Pa]; infinite for none.
        orifice: the constants.
    """
    if pressure > orifice[1]:
        opening = throttle(opening, resistance) if margin == math.inf else 0.0
    elif orifice[1] - pressure > margin:
        return linearise_flow(opening, orifice[1] - margin, orifice)[0], 0.0, 0.0
    return linearise_flow(opening, pressure, orifice)


@kernel
def flow_to_tank(
    opening: float, pressure: float, resistance: float, orifice: OrificeConstants
) -> Edge:
    """Return the flow through the edge between a chamber and the tank, negative when it leaves.

    Args:
        opening: of the edge [m].
        pressure: in the chamber [Pa].
        resistance: for oil that leaves the chamber [1/m].
        orifice: the constants.
    """
    if pressure > orifice[2]:
        opening = throttle(opening, resistance)
    return linearise_flow(-opening, pressure, orifice)


@kernel
def flow_through_edges(
    nu: float,
    pressures: tuple[float, float],
    resistances: Resistances,
    margin: float,
    orifice: OrificeConstants,
    edges: EdgeConstants,
    lands: LandConstants,
) -> Edges:
    """Return the flow through each of the four edges.

    Args:
        nu: spool position [m].
        pressures: P_A and P_B [Pa].
        resistances: for oil that leaves A and B.
        margin: of a pressure compensator [Pa]; infinite for none.
        orifice: the constants.
        edges: the constants.
        lands: the constants.
    """
    open_PA, open_AT, open_PB, open_BT = edge_openings(nu, edges, lands)
    return (
        flow_from_supply(open_PA, pressures[0], resistances[0], margin, orifice),
        flow_to_tank(open_AT, pressures[0], resistances[0], orifice),
        flow_from_supply(open_PB, pressures[1], resistances[1], margin, orifice),
        flow_to_tank(open_BT, pressures[1], resistances[1], orifice),
    )


# Cushions at both ends of the stroke: near an end, oil leaves through a throttle only.
#
# Over the first fifth of its length the plug closes the port; from there on the throttle is all
# that is left. Oil flows in through a check valve, as freely as elsewhere.


CushionConstants = tuple[float, float, float, float]
"""(length at A's end [m], resistance of its throttle [1/m], the same at B's end); 0 for none."""

TAPER = 0.2
"""Share of a cushion's length over which its plug closes the port."""


@kernel
def cushion_resistance(distance: float, length: float, resistance: float) -> float:
    """Return the resistance of the cushion to oil that leaves a chamber [1/m].

    Args:
        distance: of the piston from the end of its stroke [m].
        length: of the cushion [m].
        resistance: of its throttle [1/m]; 0 for no cushion.
    """
    if resistance == 0.0 or distance >= length:
        return 0.0
    share = (length - distance) / (TAPER * length)
    return resistance if share > 1.0 else share * resistance


@kernel
def cushion_resistances(x: float, h: float, cushions: CushionConstants) -> tuple[float, float]:
    """Return the resistances for oil that leaves A, at -h, and B, at +h [1/m].

    Args:
        x: piston position [m].
        h: half-stroke [m].
        cushions: the constants.
    """
    return (
        cushion_resistance(h + x, cushions[0], cushions[1]),
        cushion_resistance(h - x, cushions[2], cushions[3]),
    )


# Counterbalance valves: they hold a load until the pressure of the other line opens them.
#
#     y_target = (P + R P_pilot - P_set) / span, between 0 and 1,   tau dy/dt = y_target - y
#
# with the pressure P of the chamber that carries the load, the pilot ratio R and the share y of
# the opening: the balance of forces of Simscape's block Counterbalance Valve (IL), of a valve
# whose spring chamber is vented, so that pressure behind it does not add to the setting. The
# time constant stands for spool and damping nozzle.
#
# The lag takes the implicit midpoint rule, y_mid = (y + k y_target) / (1 + k) with k = dt / (2
# tau), so it is stable at every step.


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
