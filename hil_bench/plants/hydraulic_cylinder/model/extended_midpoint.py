"""The bench's solver with extensions: the step of `implicit_midpoint`, and what they add to it.

Every extension joins the same linearly implicit system, so each is as stable as the step itself:
leakage and spring by the midpoint rule, the bristles by their exact solution for the step's mean
velocity, the supply pressure as a fourth unknown that is eliminated before the other three. With
every extension off, a step gives the same bits as the plain one.
"""

from hil_bench.plants.hydraulic_cylinder.model.cavitation import Oil, Response
from hil_bench.plants.hydraulic_cylinder.model.constants import (
    SERIES,
    Constants,
    ExtendedConstants,
    unpack,
    unpack_extended,
)
from hil_bench.plants.hydraulic_cylinder.model.coupling import eliminate_pressures, velocity_change
from hil_bench.plants.hydraulic_cylinder.model.extended_oil import (
    Inner,
    charged_pressure,
    compress_oil,
    compress_through_edges,
    move_inner,
)
from hil_bench.plants.hydraulic_cylinder.model.friction import (
    Bending,
    BristleConstants,
    bend,
    resist,
    settle,
    slip_rate,
)
from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import Cylinder, Spool, finish_step
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel
from hil_bench.plants.hydraulic_cylinder.model.load import find_point, series_force
from hil_bench.plants.hydraulic_cylinder.model.parts import (
    PARTS,
    RATIO,
    TOLERANCE,
    largest_part,
    oil_error,
    place_between,
    shorten,
)
from hil_bench.plants.hydraulic_cylinder.model.spool import move_spool, orifice_state
from hil_bench.plants.hydraulic_cylinder.model.state import (
    EXTRA,
    INNER,
    POINT,
    STEPS,
    Seen,
    keep_extended,
    read_states,
)
from hil_bench.plants.hydraulic_cylinder.model.stepping import NO_DRAG, linearise_drag

Others = tuple[float, float, Inner]
"""Bristle deflection [m], supply pressure [Pa], states of the components."""


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
    """Return the bristles' bending at the velocity in the middle of the step.

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
def move_piston(
    cylinder: Cylinder,
    F_L: float,
    z_f: float,
    oil: Oil,
    constants: Constants,
    extension: ExtendedConstants,
) -> tuple[Cylinder, float, float]:
    """Return the cylinder and its bristles one step later, and what the velocity is off by.

    Args:
        cylinder: at the start of the step.
        F_L: external load in the middle of the step, without the spring's [N].
        z_f: bristle deflection at the start of the step [m].
        oil: of the step.
        constants: in their groups.
        extension: those of the extensions.
    """
    (dt, m, _, _), _, _, _, _, chambers, friction, _ = constants
    _, _, bristles, (_, spring, rest) = extension[:4]
    x, v, P_A, P_B, _, _ = cylinder
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
    return moved, z_f, error


@kernel
def try_extended(
    cylinder: Cylinder,
    spool: Spool,
    F_L: float,
    others: Others,
    constants: Constants,
    extension: ExtendedConstants,
) -> tuple[Cylinder, Others, float]:
    """Return the cylinder and the other states one step later, and what the velocity is off by.

    Args:
        cylinder: at the start of the step.
        spool: its way over the step.
        F_L: external load in the middle of the step, without the spring's [N].
        others: bristles, supply and components at the start of the step.
        constants: in their groups.
        extension: those of the extensions.
    """
    (dt, _, _, floor), _, opening, _, _, _, _, _ = constants
    _, _, P_A, P_B, _, _ = cylinder
    z_f, P_S, inner = others
    nu = 0.5 * (spool[0] + spool[1])
    z = orifice_state(nu, opening)
    if extension[6][0] == 0.0:
        oil, ports, feeding = compress_oil(cylinder, z, P_S, constants, extension)
    else:
        before = (P_A, P_B, P_S)
        middle, _ = move_inner(inner, nu, before, (P_A, P_B), dt, constants, extension)
        oil, ports, feeding = compress_through_edges(
            cylinder, nu, P_S, middle, constants, extension
        )

    moved, z_f, error = move_piston(cylinder, F_L, z_f, oil, constants, extension)
    rises = (moved[2] - P_A, moved[3] - P_B)
    error += oil_error(rises, ports, spool, z, constants)
    charged = charged_pressure(P_S, feeding, rises)
    if extension[6][0] != 0.0:
        means = (P_A + 0.5 * rises[0], P_B + 0.5 * rises[1], 0.5 * (P_S + charged))
        at_ports = (means[0], means[1])
        _, inner = move_inner(inner, nu, means, at_ports, dt, constants, extension)
    return moved, (z_f, floor if charged < floor else charged, inner), error


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
    others = (z_f, P_S, (state[INNER], state[INNER + 1], state[INNER + 2]))
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
            moved, reached_others, error = try_extended(
                cylinder, way, load, others, shorten(groups, size), extension
            )
            if error > TOLERANCE and size > 1:
                size //= RATIO
            else:
                cylinder, others, point, done = moved, reached_others, reached, done + size
                size = largest_part(done, size)
    x, v, P_A, P_B, V_CA, V_CB = cylinder
    z_f, P_S, inner = others
    state[INNER], state[INNER + 1], state[INNER + 2] = inner
    states = (x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB, z_f, P_S)
    state[EXTRA] += extra
    return keep_extended(state, states, steps, point, groups, extension)
