"""The reduced model's kernels, Ruderman 2017 eqs. (14)-(17): one pressure, the load pressure P_L.

To the step of `implicit_midpoint` it is a cylinder with one chamber of the mean area, the bulk
modulus 4 E and the volume V_t, whose orifice sees P_L / 2 between P_S / 2 and -P_S / 2. So the
solvers, the friction, the loads and the end stops are those of the full model.
"""

from collections.abc import Sequence
from inspect import unwrap
from typing import cast

from hil_bench.plants.hydraulic_cylinder.model.constants import (
    ORIFICE_P_S,
    SERIES,
    Constants,
    pack_extended,
    unpack,
    unpack_extended,
    unpack_lane,
)
from hil_bench.plants.hydraulic_cylinder.model.coupling import (
    couple,
    eliminate_pressures,
    mean_velocity,
    swing_lag,
    velocity_change,
)
from hil_bench.plants.hydraulic_cylinder.model.friction import friction_force
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel
from hil_bench.plants.hydraulic_cylinder.model.load import (
    LoadConstants,
    find_point,
    series_force,
    step_loads,
    stop_force,
    stop_velocity_change,
)
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.orifice import OrificeConstants, linearise_flow
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.parts import (
    PARTS,
    RATIO,
    TOLERANCE,
    flow_error,
    largest_part,
    shorten,
)
from hil_bench.plants.hydraulic_cylinder.model.spool import orifice_state
from hil_bench.plants.hydraulic_cylinder.model.state import Seen
from hil_bench.plants.hydraulic_cylinder.model.stepping import (
    follow_friction,
    implicit_share,
    linearise_drag,
)

EXTRA = 6
"""Place in the row of states of the evaluations beyond one a step."""

_LARGEST_P_L = 3  # places in the row of constants
_ORIFICE_P_T = ORIFICE_P_S + 1

Motion = tuple[float, float, float, float]
"""(x, v, P_L, cavity), or their rates of change.

The cavity [m³] is what the oil lacks where P_L is held: above 0 in chamber B at the largest P_L,
below 0 in chamber A at the smallest one.
"""


def pack_reduced(parameters: PlantParameters, options: PlantOptions, dt: float) -> Sequence[float]:
    """Return the constants in the order of `pack_extended`, with the one chamber in place of two.

    In the place of the chambers' floor stands the largest |P_L|: with eq. (15) no chamber falls
    below the floor as long as |P_L| <= P_S - 2 floor.
    """
    p = parameters
    row = [float(value) for value in pack_extended(parameters, options, dt)]
    constants = cast("Constants", unwrap(unpack_lane)(row, 0, 1))  # once a plant: without Numba
    (_, m, _, floor), spool, opening, transition, orifice, _, friction, stop = constants
    groups: Constants = (
        (dt, m, 1.0 / (4.0 * p.E * dt), p.P_S - 2.0 * floor),
        spool,
        opening,
        transition,
        (p.K, 0.5 * p.P_S, -0.5 * p.P_S, orifice[3], orifice[4]),
        (4.0 * p.E, p.C_L, p.mean_area, 0.0, p.total_volume, 0.0, p.h),
        friction,
        stop,
    )
    paper = [float(value) for group in groups for value in group]
    return paper + row[len(paper) :]


def change_supply(row: Floats, P_S: float) -> None:
    """Let a row of constants be that of another supply pressure [Pa]."""
    before = 2.0 * row[ORIFICE_P_S]
    row[_LARGEST_P_L] += P_S - before
    row[ORIFICE_P_S], row[_ORIFICE_P_T] = 0.5 * P_S, -0.5 * P_S


@kernel
def load_flow(z: float, P_L: float, orifice: OrificeConstants) -> tuple[float, float, float]:
    """Return Q_L [m³/s] of eq. (14), its secant and its tangent over P_L [m³/(s Pa)].

    Args:
        z: orifice state [m].
        P_L: load pressure [Pa].
        orifice: the constants of the reduced model.
    """
    Q_L, secant, tangent = linearise_flow(z, 0.5 * P_L, orifice)
    return Q_L, 0.5 * secant, 0.5 * tangent


@kernel
def hold_load_pressure(P_L: float, limit: float) -> float:
    """Return P_L [Pa] where no chamber is below the cavitation floor."""
    if P_L > limit:
        return limit
    return -limit if P_L < -limit else P_L


