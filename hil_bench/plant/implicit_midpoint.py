"""The bench's solver: the spool exactly, the cylinder by a linearly implicit midpoint step.

One step solves (I - W) dy = dt f(y) for y = (P_A, P_B, v), with f taken at the middle of the step
in spool and piston position. W = dt J / 2 makes that a Rosenbrock step of order 2 (gamma = 1/2). On
the diagonal, W grows beyond that by terms of order dt² where an orifice or the friction curve is
stiff, up to the backward Euler step on the secant: so nothing rings there and the order stays
(`docs/decisions/0001-plant-and-solver.md`). Where one step resolves the friction curve, its mean
over the step then takes the place of its tangent: the curve bends so much while the piston breaks
away or comes to rest that the tangent made most of the error (`docs/solvers.md`).
"""

import math

from hil_bench.plant.cavitation import Oil, Response, hold, share_out
from hil_bench.plant.chamber import ChamberConstants, chamber_volumes, net_flows
from hil_bench.plant.constants import Constants, unpack
from hil_bench.plant.friction import FrictionConstants, linearise_friction
from hil_bench.plant.kernel import Floats, kernel
from hil_bench.plant.load import stop_velocity_change
from hil_bench.plant.orifice import linearise_flow
from hil_bench.plant.spool import move_spool, orifice_state
from hil_bench.plant.state_row import Seen, keep

Cylinder = tuple[float, float, float, float, float, float]
"""(x, v, P_A, P_B, V_CA, V_CB)."""

Drag = tuple[float, float, float]
"""What the friction curve is at the start of a step: (secant, tangent, implicit share) [N s/m]."""

NO_DRAG: Drag = (math.inf, 0.0, 0.0)
"""In place of the friction curve where bristles hold the piston."""


@kernel
def implicit_share(secant: float, tangent: float, inertia: float) -> float:
    """Return how much a damping element adds to the inertia it works on, in one step.

    tangent / 2 is the midpoint rule's share, secant that of a backward Euler step on the secant.
    Between them, secant² / (8 inertia) brings the step close to the exact solution of both
    dy/dt = -y and dy/dt = -sqrt(y), and keeps it from overshooting.

    Args:
        secant: flow / drop or force / velocity.
        tangent: d flow / d drop or d force / d velocity.
        inertia: V / (E dt) or m / dt, in the unit of the two.
    """
    share = 0.5 * tangent + 0.125 * secant * secant / inertia
    if share > secant:
        return secant
    least = -0.25 * inertia
    return least if share < least else share


@kernel
def eliminate_pressures(oil: Oil, chambers: ChamberConstants) -> Response:
    """Return how both pressures respond to the step's velocity change, with no cavity at its end.

    Args:
        oil: of the step.
        chambers: the constants.
    """
    a, b, c, net_A, net_B = oil
    _, _, A_A, A_B, _, _, _ = chambers
    per_det = 1.0 / (a * b - c * c)
    return (
        (b * net_A + c * net_B) * per_det,
        0.5 * (b * A_A - c * A_B) * per_det,
        (c * net_A + a * net_B) * per_det,
        0.5 * (c * A_A - a * A_B) * per_det,
    )


@kernel
def pressure_rises(response: Response, dv: float) -> tuple[float, float]:
    """Return by how much both pressures rise over a step with this velocity change [Pa]."""
    dP_A, fall_A, dP_B, fall_B = response
    return dP_A - fall_A * dv, dP_B - fall_B * dv


@kernel
def velocity_change(
    force: float, inertia: float, response: Response, chambers: ChamberConstants
) -> tuple[float, float]:
    """Return the velocity change over the step [m/s] and the force it takes [N s/m].

    Args:
        force: on the piston at the start of the step [N].
        inertia: m / dt and what damps the piston [N s/m].
        response: of the pressures.
        chambers: the constants.
    """
    _, _, A_A, A_B, _, _, _ = chambers
    dP_A, fall_A, dP_B, fall_B = response
    resistance = inertia + 0.5 * (A_A * fall_A - A_B * fall_B)
    return (force + 0.5 * (A_A * dP_A - A_B * dP_B)) / resistance, resistance


@kernel
def linearise_drag(v: float, inertia: float, friction: FrictionConstants) -> Drag:
    """Return secant, tangent and implicit share of the friction curve, eq. (13) [N s/m].

    Args:
        v: piston velocity at the start of the step [m/s].
        inertia: m / dt [N s/m].
        friction: the constants.
    """
    secant, tangent = linearise_friction(v, friction)
    return secant, tangent, implicit_share(secant, tangent, inertia)


@kernel
def follow_friction(
    dv: float,
    v: float,
    resistance: float,
    drag: Drag,
    inertia: float,
    friction: FrictionConstants,
) -> float:
    """Return the velocity change over the step with the friction curve's mean along it [m/s].

    The mean from v to v + dv is that of the cubic through both ends with their tangents; one Newton
    step brings dv there. Where the secant exceeds the inertia, a step is too long to follow the
    curve, and dv stays: so no piston turns round further than without this.

    Args:
        dv: velocity change with the friction as linearised at the start of the step [m/s].
        v: piston velocity at the start of the step [m/s].
        resistance: force per velocity change of everything [N s/m].
        drag: the friction curve at the start of the step.
        inertia: m / dt [N s/m].
        friction: the constants.
    """
    secant, tangent, share = drag
    if secant > inertia:
        return dv
    end = v + dv
    secant_end, tangent_end = linearise_friction(end, friction)
    mean = 0.5 * (secant * v + secant_end * end) - (tangent_end - tangent) * dv / 12.0
    excess = mean - secant * v - share * dv
    slope = 0.5 * tangent_end if tangent_end > 0.0 else 0.0
    return dv - excess / (resistance - share + slope)


