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

from hil_bench.plant.chamber import ChamberConstants, chamber_volumes, net_flows
from hil_bench.plant.constants import Constants, unpack
from hil_bench.plant.friction import FrictionConstants, linearise_friction
from hil_bench.plant.kernel import Floats, kernel
from hil_bench.plant.load import stop_velocity_change
from hil_bench.plant.orifice import linearise_flow
from hil_bench.plant.spool import move_spool, orifice_state
from hil_bench.plant.state_row import Seen, keep

Cylinder = tuple[float, float, float, float]
"""(x, v, P_A, P_B)."""

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
def respond(
    pressure: float, change: float, fall: float, floor: float, dv: float
) -> tuple[float, float]:
    """Return a chamber's response, held at the floor if velocity change `dv` takes it below.

    Args:
        pressure: at the start of the step [Pa].
        change: of pressure over the step, were there no velocity change [Pa].
        fall: of pressure per velocity change [Pa s/m].
        floor: lowest pressure [Pa].
        dv: velocity change [m/s].
    """
    if pressure + change - fall * dv < floor:
        return floor - pressure, 0.0
    return change, fall


Response = tuple[float, float, float, float]
"""(dP_A, fall_A, dP_B, fall_B): the pressures change by dP - fall dv over the step."""


@kernel
def eliminate_pressures(
    net_A: float, net_B: float, a: float, b: float, c: float, chambers: ChamberConstants
) -> Response:
    """Return how both pressures respond to the step's velocity change dv.

    [[a, -c], [-c, b]] (dP_A, dP_B) = (net_A - A_A dv / 2, net_B + A_B dv / 2)

    Args:
        net_A: flow that compresses the oil in A, at the start of the step [m³/s].
        net_B: flow that compresses the oil in B, at the start of the step [m³/s].
        a: compliance of A over dt and what damps there [m³/(s Pa)].
        b: compliance of B over dt and what damps there [m³/(s Pa)].
        c: share of the leakage between both [m³/(s Pa)].
        chambers: the constants.
    """
    _, _, A_A, A_B, _, _, _ = chambers
    per_det = 1.0 / (a * b - c * c)
    return (
        (b * net_A + c * net_B) * per_det,
        0.5 * (b * A_A - c * A_B) * per_det,
        (c * net_A + a * net_B) * per_det,
        0.5 * (c * A_A - a * A_B) * per_det,
    )


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
    response: Response,
    constants: Constants,
) -> Cylinder:
    """Return x, v, P_A, P_B one step later, with the cavitation floor and the end stops in force.

    Args:
        cylinder: x, v, P_A, P_B at the start of the step.
        force: on the piston at the start of the step [N].
        inertia: m / dt and what damps the piston besides the friction curve [N s/m].
        drag: the friction curve at the start of the step; `NO_DRAG` for none.
        response: of the pressures.
        constants: in their groups.
    """
    (dt, m, _, floor), _, _, _, _, chambers, friction, stop = constants
    inertia += drag[2]
    x, v, P_A, P_B = cylinder
    dP_A, fall_A, dP_B, fall_B = response
    dv, resistance = velocity_change(force, inertia, response, chambers)
    if P_A + dP_A - fall_A * dv < floor or P_B + dP_B - fall_B * dv < floor:
        dP_A, fall_A = respond(P_A, dP_A, fall_A, floor, dv)
        dP_B, fall_B = respond(P_B, dP_B, fall_B, floor, dv)
        held = (dP_A, fall_A, dP_B, fall_B)
        dv, resistance = velocity_change(force, inertia, held, chambers)
    dv = follow_friction(dv, v, resistance, drag, m / dt, friction)
    dv = stop_velocity_change(dv, resistance, x, v, dt, stop)
    P_A += dP_A - fall_A * dv
    P_B += dP_B - fall_B * dv
    return (
        x + dt * (v + 0.5 * dv),
        v + dv,
        floor if P_A < floor else P_A,
        floor if P_B < floor else P_B,
    )


@kernel
def move_cylinder(cylinder: Cylinder, z: float, F_L: float, constants: Constants) -> Cylinder:
    """Return x, v, P_A, P_B one step later.

    Args:
        cylinder: x, v, P_A, P_B at the start of the step.
        z: orifice state in the middle of the step [m].
        F_L: external load [N].
        constants: in their groups.
    """
    (dt, m, per_E_dt, _), _, _, _, orifice, chambers, friction, _ = constants
    _, C_L, A_A, A_B, _, _, _ = chambers
    x, v, P_A, P_B = cylinder

    Q_A, secant_A, tangent_A = linearise_flow(z, P_A, orifice)
    Q_B, secant_B, tangent_B = linearise_flow(-z, P_B, orifice)
    net_A, net_B = net_flows(Q_A, Q_B, v, C_L * (P_A - P_B), chambers)
    V_A, V_B = chamber_volumes(x + 0.5 * dt * v, chambers)
    C_A, C_B = V_A * per_E_dt, V_B * per_E_dt

    c = 0.5 * C_L
    a = C_A + c + implicit_share(secant_A, tangent_A, C_A)
    b = C_B + c + implicit_share(secant_B, tangent_B, C_B)
    response = eliminate_pressures(net_A, net_B, a, b, c, chambers)

    drag = linearise_drag(v, m / dt, friction)
    force = P_A * A_A - P_B * A_B - drag[0] * v - F_L
    return finish_step(cylinder, force, m / dt, drag, response, constants)


@kernel
def advance_implicit_midpoint(
    state: Floats, constants: Floats, u: float, F_L: float, steps: int
) -> Seen:
    """Move the state on by some steps of the linearly implicit midpoint rule, in place.

    Args:
        state: x, v, P_A, P_B, nu, nu_dot.
        constants: as `hil_bench.plant.constants.pack` gives them.
        u: spool set-point [m].
        F_L: external load [N].
        steps: how many.

    Returns:
        What is seen after the last step.
    """
    groups = unpack(constants)
    _, _, opening, transition, _, _, _, _ = groups
    x, v, P_A, P_B, nu, nu_dot = state[0], state[1], state[2], state[3], state[4], state[5]
    for _ in range(steps):
        nu_before = nu
        nu, nu_dot = move_spool(nu, nu_dot, u, transition)
        z_middle = orifice_state(0.5 * (nu_before + nu), opening)
        x, v, P_A, P_B = move_cylinder((x, v, P_A, P_B), z_middle, F_L, groups)
    return keep(state, (x, v, P_A, P_B, nu, nu_dot), groups)
