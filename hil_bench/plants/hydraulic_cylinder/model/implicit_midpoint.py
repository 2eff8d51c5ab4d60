"""The bench's solver: the spool exactly, the cylinder by a linearly implicit midpoint step.

One step solves (I - W) dy = dt f(y) for y = (P_A, P_B, v), with f taken at the middle of the step
in spool and piston position. W = dt J / 2 makes that a Rosenbrock step of order 2 (gamma = 1/2). On
the diagonal, W grows beyond that by terms of order dt² where an orifice or the friction curve is
stiff, up to the backward Euler step on the secant: so nothing rings there and the order stays
(`docs/decisions/0001-plant-and-solver.md`). Where one step resolves the friction curve, its mean
over the step then takes the place of its tangent (`model.following`); the swing of the
piston on the oil is of order 4 (`model.coupling`). A step judges its own error and is
made in parts where that is too large (`model.parts`).
"""

import math

from hil_bench.plants.hydraulic_cylinder.model.cavitation import Oil, hold, share_out
from hil_bench.plants.hydraulic_cylinder.model.chamber import chamber_volumes, net_flows
from hil_bench.plants.hydraulic_cylinder.model.constants import Constants, unpack
from hil_bench.plants.hydraulic_cylinder.model.coupling import (
    couple,
    eliminate_pressures,
    mean_velocity,
    pressure_rises,
    swing_lag,
    velocity_change,
)
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel
from hil_bench.plants.hydraulic_cylinder.model.load import stop_velocity_change
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
from hil_bench.plants.hydraulic_cylinder.model.state import PLAIN_EXTRA, Seen, keep
from hil_bench.plants.hydraulic_cylinder.model.stepping import (
    Drag,
    follow_friction,
    implicit_share,
    linearise_drag,
)

Cylinder = tuple[float, float, float, float, float, float]
"""(x, v, P_A, P_B, V_CA, V_CB)."""

Spool = tuple[float, float]
"""Spool position at the start and at the end of a step [m]."""


@kernel
def constrain(
    dv: float, resistance: float, cylinder: Cylinder, drag: Drag, constants: Constants
) -> tuple[float, float]:
    """Return the velocity change with friction and end stop, and what it is off by [m/s].

    Args:
        dv: velocity change with the friction as linearised at the start of the step [m/s].
        resistance: force per velocity change of everything [N s/m].
        cylinder: at the start of the step.
        drag: the friction curve there.
        constants: in their groups.
    """
    (dt, m, _, _), _, _, _, _, _, friction, stop = constants
    x, v = cylinder[0], cylinder[1]
    dv, resistance, of_stop = stop_velocity_change(dv, resistance, x, v, dt, stop)
    dv, error = follow_friction(dv, v, resistance, drag, m / dt, friction)
    return dv, error + of_stop


@kernel
def finish_free(
    cylinder: Cylinder, force: float, inertia: float, drag: Drag, rows: Oil, constants: Constants
) -> tuple[Cylinder, float]:
    """Return the cylinder one step later and what its velocity is off by, away from the floor.

    The error is infinite where a cavity is or opens. Arguments as `finish_step`.
    """
    (dt, m, _, floor), _, _, _, _, chambers, friction, _ = constants
    x, v, P_A, P_B, V_CA, V_CB = cylinder
    lag = swing_lag(v, m / dt, friction)
    oil = couple(rows, lag, friction[2], chambers)
    response = eliminate_pressures(oil, chambers)
    dv, resistance = velocity_change(force, inertia + drag[2], oil[5], response, constants)
    dv, error = constrain(dv, resistance, cylinder, drag, constants)
    rises = pressure_rises(response, dv)
    P_A, P_B = P_A + rises[0], P_B + rises[1]
    if P_A < floor or P_B < floor or V_CA > 0.0 or V_CB > 0.0:
        error = math.inf
    x += dt * mean_velocity(v, dv, rises, oil[5], lag, chambers)
    return (x, v + dv, P_A, P_B, 0.0, 0.0), error


@kernel
def finish_low(
    cylinder: Cylinder, force: float, inertia: float, drag: Drag, rows: Oil, constants: Constants
) -> tuple[Cylinder, float]:
    """Return the cylinder one step later and what its velocity is off by, near the floor.

    Arguments as `finish_step`.
    """
    (dt, m, _, floor), _, _, _, _, chambers, friction, _ = constants
    x, v, P_A, P_B, V_CA, V_CB = cylinder
    inertia += drag[2]
    # What damps the piston more couples the chambers the other way, which `hold` cannot have.
    lag = swing_lag(v, m / dt, friction) if inertia <= 2.0 * m / dt else 0.0
    a, b, c, net_A, net_B, half = couple(rows, lag, friction[2], chambers)
    oil = (a, b, c, net_A - V_CA / dt, net_B - V_CB / dt, half)
    free = eliminate_pressures(oil, chambers)
    dv, resistance = velocity_change(force, inertia, half, free, constants)
    rise_A, rise_B = pressure_rises(free, dv)
    if P_A + rise_A < floor or P_B + rise_B < floor:
        held = hold(floor - P_A, floor - P_B, force, inertia, oil, constants)
        dv, resistance = velocity_change(force, inertia, half, held, constants)
    dv, error = constrain(dv, resistance, cylinder, drag, constants)
    rise_A, rise_B = pressure_rises(free, dv)
    void_A = void_B = 0.0
    if P_A + rise_A < floor or P_B + rise_B < floor:
        rise_A, rise_B, void_A, void_B = share_out(floor - P_A, floor - P_B, dv, oil, chambers)
    # In the step that opens or fills a cavity, the pressure does not rise evenly.
    jump = chambers[2] * abs(rise_A) if (void_A > 0.0) != (V_CA > 0.0) else 0.0
    jump += chambers[3] * abs(rise_B) if (void_B > 0.0) != (V_CB > 0.0) else 0.0
    x += dt * mean_velocity(v, dv, (rise_A, rise_B), half, lag, chambers)
    P_A = floor if void_A > 0.0 or P_A + rise_A < floor else P_A + rise_A
    P_B = floor if void_B > 0.0 or P_B + rise_B < floor else P_B + rise_B
    return (x, v + dv, P_A, P_B, dt * void_A, dt * void_B), error + 0.25 * jump / resistance


