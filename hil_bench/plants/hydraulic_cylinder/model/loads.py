"""Loads on the rod: what F_L of eq. (12) is made of, besides what each step is given."""

import math
from dataclasses import dataclass

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model.validation import (
    ROWS,
    require_fields,
    require_finite,
    require_kind,
)

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
