"""The solver for references: the classical Runge-Kutta method of order four, of every state.

A step is cut into as many equal parts as stability asks for (`model.stability`). The
order is four between the points where the model is not smooth: edges of dead-zone and saturation,
a pressure drop that turns round, contact with an end stop, the cavitation floor. A step in which a
cavity opens or closes is made again in parts, so that the oil stays the same there, too.
"""

from hil_bench.plants.hydraulic_cylinder.model.cavitation import fill
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
from hil_bench.plants.hydraulic_cylinder.model.friction import friction_force, slip_rate
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel
from hil_bench.plants.hydraulic_cylinder.model.load import step_loads, stop_force
from hil_bench.plants.hydraulic_cylinder.model.spool import drive_spool
from hil_bench.plants.hydraulic_cylinder.model.state import (
    NO_VALVES,
    POINT,
    STEPS,
    Seen,
    States,
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

PARTS = 16
"""Parts of a step in which a cavity opens or closes: there the method is of order one only."""


@kernel
def shift(states: States, rates: States, dt: float) -> States:
    """Return the states after `dt` [s] at constant rates."""
    return (
        states[0] + dt * rates[0],
        states[1] + dt * rates[1],
        states[2] + dt * rates[2],
        states[3] + dt * rates[3],
        states[4] + dt * rates[4],
        states[5] + dt * rates[5],
        states[6] + dt * rates[6],
        states[7] + dt * rates[7],
        states[8] + dt * rates[8],
        states[9] + dt * rates[9],
    )


@kernel
def hold_pressures(states: States, constants: Constants, extension: ExtendedConstants) -> States:
    """Return states of the same oil, with no pressure below the floor and no cavity above it.

    Args:
        states: in which a step or a part of it ended.
        constants: in their groups.
        extension: those of the extensions.
    """
    x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB, z_f, P_S = states
    floor, chambers = constants[0][3], constants[5]
    if P_A < floor or P_B < floor or V_CA != 0.0 or V_CB != 0.0:
        V_A, V_B = chamber_volumes(x, chambers)
        E = bulk_modulus(floor, chambers[0], extension[1])
        P_A, V_CA = fill(P_A, V_CA, E / V_A, floor)
        P_B, V_CB = fill(P_B, V_CB, E / V_B, floor)
    P_S = floor if P_S < floor else P_S
    return x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB, z_f, P_S


@kernel
def oil_rates(
    pressure: float, cavity: float, net: float, stiffness: float, floor: float
) -> tuple[float, float]:
    """Return dP/dt [Pa/s] and d(cavity)/dt [m³/s] of a chamber.

    Args:
        pressure: in the chamber [Pa].
        cavity: in it [m³].
        net: flow that compresses the oil [m³/s].
        stiffness: E / V [Pa/m³].
        floor: cavitation floor [Pa].
    """
    if cavity > 0.0 or (pressure <= floor and net < 0.0):
        return 0.0, -net
    return stiffness * net, 0.0


@kernel
def friction_rates(
    v: float, z_f: float, constants: Constants, extension: ExtendedConstants
) -> tuple[float, float]:
    """Return the friction force [N] and dz_f/dt [m/s]: eq. (13), or the bristles' in its place.

    Args:
        v: piston velocity [m/s].
        z_f: bristle deflection [m].
        constants: in their groups.
        extension: those of the extensions.
    """
    friction, bristles = constants[6], extension[2]
    sigma_0, sigma_1 = bristles
    if sigma_0 == 0.0:
        return friction_force(v, friction), 0.0
    bending = v - slip_rate(v, friction, bristles) * z_f
    return sigma_0 * z_f + sigma_1 * bending + friction[2] * v, bending


@kernel
def supply_rate(P_S: float, drawn: float, supply: SupplyConstants) -> float:
    """Return dP_S/dt [Pa/s] where the supply is a unit, 0 where P_S is constant.

    Args:
        P_S: supply pressure [Pa].
        drawn: flow to the cylinder [m³/s].
        supply: the constants.
    """
    if supply[0] == 0.0:
        return 0.0
    return (supply[1] - drawn - relief_flow(P_S, supply)) / supply_compliance(P_S, supply)


@kernel
def state_rates(
    states: States, u: float, F_L: float, constants: Constants, extension: ExtendedConstants
) -> States:
    """Return the right-hand side of eqs. (3), (8), (9), (12) and of the extensions.

    Args:
        states: at which; a pressure below the cavitation floor counts as a cavity.
        u: spool set-point [m].
        F_L: external load but for the spring of the options [N].
        constants: in their groups.
        extension: those of the extensions.
    """
    (_, m, _, floor), spool, _, _, orifice, chambers, _, stop = constants
    (C_LA, C_LB), air, _, (_, spring, rest), supply = extension[:5]
    K, _, P_T, transition, signed = orifice
    E, C_L, A_A, A_B, _, _, _ = chambers
    x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB, z_f, P_S = hold_pressures(states, constants, extension)
    fed = (K, P_S, P_T, transition, signed)
    Q_A, Q_B, drawn = valve_flows(x, nu, (P_A, P_B), NO_VALVES, fed, constants, extension)
    net_A, net_B = net_flows(Q_A, Q_B, v, C_L * (P_A - P_B), chambers)
    net_A, net_B = net_A - C_LA * (P_A - P_T), net_B - C_LB * (P_B - P_T)
    V_A, V_B = chamber_volumes(x, chambers)
    f, bending = friction_rates(v, z_f, constants, extension)
    force = P_A * A_A - P_B * A_B - f - F_L - spring * (x - rest) + stop_force(x, v, stop)
    unit, _ = behind_filter(P_S, supply[1], supply, extension[11])
    rate_A, opening_A = oil_rates(P_A, V_CA, net_A, bulk_modulus(P_A, E, air) / V_A, floor)
    rate_B, opening_B = oil_rates(P_B, V_CB, net_B, bulk_modulus(P_B, E, air) / V_B, floor)
    return (
        v,
        force / m,
        rate_A,
        rate_B,
        nu_dot,
        drive_spool(nu, nu_dot, u, spool),
        opening_A,
        opening_B,
        bending,
        supply_rate(P_S, drawn, unit),
    )


@kernel
def step_runge_kutta(
    states: States,
    u: float,
    loads: tuple[float, float, float],
    dt: float,
    constants: Constants,
    extension: ExtendedConstants,
) -> States:
    """Return the states one step later.

    Args:
        states: at the start of the step.
        u: spool set-point [m].
        loads: external load but for the spring at start, middle and end of the step [N].
        dt: step [s].
        constants: in their groups.
        extension: those of the extensions.
    """
    k_1 = state_rates(states, u, loads[0], constants, extension)
    k_2 = state_rates(shift(states, k_1, 0.5 * dt), u, loads[1], constants, extension)
    k_3 = state_rates(shift(states, k_2, 0.5 * dt), u, loads[1], constants, extension)
    k_4 = state_rates(shift(states, k_3, dt), u, loads[2], constants, extension)
    end = shift(shift(states, k_1, dt / 6.0), k_2, dt / 3.0)
    end = shift(shift(end, k_3, dt / 3.0), k_4, dt / 6.0)
    return hold_pressures(end, constants, extension)


@kernel
def changes_phase(before: States, after: States) -> bool:
    """Return True if a cavity opens or closes between two states."""
    return (before[6] > 0.0) != (after[6] > 0.0) or (before[7] > 0.0) != (after[7] > 0.0)


@kernel
def advance_runge_kutta(state: Floats, constants: Floats, u: float, F_L: float, steps: int) -> Seen:
    """Move the state on by some steps of the classical Runge-Kutta method, in place.

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
    y, point, last = read_states(state), SERIES + int(state[POINT]), len(constants) - 2
    F_L += extension[3][0]
    for step in range(steps):
        done, size = 0, PARTS
        while done < PARTS:
            t, part = (state[STEPS] + step + done / PARTS) * dt, dt * (size / PARTS)
            reached, series = step_loads(constants, point, last, t, part)
            loads = (F_L + series[0], F_L + series[1], F_L + series[2])
            moved = step_runge_kutta(y, u, loads, part, groups, extension)
            if size > 1 and changes_phase(y, moved):
                size = 1
            else:
                y, point, done = moved, reached, done + size
    return keep_extended(state, y, steps, point, groups, extension)
