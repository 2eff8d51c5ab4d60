"""The oil of an extended step: chambers, edges and supply line as one linear system.

Leakage takes the midpoint rule's share, each edge its own. The supply pressure is a fourth unknown
and is eliminated before the other three: with the shares s_A and s_B of the edges that feed and
D = C_S / dt + s_relief + s_A + s_B, its row gives dP_S = (net_S + s_A dP_A + s_B dP_B) / D.
"""

import math

from hil_bench.plants.hydraulic_cylinder.model.cavitation import Oil
from hil_bench.plants.hydraulic_cylinder.model.chamber import (
    AirConstants,
    bulk_modulus,
    chamber_volumes,
    net_flows,
)
from hil_bench.plants.hydraulic_cylinder.model.constants import Constants, ExtendedConstants
from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import Cylinder
from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel
from hil_bench.plants.hydraulic_cylinder.model.orifice import (
    behind,
    cushion_resistances,
    flow_through_edges,
    linearise_flow,
    move_valves,
)
from hil_bench.plants.hydraulic_cylinder.model.parts import Ports
from hil_bench.plants.hydraulic_cylinder.model.spool import meter_openings
from hil_bench.plants.hydraulic_cylinder.model.stepping import implicit_share
from hil_bench.plants.hydraulic_cylinder.model.supply import (
    SupplyConstants,
    behind_filter,
    relief_flow,
    sensed_pressure,
    supply_compliance,
    swivel,
)

Charge = tuple[float, float]
"""(flow into the supply line at the start of the step, its compliance over dt and relief share)."""

Feeding = tuple[float, float, float, float]
"""Its charge, and the shares of the edges that feed A and B [m³/(s Pa)]."""

Inner = tuple[float, float, float]
"""Shares by which the counterbalance valves at A and B are open [-], flow of the pump [m³/s]."""


@kernel
def middle_compliance(
    pressure: float, net: float, secant: float, oil: float, E: float, air: AirConstants
) -> float:
    """Return a chamber's compliance over dt in the middle of the step [m³/(s Pa)].

    Args:
        pressure: in the chamber at the start of the step [Pa].
        net: flow that compresses the oil then [m³/s].
        secant: of the orifice [m³/(s Pa)].
        oil: V / (E dt) without air [m³/(s Pa)].
        E: bulk modulus without air [Pa].
        air: the constants.
    """
    if air[0] == 0.0:
        return oil
    compliance = oil * (E / bulk_modulus(pressure, E, air))
    return oil * (E / bulk_modulus(pressure + 0.5 * net / (compliance + secant), E, air))


@kernel
def charge_supply(P_S: float, drawn: float, dt: float, supply: SupplyConstants) -> Charge:
    """Return charge and compliance of the supply line in a step; infinite for a constant P_S.

    A relief valve that opens during the step takes its backward Euler share, so that the pressure
    does not overshoot however small the line is.

    Args:
        P_S: supply pressure at the start of the step [Pa].
        drawn: flow to the cylinder then [m³/s].
        dt: step [s].
        supply: the constants.
    """
    line, pump, opens_at, gradient, _, _, _ = supply
    if line == 0.0:
        return 0.0, math.inf
    closed = pump - drawn
    compliance = supply_compliance(P_S, supply) / dt
    change = (closed - relief_flow(P_S, supply)) / (compliance + gradient)
    compliance = supply_compliance(P_S + 0.5 * change, supply) / dt
    above = P_S - opens_at
    if above <= 0.0 and above + closed / compliance <= 0.0:
        return closed, compliance
    share = implicit_share(gradient, gradient, compliance) if above > 0.0 else gradient
    return closed - gradient * above, compliance + share


@kernel
def draw(net: float, share: float, charge: Charge) -> tuple[float, float]:
    """Return a chamber's net flow and orifice share once P_S has been eliminated.

    Args:
        net: flow that compresses the oil in the chamber that the supply feeds [m³/s].
        share: of its orifice [m³/(s Pa)].
        charge: of the supply line.
    """
    net_S, capacity = charge
    part = share / (capacity + share)
    return net + part * net_S, share * (1.0 - part)


