"""The solver for references: the classical Runge-Kutta method of order four, of every state.

A step is cut into as many equal parts as stability asks for (`hil_bench.plant.stability`). The
order is four between the points where the model is not smooth: edges of dead-zone and saturation,
a pressure drop that turns round, contact with an end stop, the cavitation floor.
"""

from hil_bench.plant.bristles import slip_rate
from hil_bench.plant.bulk_modulus import bulk_modulus
from hil_bench.plant.chamber import chamber_volumes, net_flows
from hil_bench.plant.constants import Constants, unpack
from hil_bench.plant.extended_constants import SERIES, ExtendedConstants, unpack_extended
from hil_bench.plant.friction import friction_force
from hil_bench.plant.kernel import Floats, kernel
from hil_bench.plant.load import step_loads, stop_force
from hil_bench.plant.orifice import port_flow
from hil_bench.plant.spool import orifice_state
from hil_bench.plant.state_row import Seen, States, keep_extended, read_states
from hil_bench.plant.supply import SupplyConstants, relief_flow, supply_compliance


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
    )


@kernel
def hold_pressures(states: States, floor: float) -> States:
    """Return the states with no pressure below the cavitation floor [Pa]."""
    x, v, P_A, P_B, nu, nu_dot, z_f, P_S = states
    P_A = floor if P_A < floor else P_A
    P_B = floor if P_B < floor else P_B
    P_S = floor if P_S < floor else P_S
    return x, v, P_A, P_B, nu, nu_dot, z_f, P_S


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
        states: at which; pressures below the cavitation floor count as at the floor.
        u: spool set-point [m].
        F_L: external load but for the spring of the options [N].
        constants: in their groups.
        extension: those of the extensions.
    """
    (_, m, _, floor), spool, opening, _, orifice, chambers, _, stop = constants
    (C_LA, C_LB), air, _, (_, spring, rest), supply = extension
    K, _, P_T, transition, signed = orifice
    E, C_L, A_A, A_B, _, _, _ = chambers
    x, v, P_A, P_B, nu, nu_dot, z_f, P_S = hold_pressures(states, floor)
    z = orifice_state(nu, opening)
    fed = (K, P_S, P_T, transition, signed)
    Q_A, Q_B = port_flow(z, P_A, fed), port_flow(-z, P_B, fed)
    net_A, net_B = net_flows(Q_A, Q_B, v, C_L * (P_A - P_B), chambers)
    net_A, net_B = net_A - C_LA * (P_A - P_T), net_B - C_LB * (P_B - P_T)
    V_A, V_B = chamber_volumes(x, chambers)
    f, bending = friction_rates(v, z_f, constants, extension)
    force = P_A * A_A - P_B * A_B - f - F_L - spring * (x - rest) + stop_force(x, v, stop)
    return (
        v,
        force / m,
        0.0 if P_A <= floor and net_A < 0.0 else bulk_modulus(P_A, E, air) / V_A * net_A,
        0.0 if P_B <= floor and net_B < 0.0 else bulk_modulus(P_B, E, air) / V_B * net_B,
        nu_dot,
        spool[0] * (u - nu) - spool[1] * nu_dot,
        bending,
        supply_rate(P_S, Q_A if z > 0.0 else Q_B, supply),
    )


@kernel
def advance_runge_kutta(state: Floats, constants: Floats, u: float, F_L: float, steps: int) -> Seen:
    """Move the state on by some steps of the classical Runge-Kutta method, in place.

    Args:
        state: x, v, P_A, P_B, nu, nu_dot, steps since time 0, z_f, P_S, point of the load series.
        constants: as `hil_bench.plant.extended_constants.pack_extended` gives them.
        u: spool set-point [m].
        F_L: external load besides those of the options [N].
        steps: how many.

    Returns:
        What is seen after the last step.
    """
    groups, extension = unpack(constants), unpack_extended(constants)
    dt, _, _, floor = groups[0]
    y, point, last = read_states(state), SERIES + int(state[9]), len(constants) - 2
    F_L += extension[3][0]
    for step in range(steps):
        point, series = step_loads(constants, point, last, (state[6] + step) * dt, dt)
        load_1, load_2, load_3 = F_L + series[0], F_L + series[1], F_L + series[2]
        k_1 = state_rates(y, u, load_1, groups, extension)
        k_2 = state_rates(shift(y, k_1, 0.5 * dt), u, load_2, groups, extension)
        k_3 = state_rates(shift(y, k_2, 0.5 * dt), u, load_2, groups, extension)
        k_4 = state_rates(shift(y, k_3, dt), u, load_3, groups, extension)
        y = shift(shift(y, k_1, dt / 6.0), k_2, dt / 3.0)
        y = hold_pressures(shift(shift(y, k_3, dt / 3.0), k_4, dt / 6.0), floor)
    return keep_extended(state, y, steps, point, groups)
