"""The valve as four metering edges, each with an overlap of its own and never quite closed.

Both edges of a port can pass oil at once: those of a valve with underlap, and those that leak. An
edge that is open by s beyond its overlap passes what an orifice of

    a(s) = x_0 + s   for s >= 0,   x_0² / (x_0 - s)   for s < 0

passes: the law of B. Eryilmaz and B. Wilson (Combining leakage and orifice flows in a hydraulic
servovalve model, ASME Journal of Dynamic Systems, Measurement and Control 122, 2000), with one
slope to both sides of s = 0. x_0 is what leaks in the centre of a valve without overlap.

Oil that leaves a chamber may have to pass a cushion and a counterbalance valve before the edge;
what flows in does not, through their check valves. Orifices in series pass the same flow, so an
edge of opening a behind a resistance r [1/m] acts as one of a / sqrt(1 + (a r)²).

A pressure compensator before the valve lets no more than its margin drop over an edge that feeds,
so that the flow does not depend on the load; its check valve lets nothing back to the supply.
"""

import math

from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel
from hil_bench.plants.hydraulic_cylinder.model.orifice import OrificeConstants, linearise_flow
from hil_bench.plants.hydraulic_cylinder.model.spool import LandConstants

EdgeConstants = tuple[float, float, float, float, float, float, float, float]
"""(is on, x_0 [m], overlaps of P-A, A-T, P-B and B-T [m], travel of the spool to either side [m]).

Not on: one edge a port, as in eqs. (4) to (6).
"""

Edge = tuple[float, float, float]
"""Flow into the chamber [m³/s], secant and tangent [m³/(s Pa)], as `linearise_flow` gives them."""

Edges = tuple[Edge, Edge, Edge, Edge]
"""P-A, A-T, P-B, B-T."""

Resistances = tuple[float, float]
"""What oil that leaves A, and B, has to pass before the edge [1/m]; infinite where none can."""


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
