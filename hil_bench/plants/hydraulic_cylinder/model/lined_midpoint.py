"""The bench's solver with lines: the step of `extended_midpoint`, with waves at a port or both.

For the step of the cylinder a line is a resistance Z + R / 2 to the pressure c of the wave that
arrives, which stays as it is over the step. The valve's end is solved for itself; the supply
pressure joins both. Ports without a line are as in `extended_oil.compress_through_edges`.
"""

from hil_bench.plants.hydraulic_cylinder.model.cavitation import Oil
from hil_bench.plants.hydraulic_cylinder.model.chamber import chamber_volumes, net_flows
from hil_bench.plants.hydraulic_cylinder.model.constants import (
    SERIES,
    Constants,
    ExtendedConstants,
    unpack,
    unpack_extended,
    unpack_lines,
)
from hil_bench.plants.hydraulic_cylinder.model.extended_midpoint import Others, move_piston
from hil_bench.plants.hydraulic_cylinder.model.extended_oil import (
    Feeding,
    charge_supply,
    charged_pressure,
    middle_compliance,
    move_inner,
)
from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import Cylinder, Spool
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel
from hil_bench.plants.hydraulic_cylinder.model.load import find_point, series_force
from hil_bench.plants.hydraulic_cylinder.model.orifice import (
    OrificeConstants,
    behind,
    cushion_resistances,
    edge_openings,
    flow_from_supply,
    flow_to_tank,
)
from hil_bench.plants.hydraulic_cylinder.model.parts import (
    PARTS,
    RATIO,
    TOLERANCE,
    Ports,
    largest_part,
    oil_error,
    place_between,
    shorten,
)
from hil_bench.plants.hydraulic_cylinder.model.spool import move_spool, orifice_state
from hil_bench.plants.hydraulic_cylinder.model.state import (
    EXTRA,
    INNER,
    LINES,
    POINT,
    STEPS,
    SUPPLY,
    Seen,
    States,
    filter_drop,
    read_states,
    write_states,
)
from hil_bench.plants.hydraulic_cylinder.model.stepping import implicit_share
from hil_bench.plants.hydraulic_cylinder.model.supply import behind_filter
from hil_bench.plants.hydraulic_cylinder.model.waves import (
    CAVITY,
    PRESSURE,
    QUEUE,
    SHOWN,
    LineConstants,
    Side,
    arrive,
    between_steps,
    cylinder_end,
    depart,
    valve_end,
)

Port = tuple[float, float, float, float, float, float, float, float, float, float, float]
"""A port in a step.

Flow into the chamber; secant and tangent of the edge that feeds it; secant and tangent of what else
joins it, the edge to the tank or the line; flow from the supply and its slope by P_S through the
line; flow into the line at the valve and its slope by P_S; pressure at the valve; cavity there.
"""

Ends = tuple[float, float, float, float]
"""Pressures at the valve's ends of the lines at A and at B [Pa], and the cavities there [m³]."""

Shares = tuple[float, float, float, float]
"""Shares of the lines at A and at B in the rise of the chamber, then in that of P_S [m³/(s Pa)]."""

Groups = tuple[Constants, ExtendedConstants, tuple[LineConstants, LineConstants]]
"""All constants: the paper's, those of the extensions and those of the lines."""

Means = tuple[float, float, float, float]
"""Mean flows over a step into line A at valve and cylinder, and likewise into line B [m³/s]."""


@kernel
def direct_port(
    pressure: float,
    openings: tuple[float, float],
    resistance: float,
    margin: float,
    orifice: OrificeConstants,
) -> Port:
    """Return a port whose edges open into the chamber.

    Args:
        pressure: in the chamber [Pa].
        openings: of the edges from the supply and to the tank [m].
        resistance: for oil that leaves the chamber [1/m].
        margin: of a pressure compensator [Pa]; infinite for none.
        orifice: the constants.
    """
    feed, secant_fed, tangent_fed = flow_from_supply(
        openings[0], pressure, resistance, margin, orifice
    )
    drain, secant, tangent = flow_to_tank(openings[1], pressure, resistance, orifice)
    flow = feed + drain
    return flow, secant_fed, tangent_fed, secant, tangent, feed, 0.0, 0.0, 0.0, pressure, 0.0