@kernel
def finish_step(
    cylinder: Cylinder,
    force: float,
    inertia: float,
    drag: Drag,
    oil: Oil,
    constants: Constants,
) -> Cylinder:
    """Return the cylinder one step later, with the cavitation floor and the end stops in force.

    Args:
        cylinder: at the start of the step.
        force: on the piston at the start of the step [N].
        inertia: m / dt and what damps the piston besides the friction curve [N s/m].
        drag: the friction curve at the start of the step; `NO_DRAG` for none.
        oil: of the step, before any cavity is filled.
        constants: in their groups.
    """
    (dt, m, _, floor), _, _, _, _, chambers, friction, stop = constants
    inertia += drag[2]
    x, v, P_A, P_B, V_CA, V_CB = cylinder
    response = eliminate_pressures(oil, chambers)
    dv, resistance = velocity_change(force, inertia, response, chambers)
    is_open = V_CA > 0.0 or V_CB > 0.0
    if is_open:
        a, b, c, net_A, net_B = oil
        oil = (a, b, c, net_A - V_CA / dt, net_B - V_CB / dt)
        response = eliminate_pressures(oil, chambers)
        dv, resistance = velocity_change(force, inertia, response, chambers)
    rise_A, rise_B = pressure_rises(response, dv)
    if P_A + rise_A < floor or P_B + rise_B < floor:
        held = hold(floor - P_A, floor - P_B, force, inertia, oil, chambers)
        dv, resistance = velocity_change(force, inertia, held, chambers)
    dv = follow_friction(dv, v, resistance, drag, m / dt, friction)
    dv = stop_velocity_change(dv, resistance, x, v, dt, stop)
    rise_A, rise_B = pressure_rises(response, dv)
    x, v = x + dt * (v + 0.5 * dv), v + dv
    if P_A + rise_A < floor or P_B + rise_B < floor:
        rise_A, rise_B, void_A, void_B = share_out(floor - P_A, floor - P_B, dv, oil, chambers)
        P_A = floor if void_A > 0.0 else P_A + rise_A
        P_B = floor if void_B > 0.0 else P_B + rise_B
        return x, v, P_A, P_B, dt * void_A, dt * void_B
    return x, v, P_A + rise_A, P_B + rise_B, 0.0, 0.0


@kernel
def move_cylinder(cylinder: Cylinder, z: float, F_L: float, constants: Constants) -> Cylinder:
    """Return the cylinder one step later.

    Args:
        cylinder: at the start of the step.
        z: orifice state in the middle of the step [m].
        F_L: external load [N].
        constants: in their groups.
    """
    (dt, m, per_E_dt, _), _, _, _, orifice, chambers, friction, _ = constants
    _, C_L, A_A, A_B, _, _, _ = chambers
    x, v, P_A, P_B, _, _ = cylinder

    Q_A, secant_A, tangent_A = linearise_flow(z, P_A, orifice)
    Q_B, secant_B, tangent_B = linearise_flow(-z, P_B, orifice)
    net_A, net_B = net_flows(Q_A, Q_B, v, C_L * (P_A - P_B), chambers)
    V_A, V_B = chamber_volumes(x + 0.5 * dt * v, chambers)
    C_A, C_B = V_A * per_E_dt, V_B * per_E_dt

    c = 0.5 * C_L
    a = C_A + c + implicit_share(secant_A, tangent_A, C_A)
    b = C_B + c + implicit_share(secant_B, tangent_B, C_B)

    drag = linearise_drag(v, m / dt, friction)
    force = P_A * A_A - P_B * A_B - drag[0] * v - F_L
    return finish_step(cylinder, force, m / dt, drag, (a, b, c, net_A, net_B), constants)


@kernel
def advance_implicit_midpoint(
    state: Floats, constants: Floats, u: float, F_L: float, steps: int
) -> Seen:
    """Move the state on by some steps of the linearly implicit midpoint rule, in place.

    Args:
        state: x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB.
        constants: as `hil_bench.plant.constants.pack` gives them.
        u: spool set-point [m].
        F_L: external load [N].
        steps: how many.

    Returns:
        What is seen after the last step.
    """
    groups = unpack(constants)
    _, _, opening, transition, _, _, _, _ = groups
    cylinder = (state[0], state[1], state[2], state[3], state[6], state[7])
    nu, nu_dot = state[4], state[5]
    for _ in range(steps):
        nu_before = nu
        nu, nu_dot = move_spool(nu, nu_dot, u, transition)
        z_middle = orifice_state(0.5 * (nu_before + nu), opening)
        cylinder = move_cylinder(cylinder, z_middle, F_L, groups)
    x, v, P_A, P_B, V_CA, V_CB = cylinder
    return keep(state, (x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB), groups)