@kernel
def hold_motion(motion: Motion, constants: Constants) -> Motion:
    """Return a motion of the same oil in which P_L is at its limit or the cavity closed."""
    x, v, P_L, cavity = motion
    limit, (E, _, _, _, V_t, _, _) = constants[0][3], constants[5]
    if -limit <= P_L <= limit and cavity == 0.0:
        return motion
    free = P_L + E / V_t * cavity
    P_L = hold_load_pressure(free, limit)
    return x, v, P_L, (free - P_L) * (V_t / E)


@kernel
def motion_rates(
    motion: Motion, z: float, F_L: float, loads: LoadConstants, constants: Constants
) -> Motion:
    """Return the right-hand side of eqs. (16), (17).

    Args:
        motion: at which.
        z: orifice state [m].
        F_L: external load but for the springs of the loads [N].
        loads: their constants, whose force F_L has already.
        constants: of the reduced model, in their groups.
    """
    (_, m, _, limit), _, _, _, orifice, (E, C_L, A, _, V_t, _, _), friction, stop = constants
    x, v, P_L, cavity = hold_motion(motion, constants)
    net = load_flow(z, P_L, orifice)[0] - A * v - C_L * P_L
    force = P_L * A - friction_force(v, friction) - F_L - loads[1] * (x - loads[2])
    acceleration = (force + stop_force(x, v, stop)) / m
    if cavity != 0.0 or (P_L <= -limit and net < 0.0) or (P_L >= limit and net > 0.0):
        return v, acceleration, 0.0, net
    return v, acceleration, E / V_t * net, 0.0


@kernel
def shift_motion(motion: Motion, rates: Motion, dt: float) -> Motion:
    """Return the motion after `dt` [s] at constant rates."""
    return (
        motion[0] + dt * rates[0],
        motion[1] + dt * rates[1],
        motion[2] + dt * rates[2],
        motion[3] + dt * rates[3],
    )


@kernel
def try_reduced(
    motion: Motion, z: float, F_L: float, loads: LoadConstants, constants: Constants
) -> tuple[Motion, float]:
    """Return the motion one step of the linearly implicit midpoint rule later, and its error.

    Args:
        motion: at the start of the step.
        z: orifice state [m].
        F_L: external load in the middle of the step but for the springs of the loads [N].
        loads: their constants, whose force F_L has already.
        constants: of the reduced model, in their groups.
    """
    (dt, m, per_E_dt, limit), _, _, _, orifice, chambers, friction, stop = constants
    _, C_L, A, _, V_t, _, _ = chambers
    x, v, P_L, cavity = motion
    Q_L, secant, tangent = load_flow(z, P_L, orifice)
    C = V_t * per_E_dt
    loss = C + 0.5 * C_L + implicit_share(secant, tangent, C)
    net = Q_L - A * v - C_L * P_L + cavity / dt
    drag = linearise_drag(v, m / dt, friction)
    force = P_L * A - drag[0] * v - F_L - loads[1] * (x + 0.5 * dt * v - loads[2])
    inertia = m / dt + 0.25 * dt * loads[1] + drag[2]
    # One chamber: the other has no area and no flow.
    lag = swing_lag(v, m / dt, friction)
    oil = couple((loss, 1.0, 0.0, net, 0.0, 0.5), lag, friction[2], chambers)
    response, half = eliminate_pressures(oil, chambers), oil[5]
    dv, resistance = velocity_change(force, inertia, half, response, constants)
    end = P_L + response[0] - response[1] * dv
    if end > limit or end < -limit:
        held = (hold_load_pressure(end, limit) - P_L, 0.0, 0.0, 0.0)
        dv, resistance = velocity_change(force, inertia, half, held, constants)
    dv, resistance, of_stop = stop_velocity_change(dv, resistance, x, v, dt, stop)
    dv, error = follow_friction(dv, v, resistance, drag, m / dt, friction)
    free = P_L + response[0] - response[1] * dv
    end = hold_load_pressure(free, limit)
    void = dt * oil[0] * (free - end)
    rises = (end - P_L, 0.0)
    jump = A * abs(rises[0]) if (void != 0.0) != (cavity != 0.0) else 0.0
    error += of_stop + 0.25 * jump / resistance
    error += flow_error(rises, (secant, 0.0, Q_L, 0.0), constants)
    x += dt * mean_velocity(v, dv, rises, half, lag, chambers)
    return (x, v + dv, end, void), error


