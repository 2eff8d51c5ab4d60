"""The bench's solver with extensions: the step of `implicit_midpoint`, and what they add to it.

Every extension joins the same linearly implicit system, so each is as stable as the step itself:
leakage and spring by the midpoint rule, the bristles by their exact solution for the step's mean
velocity, the supply pressure as a fourth unknown that is eliminated before the other three. With
every extension off, a step gives the same bits as the plain one.
"""

import math

from hil_bench.plants.hydraulic_cylinder.model.bristles import (
    Bending,
    BristleConstants,
    bend,
    resist,
    settle,
    slip_rate,
)
from hil_bench.plants.hydraulic_cylinder.model.bulk_modulus import AirConstants, bulk_modulus
from hil_bench.plants.hydraulic_cylinder.model.cavitation import Oil, Response
from hil_bench.plants.hydraulic_cylinder.model.chamber import chamber_volumes, net_flows
from hil_bench.plants.hydraulic_cylinder.model.constants import Constants, unpack
from hil_bench.plants.hydraulic_cylinder.model.coupling import eliminate_pressures, velocity_change
from hil_bench.plants.hydraulic_cylinder.model.extended_constants import (
    SERIES,
    ExtendedConstants,
    unpack_extended,
)
from hil_bench.plants.hydraulic_cylinder.model.following import (
    NO_DRAG,
    implicit_share,
    linearise_drag,
)
from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import Cylinder, Spool, finish_step
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel
from hil_bench.plants.hydraulic_cylinder.model.lands import meter_openings
from hil_bench.plants.hydraulic_cylinder.model.load import find_point, series_force
from hil_bench.plants.hydraulic_cylinder.model.orifice import linearise_flow
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
from hil_bench.plants.hydraulic_cylinder.model.state_row import (
    EXTRA,
    POINT,
    STEPS,
    Seen,
    keep_extended,
    read_states,
)
from hil_bench.plants.hydraulic_cylinder.model.supply import (
    SupplyConstants,
    relief_flow,
    supply_compliance,
)