@kernel
def compress_oil(
    cylinder: Cylinder, z: float, P_S: float, constants: Constants, extension: ExtendedConstants
) -> tuple[Oil, Ports, Feeding]:
    """Return the step's oil by the midpoint rule, its ports, and what charges the supply line.

    Each port has one edge that passes oil, as in eqs. (4) to (6).

    Args:
        cylinder: at the start of the step.
        z: orifice state in the middle of the step [m].
        P_S: supply pressure at the start of the step [Pa].
        constants: in their groups.
        extension: those of the extensions.
    """
    (dt, _, per_E_dt, _), _, opening, _, (K, _, P_T, transition, signed), chambers, _, _ = constants
    (C_LA, C_LB), air, _, _, supply, lands = extension[:6]
    E, C_L, _, _, _, _, _ = chambers
    x, v, P_A, P_B, _, _ = cylinder

    orifice = (K, P_S, P_T, transition, signed)
    open_A, open_B = meter_openings(z, opening, lands)
    Q_A, secant_A, tangent_A = linearise_flow(open_A, P_A, orifice)
    Q_B, secant_B, tangent_B = linearise_flow(open_B, P_B, orifice)
    net_A, net_B = net_flows(Q_A, Q_B, v, C_L * (P_A - P_B), chambers)
    net_A, net_B = net_A - C_LA * (P_A - P_T), net_B - C_LB * (P_B - P_T)
    V_A, V_B = chamber_volumes(x + 0.5 * dt * v, chambers)
    C_A = middle_compliance(P_A, net_A, secant_A, V_A * per_E_dt, E, air)
    C_B = middle_compliance(P_B, net_B, secant_B, V_B * per_E_dt, E, air)

    # What relaxes is the pressure drop, so the supply's compliance is in series with the chamber's.
    supply, _ = behind_filter(P_S, supply[1], supply, extension[11])
    charge = charge_supply(P_S, Q_A if z > 0.0 else Q_B, dt, supply)
    series_A = C_A / (1.0 + C_A / charge[1]) if z > 0.0 else C_A
    series_B = C_B / (1.0 + C_B / charge[1]) if z < 0.0 else C_B
    share_A = implicit_share(secant_A, tangent_A, series_A)
    share_B = implicit_share(secant_B, tangent_B, series_B)
    fed_A, fed_B = (share_A, 0.0) if z > 0.0 else (0.0, share_B)
    if z > 0.0:
        net_A, share_A = draw(net_A, share_A, charge)
    else:
        net_B, share_B = draw(net_B, share_B, charge)

    c = 0.5 * C_L
    a = C_A + c + share_A + 0.5 * C_LA
    b = C_B + c + share_B + 0.5 * C_LB
    feeding = (charge[0], charge[1], fed_A, fed_B)
    return (a, b, c, net_A, net_B, 0.5), (secant_A, secant_B, Q_A, Q_B), feeding


