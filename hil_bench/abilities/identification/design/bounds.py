"""The bounds of a manoeuvre of the axis."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.commissioning.plan import Limits
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig

Values = npt.NDArray[np.float64]

_KEPT_FREE = 0.1
"""Share of the way between the limits that stays free at each end.

The machine drifts otherwise than the model, since what is to be estimated is not known yet.
"""

_NO_LIMIT = 1e12


class Bounds(NamedTuple):
    """Limits of a manoeuvre, with room for what is not known yet.

    Attributes:
        position: lowest and highest [m].
        speed: highest, either way [m/s].
        pressure: lowest and highest of either chamber [Pa].
        limits: as they were given, without that room; None where only the stroke limits.
    """

    position: tuple[float, float]
    speed: float
    pressure: tuple[float, float]
    limits: Limits | None = None

    @classmethod
    def of(cls, axis: CylinderConfig, limits: Limits | None) -> "Bounds":
        """Return the bounds of an axis by its stroke, and by the limits of a plan, if any."""
        half = axis.parameters.h
        low, high = (-half, half) if limits is None else limits.position
        free = _KEPT_FREE * (high - low)
        position = (low + free, high - free)
        if limits is None:
            return cls(position, _NO_LIMIT, (-_NO_LIMIT, _NO_LIMIT))
        speed = (1.0 - _KEPT_FREE) * limits.speed
        return cls(position, speed, limits.pressure, limits)

    @property
    def middle(self) -> float:
        """The position from which there is the same room both ways [m]."""
        return 0.5 * sum(self.position)

    @property
    def room(self) -> float:
        """The way to either end from the middle [m]."""
        return 0.5 * (self.position[1] - self.position[0])

    def leaves(self, states: Values) -> str:
        """Return the name of the bound that a run leaves first, empty where it stays within.

        Args:
            states: position, velocity and both pressures of each row, shape (rows, 4).
        """
        x, v, pressures = states[:, 0], states[:, 1], states[:, 2:]
        if x.min() < self.position[0] or x.max() > self.position[1]:
            return "position"
        if np.abs(v).max() > self.speed:
            return "speed"
        if pressures.min() < self.pressure[0] or pressures.max() > self.pressure[1]:
            return "pressure"
        return ""