@kernel
def finish_step(
    cylinder: Cylinder, force: float, inertia: float, drag: Drag, rows: Oil, constants: Constants
) -> tuple[Cylinder, float]:
    """Return the cylinder one step later, and what its velocity is off by [m/s].

    Args:
        cylinder: at the start of the step.
        force: on the piston at the start of the step [N].
        inertia: m / dt and what damps the piston besides the friction curve [N s/m].
        drag: the friction curve at the start of the step; `NO_DRAG` for none.
        rows: the oil of the midpoint rule, before any cavity is filled.
        constants: in their groups.
    """
    moved, error = finish_free(cylinder, force, inertia, drag, rows, constants)
    if error == math.inf:
        return finish_low(cylinder, force, inertia, drag, rows, constants)
    return moved, error


@kernel
def prepare_step(
    cylinder: Cylinder, z: float, F_L: float, constants: Constants
) -> tuple[float, Drag, Oil, Ports]:
    """Return the force on the piston at the start of a step [N], the friction curve, oil and ports.

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
    return force, drag, (a, b, c, net_A, net_B, 0.5), (secant_A, secant_B, Q_A, Q_B)


@kernel
def try_step(
    cylinder: Cylinder, spool: Spool, F_L: float, constants: Constants
) -> tuple[Cylinder, float]:
    """Return the cylinder one step later, and what its velocity is off by [m/s].

    Args:
        cylinder: at the start of the step.
        spool: its way over the step.
        F_L: external load [N].
        constants: in their groups.
    """
    (dt, m, _, _), _, opening, _, _, _, _, _ = constants
    z = orifice_state(0.5 * (spool[0] + spool[1]), opening)
    force, drag, rows, ports = prepare_step(cylinder, z, F_L, constants)
    moved, error = finish_step(cylinder, force, m / dt, drag, rows, constants)
    rises = (moved[2] - cylinder[2], moved[3] - cylinder[3])
    return moved, error + oil_error(rises, ports, spool, z, constants)


@kernel
def try_free_step(
    cylinder: Cylinder, spool: Spool, F_L: float, constants: Constants
) -> tuple[Cylinder, float]:
    """Act as `try_step`, with an infinite error where a cavity exists or opens."""
    (dt, m, _, _), _, opening, _, _, _, _, _ = constants
    z = orifice_state(0.5 * (spool[0] + spool[1]), opening)
    force, drag, rows, ports = prepare_step(cylinder, z, F_L, constants)
    moved, error = finish_free(cylinder, force, m / dt, drag, rows, constants)
    rises = (moved[2] - cylinder[2], moved[3] - cylinder[3])
    return moved, error + oil_error(rises, ports, spool, z, constants)


@kernel
def move_cylinder(
    cylinder: Cylinder, spool: Spool, F_L: float, constants: Constants
) -> tuple[Cylinder, int]:
    """Return the cylinder one step later, in as many parts as its error asks for, and evaluations.

    Args:
        cylinder: at the start of the step.
        spool: its way over the step.
        F_L: external load [N].
        constants: in their groups.
    """
    done, size, evaluations = 0, PARTS, 0
    while done < PARTS:
        evaluations += 1
        way = (place_between(spool, done), place_between(spool, done + size))
        moved, error = try_step(cylinder, way, F_L, shorten(constants, size))
        if error > TOLERANCE and size > 1:
            size //= RATIO
        else:
            cylinder, done = moved, done + size
            size = largest_part(done, size)
    return cylinder, evaluations


@kernel
def advance_implicit_midpoint(
    state: Floats, constants: Floats, u: float, F_L: float, steps: int
) -> Seen:
    """Move the state on by some steps of the linearly implicit midpoint rule, in place.

    Args:
        state: x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB, extra evaluations.
        constants: as `model.constants.pack` gives them.
        u: spool set-point [m].
        F_L: external load [N].
        steps: how many.

    Returns:
        What is seen after the last step.
    """
    groups = unpack(constants)
    cylinder = (state[0], state[1], state[2], state[3], state[6], state[7])
    nu, nu_dot, extra = state[4], state[5], -steps
    for _ in range(steps):
        nu_before = nu
        nu, nu_dot = move_spool(nu, nu_dot, u, groups[3])
        cylinder, evaluations = move_cylinder(cylinder, (nu_before, nu), F_L, groups)
        extra += evaluations
    state[PLAIN_EXTRA] += extra
    x, v, P_A, P_B, V_CA, V_CB = cylinder
    return keep(state, (x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB), groups)
