"""Forces on the piston from outside the oil: the end stops, and loads.

A contact is a spring and a damper that push the piston back and never pull it, so it can only take
energy out of the motion.
"""

from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel

StopConstants = tuple[float, float, float]
"""(position of the stops [m], stiffness [N/m], damping [N s/m]); position infinite for no stop."""

LoadConstants = tuple[float, float, float]
"""(constant force [N], stiffness of the spring [N/m], its position of rest [m])."""


@kernel
def stop_force(x: float, v: float, stop: StopConstants) -> float:
    """Return the end stop's force on the piston [N], in the direction of +x."""
    position, stiffness, damping = stop
    if x > position:
        push = stiffness * (x - position) + damping * v
        return -push if push > 0.0 else 0.0
    if x < -position:
        push = stiffness * (-position - x) - damping * v
        return push if push > 0.0 else 0.0
    return 0.0


@kernel
def stop_velocity_change(
    change: float, resistance: float, x: float, v: float, dt: float, stop: StopConstants
) -> tuple[float, float, float]:
    """Return the velocity change over one step under the end stop, and what it is off by [m/s].

    Between them stands the force per velocity change of everything and the stop [N s/m].

    In contact the forces of spring and damper are those in the middle of the step; in the step that
    makes contact the spring's is that at its end. Then the spring never gives more energy than it
    took, whatever the stiffness and the step, and the damper only takes.

    Args:
        change: velocity change without a stop [m/s].
        resistance: force per velocity change of everything but the stop [N s/m].
        x: piston position at the start of the step [m].
        v: piston velocity at the start of the step [m/s].
        dt: step [s].
        stop: the constants.
    """
    position, stiffness, damping = stop
    travel = dt * (v + 0.5 * change)
    if -position <= x + travel <= position:
        return change, resistance, 0.5 * abs(stop_force(x, v, stop)) / resistance
    side = 1.0 if x + travel > 0.0 else -1.0
    depth, share = side * x - position, 0.5
    if depth <= 0.0:
        share = 1.0
    push = stiffness * (depth + share * side * travel) + damping * side * travel / dt
    if push <= 0.0:
        return change, resistance, 0.0
    held = resistance + 0.5 * (share * stiffness * dt + damping)
    lost = side * push / held
    if depth <= 0.0:
        return change - lost, held, 0.5 * abs(lost)
    return change - lost, held, abs(change - lost) * stiffness * dt / (12.0 * resistance)


@kernel
def find_point(points: Floats, point: int, last: int, t: float) -> int:
    """Return the index of the load series' point at or before time t [s], searching onwards.

    Args:
        points: a row that holds time [s] and force [N] of each point in turn.
        point: index of a point from which to search on.
        last: index of the last point.
        t: time [s].
    """
    while point < last and points[point + 2] <= t:
        point += 2
    return point


@kernel
def series_force(points: Floats, point: int, last: int, t: float) -> float:
    """Return the load series' force [N]: linear from `point` to the next, constant outside.

    Args:
        points: as for `find_point`.
        point: as `find_point` returned it for t.
        last: index of the last point.
        t: time [s].
    """
    since = t - points[point]
    if point == last or since <= 0.0:
        return points[point + 1]
    slope = (points[point + 3] - points[point + 1]) / (points[point + 2] - points[point])
    return points[point + 1] + slope * since


@kernel
def step_loads(
    points: Floats, point: int, last: int, t: float, dt: float
) -> tuple[int, tuple[float, float, float]]:
    """Return the load series' force at start, middle and end of a step [N], and its point there.

    Args:
        points: as for `find_point`.
        point: index of a point from which to search on.
        last: index of the last point.
        t: time at the start of the step [s].
        dt: step [s].
    """
    first = find_point(points, point, last, t)
    middle = find_point(points, first, last, t + 0.5 * dt)
    end = find_point(points, middle, last, t + dt)
    return end, (
        series_force(points, first, last, t),
        series_force(points, middle, last, t + 0.5 * dt),
        series_force(points, end, last, t + dt),
    )
