"""Forces on the piston from outside the oil: the end stops, and loads on the rod, eq. (12).

A contact is a spring and a damper that push the piston back and never pull it, so it can only take
energy out of the motion.
"""

import math
from dataclasses import dataclass

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel
from hil_bench.plants.hydraulic_cylinder.model.validation import (
    ROWS,
    require_fields,
    require_finite,
    require_kind,
)

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


# Loads on the rod: what F_L of eq. (12) is made of, besides what each step is given.


GRAVITY = 9.80665
"""Standard acceleration of gravity [m/s²]."""


@dataclass(frozen=True, slots=True)
class ConstantLoad:
    """A force that never changes.

    Attributes:
        load_force: against positive motion [N].
    """

    load_force: float

    def __post_init__(self) -> None:
        require_fields(self, ROWS.groups["constant load"])

    def force_at(self, _x: float, _t: float) -> float:
        """Return the force against positive motion [N]."""
        return self.load_force


@dataclass(frozen=True, slots=True)
class SpringLoad:
    """A linear spring that pulls the piston to one place: F_L = spring_stiffness (x - spring_rest).

    Attributes:
        spring_stiffness: of the spring [N/m].
        spring_rest: piston position at which the spring is free of force [m].
    """

    spring_stiffness: float
    spring_rest: float = 0.0

    def __post_init__(self) -> None:
        require_fields(self, ROWS.groups["spring"])

    def force_at(self, x: float, _t: float) -> float:
        """Return the force against positive motion [N] at piston position x [m]."""
        return self.spring_stiffness * (x - self.spring_rest)


@dataclass(frozen=True, slots=True)
class MassOnSlope:
    """A mass that the rod moves along a slope: its inertia adds to m, its weight is a load.

    Gravity acts on this mass alone, not on the m of the parameters.

    Attributes:
        load_mass: of what is moved [kg].
        slope: angle of the slope, positive where extending moves uphill, pi/2 lifts [rad].
    """

    load_mass: float
    slope: float = 0.0

    def __post_init__(self) -> None:
        require_fields(self, ROWS.groups["slope"])
        if abs(self.slope) > math.radians(90.0):
            raise ParameterError(
                f"slope = {self.slope:g} rad: must lie between -pi/2 and pi/2", "slope"
            )

    @property
    def weight(self) -> float:
        """Weight of the mass along the slope, against positive motion [N]."""
        return self.load_mass * GRAVITY * math.sin(self.slope)

    def force_at(self, _x: float, _t: float) -> float:
        """Return the force against positive motion [N]."""
        return self.weight


@dataclass(frozen=True, slots=True)
class LoadSeries:
    """A force over time, linear between its points and constant beyond them.

    Two points at the same time make a step.

    Attributes:
        times: of the points since the plant's time 0, not decreasing [s].
        forces: at the points, against positive motion [N].
    """

    times: tuple[float, ...]
    forces: tuple[float, ...]

    def __post_init__(self) -> None:
        require_kind("times", self.times, tuple, list, of="load_series")
        require_kind("forces", self.forces, tuple, list, of="load_series")
        if not self.times or len(self.times) != len(self.forces):
            raise ParameterError(
                f"load_series = {len(self.times)} times and {len(self.forces)} forces: "
                "must be one force for each time, and at least one",
                "load_series",
            )
        for time, force in zip(self.times, self.forces, strict=True):
            require_finite("time", time, "s", "load_series")
            require_finite("force", force, "N", "load_series")
        for before, after in zip(self.times, self.times[1:], strict=False):
            if after < before:
                raise ParameterError(
                    f"load_series = {after:g} s after {before:g} s: its times must not decrease",
                    "load_series",
                )

    def force_at(self, _x: float, t: float) -> float:
        """Return the force against positive motion [N] at time t [s]."""
        import numpy as np  # noqa: PLC0415 - for this kind of load alone

        return float(np.interp(t, self.times, self.forces))


Load = ConstantLoad | SpringLoad | MassOnSlope | LoadSeries