Charge = tuple[float, float]
"""(flow into the supply line at the start of the step, its compliance over dt and relief share)."""


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
    """Return what the supply line makes of a step; infinite compliance for a constant P_S.

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
) -> tuple[Oil, Ports, Charge, float]:
    """Return the step's oil by the midpoint rule, its ports, the supply's charge and what it feeds.

    Args:
        cylinder: at the start of the step.
        z: orifice state in the middle of the step [m].
        P_S: supply pressure at the start of the step [Pa].
        constants: in their groups.
        extension: those of the extensions.
    """
    (dt, _, per_E_dt, _), _, opening, _, (K, _, P_T, transition, signed), chambers, _, _ = constants
    (C_LA, C_LB), air, _, _, supply, lands = extension
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
    charge = charge_supply(P_S, Q_A if z > 0.0 else Q_B, dt, supply)
    series_A = C_A / (1.0 + C_A / charge[1]) if z > 0.0 else C_A
    series_B = C_B / (1.0 + C_B / charge[1]) if z < 0.0 else C_B
    share_A = implicit_share(secant_A, tangent_A, series_A)
    share_B = implicit_share(secant_B, tangent_B, series_B)
    fed = share_A if z > 0.0 else share_B
    if z > 0.0:
        net_A, share_A = draw(net_A, share_A, charge)
    else:
        net_B, share_B = draw(net_B, share_B, charge)

    c = 0.5 * C_L
    a = C_A + c + share_A + 0.5 * C_LA
    b = C_B + c + share_B + 0.5 * C_LB
    return (a, b, c, net_A, net_B, 0.5), (secant_A, secant_B, Q_A, Q_B), charge, fed


@kernel
def find_bending(
    drive: float,
    v: float,
    inertia: float,
    z_f: float,
    response: Response,
    constants: Constants,
    bristles: BristleConstants,
) -> Bending:
    """Return how the bristles bend at the velocity that the step has in its middle.

    Args:
        drive: force on the piston without friction, at the start of the step [N].
        v: piston velocity then [m/s].
        inertia: m / dt and the share of a spring [N s/m].
        z_f: bristle deflection at the start of the step [m].
        response: of the pressures.
        constants: in their groups.
        bristles: the constants.
    """
    dt, friction = constants[0][0], constants[6]
    bending = bend(slip_rate(v, friction, bristles), dt)
    held, slope = resist(z_f, bending, friction[2], dt, bristles)
    dv, _ = velocity_change(
        drive - held - slope * v, inertia + 0.5 * slope, 0.5, response, constants
    )
    return bend(slip_rate(v + 0.5 * dv, friction, bristles), dt)


@kernel
def try_extended(
    cylinder: Cylinder,
    spool: Spool,
    F_L: float,
    z_f: float,
    P_S: float,
    constants: Constants,
    extension: ExtendedConstants,
) -> tuple[Cylinder, float, float, float]:
    """Return the cylinder, z_f and P_S one step later, and what the velocity is off by.

    Args:
        cylinder: at the start of the step.
        spool: its way over the step.
        F_L: external load in the middle of the step, without the spring's [N].
        z_f: bristle deflection at the start of the step [m].
        P_S: supply pressure at the start of the step [Pa].
        constants: in their groups.
        extension: those of the extensions.
    """
    (dt, m, _, floor), _, opening, _, _, chambers, friction, _ = constants
    _, _, bristles, (_, spring, rest), _, _ = extension
    x, v, P_A, P_B, _, _ = cylinder
    z = orifice_state(0.5 * (spool[0] + spool[1]), opening)
    oil, ports, charge, fed = compress_oil(cylinder, z, P_S, constants, extension)

    load = F_L + spring * (x + 0.5 * dt * v - rest)
    drive = P_A * chambers[2] - P_B * chambers[3]
    inertia = m / dt + 0.25 * dt * spring
    if bristles[0] == 0.0:
        drag = linearise_drag(v, m / dt, friction)
        force = drive - drag[0] * v - load
        moved, error = finish_step(cylinder, force, inertia, drag, oil, constants)
    else:
        response = eliminate_pressures(oil, chambers)
        bending = find_bending(drive - load, v, inertia, z_f, response, constants, bristles)
        held, slope = resist(z_f, bending, friction[2], dt, bristles)
        force = drive - held - slope * v - load
        inertia += 0.5 * slope
        moved, error = finish_step(cylinder, force, inertia, NO_DRAG, oil, constants)
        limit = (friction[0] + friction[1]) / bristles[0]
        z_f = settle(z_f, 0.5 * (v + moved[1]), bending, limit)

    rises = (moved[2] - P_A, moved[3] - P_B)
    error += oil_error(rises, ports, spool, z, constants)
    P_S += (charge[0] + fed * (rises[0] if z > 0.0 else rises[1])) / (charge[1] + fed)
    return moved, z_f, floor if P_S < floor else P_S, error


@kernel
def advance_extended_midpoint(
    state: Floats, constants: Floats, u: float, F_L: float, steps: int
) -> Seen:
    """Move the state on by some steps of the linearly implicit midpoint rule, in place.

    Args:
        state: of a plant with extensions (`model.state_row`).
        constants: as `model.extended_constants.pack_extended` gives them.
        u: spool set-point [m].
        F_L: external load besides those of the options [N].
        steps: how many.

    Returns:
        What is seen after the last step.
    """
    groups, extension = unpack(constants), unpack_extended(constants)
    dt = groups[0][0]
    x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB, z_f, P_S = read_states(state)
    cylinder = (x, v, P_A, P_B, V_CA, V_CB)
    point, last = SERIES + int(state[POINT]), len(constants) - 2
    F_L += extension[3][0]
    extra = -steps
    for step in range(steps):
        nu_before = nu
        nu, nu_dot = move_spool(nu, nu_dot, u, groups[3])
        spool = (nu_before, nu)
        done, size = 0, PARTS
        while done < PARTS:
            extra += 1
            way = (place_between(spool, done), place_between(spool, done + size))
            middle = (state[STEPS] + step + (done + 0.5 * size) / PARTS) * dt
            reached = find_point(constants, point, last, middle)
            load = F_L + series_force(constants, reached, last, middle)
            moved, bent, supplied, error = try_extended(
                cylinder, way, load, z_f, P_S, shorten(groups, size), extension
            )
            if error > TOLERANCE and size > 1:
                size //= RATIO
            else:
                cylinder, z_f, P_S, point, done = moved, bent, supplied, reached, done + size
                size = largest_part(done, size)
    x, v, P_A, P_B, V_CA, V_CB = cylinder
    states = (x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB, z_f, P_S)
    state[EXTRA] += extra
    return keep_extended(state, states, steps, point, groups, extension[5])