@kernel
def lined_port(
    pressure: float,
    near: float,
    side: Side,
    openings: tuple[float, float],
    resistance: float,
    limits: tuple[float, float, float],
    orifice: OrificeConstants,
) -> Port:
    """Return a port with a line between its edges and the chamber.

    Args:
        pressure: in the chamber [Pa].
        near: the pressure at the valve's end in the step before [Pa].
        side: the line.
        openings: of the edges from the supply and to the tank [m].
        resistance: for oil that leaves the chamber [1/m].
        limits: margin of a pressure compensator, lowest pressure [Pa] and step [s].
        orifice: the constants.
    """
    margin, floor, dt = limits
    p, entering, feed, slope, slope_fed, cavity = valve_end(
        near, side, openings, margin, floor, dt, orifice
    )
    flow, secant, tangent = cylinder_end(pressure, side, resistance / orifice[0])
    return flow, 0.0, 0.0, secant, tangent, feed, slope_fed, entering, slope, p, cavity


@kernel
def find_ports(
    place: tuple[float, float],
    pressures: tuple[float, float],
    P_S: float,
    ends: Ends,
    sides: tuple[Side, Side],
    shares: tuple[float, float],
    groups: Groups,
) -> tuple[Port, Port]:
    """Return both ports.

    Args:
        place: positions of piston and spool [m].
        pressures: P_A and P_B [Pa].
        P_S: supply pressure [Pa].
        ends: of the lines at the valve, in the step before.
        sides: the lines.
        shares: by which the counterbalance valves are open.
        groups: the constants.
    """
    constants, extension, lines = groups
    (dt, _, _, floor), (K, _, P_T, transition, signed) = constants[0], constants[4]
    lands, edges, (margin,), cushions, valve = extension[5:10]
    orifice, limits = (K, P_S, P_T, transition, signed), (margin, floor, dt)
    cushion_A, cushion_B = cushion_resistances(place[0], constants[5][6], cushions)
    resistance_A = behind(cushion_A, shares[0], valve[0], valve[5])
    resistance_B = behind(cushion_B, shares[1], valve[1], valve[5])
    PA, AT, PB, BT = edge_openings(place[1], edges, lands)
    if lines[0][0] == 0.0:
        A = direct_port(pressures[0], (PA, AT), resistance_A, margin, orifice)
    else:
        A = lined_port(pressures[0], ends[0], sides[0], (PA, AT), resistance_A, limits, orifice)
    if lines[1][0] == 0.0:
        B = direct_port(pressures[1], (PB, BT), resistance_B, margin, orifice)
    else:
        B = lined_port(pressures[1], ends[1], sides[1], (PB, BT), resistance_B, limits, orifice)
    return A, B


@kernel
def bent(secant: float, tangent: float) -> float:
    """Return the secant of a flow that bends with its drop, and 0 of a straight one."""
    return secant if tangent < secant else 0.0


@kernel
def compress_between(
    cylinder: Cylinder,
    P_S: float,
    pump_flow: float,
    ports: tuple[Port, Port],
    constants: Constants,
    extension: ExtendedConstants,
) -> tuple[Oil, Ports, Feeding, Shares]:
    """Act as `extended_oil.compress_through_edges`, and return the shares of the lines too.

    Args:
        cylinder: at the start of the step.
        P_S: supply pressure then [Pa].
        pump_flow: in the middle of the step [m³/s].
        ports: of the step.
        constants: in their groups.
        extension: those of the extensions.
    """
    (dt, _, per_E_dt, _), _, _, _, (_, _, P_T, _, _), chambers, _, _ = constants
    (C_LA, C_LB), air, _, _, supply = extension[:5]
    pump = extension[10]
    E, C_L, _, _, _, _, _ = chambers
    x, v, P_A, P_B, _, _ = cylinder
    A, B = ports

    secant_A, secant_B = A[1] + bent(A[3], A[4]), B[1] + bent(B[3], B[4])
    net_A, net_B = net_flows(A[0], B[0], v, C_L * (P_A - P_B), chambers)
    net_A, net_B = net_A - C_LA * (P_A - P_T), net_B - C_LB * (P_B - P_T)
    V_A, V_B = chamber_volumes(x + 0.5 * dt * v, chambers)
    C_A = middle_compliance(P_A, net_A, A[1] + A[3], V_A * per_E_dt, E, air)
    C_B = middle_compliance(P_B, net_B, B[1] + B[3], V_B * per_E_dt, E, air)

    given = pump_flow - pump[2] * (P_S - P_T)
    unit, _ = behind_filter(P_S, given, supply, extension[11])
    net_S, capacity = charge_supply(P_S, A[5] + B[5], dt, unit)
    capacity += 0.5 * pump[2]
    fed_A = implicit_share(A[1], A[2], C_A / (1.0 + C_A / capacity))
    fed_B = implicit_share(B[1], B[2], C_B / (1.0 + C_B / capacity))
    joined_A = implicit_share(A[3], A[4], C_A)
    joined_B = implicit_share(B[3], B[4], C_B)
    drawn_A = implicit_share(A[6], A[6], capacity)
    drawn_B = implicit_share(B[6], B[6], capacity)
    capacity += drawn_A + drawn_B
    whole = capacity + fed_A + fed_B
    part_A, part_B = fed_A / whole, fed_B / whole

    c = 0.5 * C_L + part_A * fed_B
    a = C_A + 0.5 * (C_L + C_LA) + joined_A + fed_A * (1.0 - part_A)
    b = C_B + 0.5 * (C_L + C_LB) + joined_B + fed_B * (1.0 - part_B)
    oil = (a, b, c, net_A + part_A * net_S, net_B + part_B * net_S, 0.5)
    seen = (secant_A, secant_B, abs(A[0]), abs(B[0]))
    entering_A = drawn_A * (A[8] / A[6]) if A[6] > 0.0 else 0.0
    entering_B = drawn_B * (B[8] / B[6]) if B[6] > 0.0 else 0.0
    shares = (joined_A, joined_B, entering_A, entering_B)
    return oil, seen, (net_S, capacity, fed_A, fed_B), shares