@kernel
def keep(
    state: Floats, motion: Motion, steps: int, point: int, nu: float, constants: Constants
) -> Seen:
    """Write a state back, and return what is seen of it, (15).

    Args:
        state: takes x, v, P_L, cavity, steps since time 0, point of the load series, of which
            the extra evaluations stay.
        motion: to be written.
        steps: made since they were read.
        point: index of the load series' point in the row of constants.
        nu: spool position [m].
        constants: of the reduced model, in their groups.
    """
    x, v, P_L, cavity = motion
    state[0], state[1], state[2], state[3] = x, v, P_L, cavity
    state[4], state[5] = state[4] + steps, float(point - SERIES)
    z, orifice = orifice_state(nu, constants[2]), constants[4]
    P_S, Q_L = 2.0 * orifice[1], load_flow(z, P_L, orifice)[0]
    return x, v, 0.5 * (P_S + P_L), 0.5 * (P_S - P_L), nu, z, Q_L, -Q_L


@kernel
def advance_reduced_euler(state: Floats, row: Floats, u: float, F_L: float, steps: int) -> Seen:
    """Move the state on by some steps of forward Euler, in place; as `advance_reduced_midpoint`."""
    constants, extension = unpack(row), unpack_extended(row)
    dt = constants[0][0]
    loads = extension[3]
    F_L += loads[0]
    z, last = orifice_state(u, constants[2]), len(row) - 2
    motion, point = (state[0], state[1], state[2], state[3]), SERIES + int(state[5])
    for step in range(steps):
        t = (state[4] + step) * dt
        point = find_point(row, point, last, t)
        load = F_L + series_force(row, point, last, t)
        rates = motion_rates(motion, z, load, loads, constants)
        motion = hold_motion(shift_motion(motion, rates, dt), constants)
    return keep(state, motion, steps, point, u, constants)


@kernel
def advance_reduced_midpoint(state: Floats, row: Floats, u: float, F_L: float, steps: int) -> Seen:
    """Move the state on by some steps of the linearly implicit midpoint rule, in place.

    Args:
        state: x, v, P_L, cavity, steps since time 0, point of the load series, extra evaluations.
        row: the constants as `pack_reduced` gives them.
        u: spool position, which is the set-point [m].
        F_L: external load besides those of the options [N].
        steps: how many.

    Returns:
        What is seen after the last step.
    """
    constants, extension = unpack(row), unpack_extended(row)
    dt = constants[0][0]
    loads = extension[3]
    F_L += loads[0]
    z, last = orifice_state(u, constants[2]), len(row) - 2
    motion, point = (state[0], state[1], state[2], state[3]), SERIES + int(state[5])
    extra = -steps
    for step in range(steps):
        done, size = 0, PARTS
        while done < PARTS:
            extra += 1
            t = (state[4] + step + (done + 0.5 * size) / PARTS) * dt
            reached = find_point(row, point, last, t)
            load = F_L + series_force(row, reached, last, t)
            moved, error = try_reduced(motion, z, load, loads, shorten(constants, size))
            if error > TOLERANCE and size > 1:
                size //= RATIO
            else:
                motion, point, done = moved, reached, done + size
                size = largest_part(done, size)
    state[EXTRA] += extra
    return keep(state, motion, steps, point, u, constants)


@kernel
def advance_reduced_runge_kutta(
    state: Floats, row: Floats, u: float, F_L: float, steps: int
) -> Seen:
    """Move the state on by some steps of order four, in place; as `advance_reduced_midpoint`."""
    constants, extension = unpack(row), unpack_extended(row)
    dt = constants[0][0]
    loads = extension[3]
    F_L += loads[0]
    z, last = orifice_state(u, constants[2]), len(row) - 2
    y, point = (state[0], state[1], state[2], state[3]), SERIES + int(state[5])
    for step in range(steps):
        point, series = step_loads(row, point, last, (state[4] + step) * dt, dt)
        load_1, load_2, load_3 = F_L + series[0], F_L + series[1], F_L + series[2]
        k_1 = motion_rates(y, z, load_1, loads, constants)
        k_2 = motion_rates(shift_motion(y, k_1, 0.5 * dt), z, load_2, loads, constants)
        k_3 = motion_rates(shift_motion(y, k_2, 0.5 * dt), z, load_2, loads, constants)
        k_4 = motion_rates(shift_motion(y, k_3, dt), z, load_3, loads, constants)
        y = shift_motion(shift_motion(y, k_1, dt / 6.0), k_2, dt / 3.0)
        y = shift_motion(shift_motion(y, k_3, dt / 3.0), k_4, dt / 6.0)
        y = hold_motion(y, constants)
    return keep(state, y, steps, point, u, constants)