@kernel
def compress_through_edges(
    cylinder: Cylinder,
    nu: float,
    P_S: float,
    inner: Inner,
    constants: Constants,
    extension: ExtendedConstants,
) -> tuple[Oil, Ports, Feeding]:
    """Act as `compress_oil`, for a valve both of whose edges at a port may pass oil.

    Args:
        cylinder: at the start of the step.
        nu: spool position in the middle of the step [m].
        P_S: supply pressure at the start of the step [Pa].
        inner: openings of counterbalance valves and flow of the pump in the middle of the step.
        constants: in their groups.
        extension: those of the extensions.
    """
    (dt, _, per_E_dt, _), _, _, _, (K, _, P_T, transition, signed), chambers, _, _ = constants
    (C_LA, C_LB), air, _, _, supply, lands, edges, margin, cushions, valve, pump = extension[:11]
    E, C_L, _, _, _, _, h = chambers
    x, v, P_A, P_B, _, _ = cylinder
    middle = x + 0.5 * dt * v

    orifice = (K, P_S, P_T, transition, signed)
    cushion_A, cushion_B = cushion_resistances(middle, h, cushions)
    resistances = (
        behind(cushion_A, inner[0], valve[0], valve[5]),
        behind(cushion_B, inner[1], valve[1], valve[5]),
    )
    PA, AT, PB, BT = flow_through_edges(
        nu, (P_A, P_B), resistances, margin[0], orifice, edges, lands
    )
    secant_A, secant_B = PA[1] + AT[1], PB[1] + BT[1]
    net_A, net_B = net_flows(PA[0] + AT[0], PB[0] + BT[0], v, C_L * (P_A - P_B), chambers)
    net_A, net_B = net_A - C_LA * (P_A - P_T), net_B - C_LB * (P_B - P_T)
    V_A, V_B = chamber_volumes(middle, chambers)
    C_A = middle_compliance(P_A, net_A, secant_A, V_A * per_E_dt, E, air)
    C_B = middle_compliance(P_B, net_B, secant_B, V_B * per_E_dt, E, air)

    given = inner[2] - pump[2] * (P_S - P_T)
    unit, _ = behind_filter(P_S, given, supply, extension[11])
    net_S, capacity = charge_supply(P_S, PA[0] + PB[0], dt, unit)
    capacity += 0.5 * pump[2]
    fed_A = implicit_share(PA[1], PA[2], C_A / (1.0 + C_A / capacity))
    fed_B = implicit_share(PB[1], PB[2], C_B / (1.0 + C_B / capacity))
    drained_A = implicit_share(AT[1], AT[2], C_A)
    drained_B = implicit_share(BT[1], BT[2], C_B)
    whole = capacity + fed_A + fed_B
    part_A, part_B = fed_A / whole, fed_B / whole

    c = 0.5 * C_L + part_A * fed_B
    a = C_A + 0.5 * (C_L + C_LA) + drained_A + fed_A * (1.0 - part_A)
    b = C_B + 0.5 * (C_L + C_LB) + drained_B + fed_B * (1.0 - part_B)
    oil = (a, b, c, net_A + part_A * net_S, net_B + part_B * net_S, 0.5)
    # Flows that a leaking edge passes on to the other one count by their size.
    ports = (secant_A, secant_B, abs(PA[0]) + abs(AT[0]), abs(PB[0]) + abs(BT[0]))
    return oil, ports, (net_S, capacity, fed_A, fed_B)


@kernel
def move_inner(
    inner: Inner,
    nu: float,
    pressures: tuple[float, float, float],
    ports: tuple[float, float],
    dt: float,
    constants: Constants,
    extension: ExtendedConstants,
) -> tuple[Inner, Inner]:
    """Return the openings of counterbalance valves and the pump's flow in middle and end of a step.

    Args:
        inner: at the start of the step.
        nu: spool position in the middle of the step [m].
        pressures: P_A, P_B and P_S that move them [Pa].
        ports: pressures at the valve's ports, of which the pump senses one [Pa].
        dt: step [s].
        constants: in their groups.
        extension: those of the extensions.
    """
    supply, edges, valve, pump = extension[4], extension[6], extension[9], extension[10]
    chambers = (pressures[0], pressures[1])
    middle, end = move_valves((inner[0], inner[1]), chambers, dt, valve)
    P_S, P_T = pressures[2], constants[4][2]
    sensed = sensed_pressure(nu, ports, P_T, edges)
    _, drop = behind_filter(P_S, inner[2] - pump[2] * (P_S - P_T), supply, extension[11])
    return (
        (middle[0], middle[1], swivel(inner[2], P_S + drop, sensed, 0.5 * dt, pump, supply)),
        (end[0], end[1], swivel(inner[2], P_S + drop, sensed, dt, pump, supply)),
    )


@kernel
def charged_pressure(P_S: float, feeding: Feeding, rises: tuple[float, float]) -> float:
    """Return the supply pressure at the end of a step [Pa].

    Args:
        P_S: at its start [Pa].
        feeding: of the step.
        rises: of P_A and P_B over the step [Pa].
    """
    net_S, capacity, fed_A, fed_B = feeding
    gained = net_S + fed_A * rises[0] + fed_B * rises[1]
    return P_S + gained / (capacity + fed_A + fed_B)