@kernel
def try_lined(
    cylinder: Cylinder,
    spool: Spool,
    F_L: float,
    others: Others,
    ends: Ends,
    sides: tuple[Side, Side],
    groups: Groups,
) -> tuple[Cylinder, Others, Ends, Means, float]:
    """Return all one step later, the mean flows into the lines, and what the velocity is off by.

    Args:
        cylinder: at the start of the step.
        spool: its way over the step.
        F_L: external load in the middle of the step, without the spring's [N].
        others: bristles, supply and components at the start of the step.
        ends: of the lines at the valve, in the step before.
        sides: the lines.
        groups: the constants.
    """
    constants, extension, lines = groups
    (dt, _, _, floor), _, opening, _, _, _, _, _ = constants
    x, v, P_A, P_B, _, _ = cylinder
    z_f, P_S, inner = others
    nu = 0.5 * (spool[0] + spool[1])
    at_valve = (ends[0], ends[1])
    middle, _ = move_inner(inner, nu, (P_A, P_B, P_S), at_valve, dt, constants, extension)
    ports = find_ports(
        (x + 0.5 * dt * v, nu),
        (P_A, P_B),
        P_S,
        ends,
        (with_cavity(sides[0], ends[2]), with_cavity(sides[1], ends[3])),
        (middle[0], middle[1]),
        groups,
    )
    oil, seen, feeding, shares = compress_between(
        cylinder, P_S, middle[2], ports, constants, extension
    )
    moved, z_f, error = move_piston(cylinder, F_L, z_f, oil, constants, extension)

    rises = (moved[2] - P_A, moved[3] - P_B)
    error += oil_error(rises, seen, spool, orifice_state(nu, opening), constants)
    charged = charged_pressure(P_S, feeding, rises)
    A, B = ports
    means = (
        A[7] + shares[2] * (charged - P_S),
        shares[0] * rises[0] - A[0],
        B[7] + shares[3] * (charged - P_S),
        shares[1] * rises[1] - B[0],
    )
    average = (P_A + 0.5 * rises[0], P_B + 0.5 * rises[1], 0.5 * (P_S + charged))
    ends = (A[9], B[9], A[10], B[10])
    at_valve = (
        A[9] if lines[0][0] > 0.0 else average[0],
        B[9] if lines[1][0] > 0.0 else average[1],
    )
    _, inner = move_inner(inner, nu, average, at_valve, dt, constants, extension)
    return moved, (z_f, floor if charged < floor else charged, inner), ends, means, error


@kernel
def with_cavity(side: Side, cavity: float) -> Side:
    """Return a line with another cavity at the valve's end [m³]."""
    return side[0], side[1], side[2], side[3], cavity


@kernel
def keep_lined(
    row: Floats,
    states: States,
    steps: int,
    point: int,
    groups: Groups,
) -> Seen:
    """Write the states of a plant with lines back, and return what is seen of them.

    The flows are those at the cylinder. Arguments as `state_row.keep_extended`, but for the
    constants.
    """
    write_states(row, states, steps, point)
    x, v, P_A, P_B, nu, _, _, _, _, _ = states
    A, B = ports_now(row, groups)
    row[LINES + SHOWN], row[LINES + SHOWN + 1] = A[9], B[9]
    return x, v, P_A, P_B, nu, orifice_state(nu, groups[0][2]), A[0], B[0]


