"""The paper's solver: forward Euler of all six states, each from the old values of all others."""

from hil_bench.plants.hydraulic_cylinder.model.cavitation import compress
from hil_bench.plants.hydraulic_cylinder.model.chamber import chamber_volumes, net_flows
from hil_bench.plants.hydraulic_cylinder.model.constants import unpack
from hil_bench.plants.hydraulic_cylinder.model.friction import friction_force
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel
from hil_bench.plants.hydraulic_cylinder.model.load import stop_force
from hil_bench.plants.hydraulic_cylinder.model.orifice import port_flow
from hil_bench.plants.hydraulic_cylinder.model.spool import orifice_state
from hil_bench.plants.hydraulic_cylinder.model.state_row import Seen, keep


@kernel
def advance_forward_euler(
    state: Floats, constants: Floats, u: float, F_L: float, steps: int
) -> Seen:
    """Move the state on by some steps of forward Euler, in place.

    Args:
        state: x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB.
        constants: as `model.constants.pack` gives them.
        u: spool set-point [m].
        F_L: external load [N].
        steps: how many.

    Returns:
        What is seen after the last step.
    """
    groups = unpack(constants)
    step, (stiffness, damping), opening, _, orifice, chambers, friction, stop = groups
    dt, m, _, floor = step
    E, C_L, A_A, A_B, _, _, _ = chambers
    x, v, P_A, P_B, nu, nu_dot = state[0], state[1], state[2], state[3], state[4], state[5]
    V_CA, V_CB = state[6], state[7]
    for _ in range(steps):
        z = orifice_state(nu, opening)
        Q_A, Q_B = port_flow(z, P_A, orifice), port_flow(-z, P_B, orifice)
        V_A, V_B = chamber_volumes(x, chambers)
        net_A, net_B = net_flows(Q_A, Q_B, v, C_L * (P_A - P_B), chambers)
        force = P_A * A_A - P_B * A_B - friction_force(v, friction) - F_L + stop_force(x, v, stop)
        acceleration = stiffness * (u - nu) - damping * nu_dot
        x, v = x + dt * v, v + dt * force / m
        P_A, V_CA = compress(P_A, V_CA, net_A, dt, dt * E / V_A, floor)
        P_B, V_CB = compress(P_B, V_CB, net_B, dt, dt * E / V_B, floor)
        nu, nu_dot = nu + dt * nu_dot, nu_dot + dt * acceleration
    return keep(state, (x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB), groups)
