"""The paper's solver: forward Euler of every state from the old values of all others.

The bristles alone move by their exact solution for the old velocity: a step may be longer than the
time in which they slip.
"""

from hil_bench.plants.hydraulic_cylinder.model.cavitation import compress
from hil_bench.plants.hydraulic_cylinder.model.chamber import (
    bulk_modulus,
    chamber_volumes,
    net_flows,
)
from hil_bench.plants.hydraulic_cylinder.model.constants import (
    SERIES,
    Constants,
    ExtendedConstants,
    unpack,
    unpack_extended,
)
from hil_bench.plants.hydraulic_cylinder.model.friction import (
    bend,
    friction_force,
    resist,
    settle,
    slip_rate,
)
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel
from hil_bench.plants.hydraulic_cylinder.model.load import find_point, series_force, stop_force
from hil_bench.plants.hydraulic_cylinder.model.spool import drive_spool
from hil_bench.plants.hydraulic_cylinder.model.state import (
    NO_VALVES,
    POINT,
    STEPS,
    Seen,
    keep_extended,
    read_states,
    valve_flows,
)
from hil_bench.plants.hydraulic_cylinder.model.supply import (
    SupplyConstants,
    behind_filter,
    relief_flow,
    supply_compliance,
)

Filling = tuple[float, float, float, float]
"""(P_A, P_B, V_CA, V_CB)."""


@kernel
def compress_oil_explicit(
    x: float,
    v: float,
    filling: Filling,
    flows: tuple[float, float],
    constants: Constants,
    extension: ExtendedConstants,
) -> Filling:
    """Return P_A, P_B [Pa], V_CA and V_CB [m³] one step later.

    Args:
        x: piston position [m].
        v: piston velocity [m/s].
        filling: P_A, P_B, V_CA and V_CB.
        flows: Q_A and Q_B [m³/s].
        constants: in their groups.
        extension: those of the extensions.
    """
    (dt, _, _, floor), _, _, _, (_, _, P_T, _, _), chambers, _, _ = constants
    (C_LA, C_LB), air = extension[:2]
    E, C_L, _, _, _, _, _ = chambers
    P_A, P_B, V_CA, V_CB = filling
    V_A, V_B = chamber_volumes(x, chambers)
    net_A, net_B = net_flows(flows[0], flows[1], v, C_L * (P_A - P_B), chambers)
    net_A, net_B = net_A - C_LA * (P_A - P_T), net_B - C_LB * (P_B - P_T)
    gain_A, gain_B = dt * bulk_modulus(P_A, E, air) / V_A, dt * bulk_modulus(P_B, E, air) / V_B
    P_A, V_CA = compress(P_A, V_CA, net_A, dt, gain_A, floor)
    P_B, V_CB = compress(P_B, V_CB, net_B, dt, gain_B, floor)
    return P_A, P_B, V_CA, V_CB


@kernel
def rub(
    v: float, z_f: float, constants: Constants, extension: ExtendedConstants
) -> tuple[float, float]:
    """Return the friction force at the start of a step [N], and z_f one step later [m].

    Args:
        v: piston velocity [m/s].
        z_f: bristle deflection [m].
        constants: in their groups.
        extension: those of the extensions.
    """
    (dt, _, _, _), _, _, _, _, _, friction, _ = constants
    bristles = extension[2]
    if bristles[0] == 0.0:
        return friction_force(v, friction), z_f
    bending = bend(slip_rate(v, friction, bristles), dt)
    held, slope = resist(z_f, bending, friction[2], dt, bristles)
    limit = (friction[0] + friction[1]) / bristles[0]
    return held + slope * v, settle(z_f, v, bending, limit)


@kernel
def charge_explicit(P_S: float, drawn: float, dt: float, supply: SupplyConstants) -> float:
    """Return the supply pressure one step later [Pa].

    Args:
        P_S: supply pressure [Pa].
        drawn: flow to the cylinder [m³/s].
        dt: step [s].
        supply: the constants.
    """
    if supply[0] == 0.0:
        return P_S
    net = supply[1] - drawn - relief_flow(P_S, supply)
    return P_S + dt * net / supply_compliance(P_S, supply)


@kernel
def advance_forward_euler(
    state: Floats, constants: Floats, u: float, F_L: float, steps: int
) -> Seen:
    """Move the state on by some steps of forward Euler, in place.

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
    (dt, m, _, floor), spool, _, _, (K, _, P_T, width, signed), chambers, _, stop = groups
    _, _, _, (constant, spring, rest), supply = extension[:5]
    x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB, z_f, P_S = read_states(state)
    point, last = SERIES + int(state[POINT]), len(constants) - 2
    F_L += constant
    for step in range(steps):
        orifice = (K, P_S, P_T, width, signed)
        Q_A, Q_B, drawn = valve_flows(x, nu, (P_A, P_B), NO_VALVES, orifice, groups, extension)
        t = (state[STEPS] + step) * dt
        point = find_point(constants, point, last, t)
        load = F_L + series_force(constants, point, last, t) + spring * (x - rest)
        f, z_f = rub(v, z_f, groups, extension)
        force = P_A * chambers[2] - P_B * chambers[3] - f - load + stop_force(x, v, stop)
        unit, _ = behind_filter(P_S, supply[1], supply, extension[11])
        P_S = charge_explicit(P_S, drawn, dt, unit)
        P_S = floor if P_S < floor else P_S
        P_A, P_B, V_CA, V_CB = compress_oil_explicit(
            x, v, (P_A, P_B, V_CA, V_CB), (Q_A, Q_B), groups, extension
        )
        x, v = x + dt * v, v + dt * force / m
        acceleration = drive_spool(nu, nu_dot, u, spool)
        nu, nu_dot = nu + dt * nu_dot, nu_dot + dt * acceleration
    states = (x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB, z_f, P_S)
    return keep_extended(state, states, steps, point, groups, extension)