@kernel
def ports_now(row: Floats, groups: Groups) -> tuple[Port, Port]:
    """Return both ports in the present state of a row.

    Args:
        row: of states.
        groups: the constants.
    """
    lines = groups[2]
    A_next, B_next = arrive_both(row, lines)
    sides = between_steps(row, LINES, 0, A_next), between_steps(row, LINES, 1, B_next)
    ends = (row[LINES + PRESSURE], row[LINES + PRESSURE + 1], 0.0, 0.0)
    shares = (row[INNER], row[INNER + 1])
    return find_ports((row[0], row[4]), (row[2], row[3]), row[SUPPLY], ends, sides, shares, groups)


@kernel
def see_lined_supply(row: Floats, constants: Floats) -> tuple[float, float]:
    """Act as `state_row.see_supply`, for a plant with lines."""
    groups = unpack(constants), unpack_extended(constants), unpack_lines(constants)
    A, B = ports_now(row, groups)
    return A[5] + B[5], filter_drop(row, groups[0], groups[1])


@kernel
def arrive_both(row: Floats, lines: tuple[LineConstants, LineConstants]) -> tuple[Side, Side]:
    """Return both lines at the start of a step."""
    first = LINES + QUEUE
    return (
        arrive(row, LINES, 0, first, lines[0]),
        arrive(row, LINES, 1, first + 2 * int(lines[0][0]), lines[1]),
    )


@kernel
def add_share(sums: Means, means: Means, share: float) -> Means:
    """Return the sums of flows with those of a part that is a share of the step."""
    return (
        sums[0] + share * means[0],
        sums[1] + share * means[1],
        sums[2] + share * means[2],
        sums[3] + share * means[3],
    )


@kernel
def advance_lined_midpoint(
    state: Floats, constants: Floats, u: float, F_L: float, steps: int
) -> Seen:
    """Move the state on by some steps of the linearly implicit midpoint rule, in place.

    Args:
        state: of a plant with lines (`model.state_row`, `model.waves`).
        constants: as `model.extended_constants.pack_extended` gives them.
        u: spool set-point [m].
        F_L: external load besides those of the options [N].
        steps: how many.

    Returns:
        What is seen after the last step.
    """
    paper, extension = unpack(constants), unpack_extended(constants)
    lines = unpack_lines(constants)
    dt, second = paper[0][0], LINES + QUEUE + 2 * int(lines[0][0])
    x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB, z_f, P_S = read_states(state)
    cylinder = (x, v, P_A, P_B, V_CA, V_CB)
    others = (z_f, P_S, (state[INNER], state[INNER + 1], state[INNER + 2]))
    at = LINES + PRESSURE
    ends = (state[at], state[at + 1], state[LINES + CAVITY], state[LINES + CAVITY + 1])
    point, last = SERIES + int(state[POINT]), len(constants) - 2
    F_L += extension[3][0]
    extra = -steps
    for step in range(steps):
        nu_before = nu
        nu, nu_dot = move_spool(nu, nu_dot, u, paper[3])
        spool = (nu_before, nu)
        sides = arrive_both(state, lines)
        flows = (0.0, 0.0, 0.0, 0.0)
        done, size = 0, PARTS
        while done < PARTS:
            extra += 1
            way = (place_between(spool, done), place_between(spool, done + size))
            middle = (state[STEPS] + step + (done + 0.5 * size) / PARTS) * dt
            reached = find_point(constants, point, last, middle)
            load = F_L + series_force(constants, reached, last, middle)
            moved, reached_others, reached_ends, means, error = try_lined(
                cylinder,
                way,
                load,
                others,
                ends,
                sides,
                (shorten(paper, size), extension, lines),
            )
            if error > TOLERANCE and size > 1:
                size //= RATIO
            else:
                flows = add_share(flows, means, size / PARTS)
                cylinder, others, ends, point = moved, reached_others, reached_ends, reached
                done += size
                size = largest_part(done, size)
        depart(state, LINES, 0, LINES + QUEUE, (flows[0], flows[1]), lines[0])
        depart(state, LINES, 1, second, (flows[2], flows[3]), lines[1])
    x, v, P_A, P_B, V_CA, V_CB = cylinder
    z_f, P_S, inner = others
    state[INNER], state[INNER + 1], state[INNER + 2] = inner
    state[at], state[at + 1], state[LINES + CAVITY], state[LINES + CAVITY + 1] = ends
    states = (x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB, z_f, P_S)
    state[EXTRA] += extra
    return keep_lined(state, states, steps, point, (paper, extension, lines))
