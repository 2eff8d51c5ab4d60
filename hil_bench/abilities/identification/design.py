"""Design of informative manoeuvres: the twin of the machine, bounds, strokes, set-points."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.commissioning.plan import Limits
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.model import (
    FullOrderPlant,
    PlantInput,
    PlantOptions,
    PlantParameters,
    Solver,
    balanced_state,
)

# The machine as it is known, run under set-points.

Values = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Twin:
    """The model of the machine.

    Attributes:
        axis: its name.
        parameters: as far as they are known.
        options: of the plant.
        step: of the solver [s].
        interval: between two rows of the recording [s].
        full_opening: spool position that a set-point of 1 stands for [m].
    """

    axis: str
    parameters: PlantParameters
    options: PlantOptions
    step: float
    interval: float
    full_opening: float

    def run(self, setpoints: Values, position: float) -> Values:
        """Return the states under set-points, from rest.

        Args:
            setpoints: of each row, as shares of the full opening, shape (rows,).
            position: at the start [m].

        Returns:
            Position, velocity and both pressures after each row, shape (rows, 4) [m, m/s, Pa, Pa].
        """
        every = max(1, round(self.interval / self.step))
        plant = FullOrderPlant(
            self.parameters,
            options=self.options,
            solver=Solver.LINEARLY_IMPLICIT_MIDPOINT,
            dt=self.interval / every,
            state=balanced_state(self.parameters, x=position, F_L=self.options.load_at(position)),
        )
        states = np.empty((len(setpoints), 4))
        for row, u in enumerate((setpoints * self.full_opening).tolist()):
            states[row] = plant.step(PlantInput(u), every)[:4]
        return states


# The bounds of a manoeuvre of the axis.

_KEPT_FREE = 0.1
"""Share of the way between the limits that stays free at each end.

The machine drifts otherwise than the model, since what is to be estimated is not known yet.
"""


class Bounds(NamedTuple):
    """Limits of a manoeuvre, with room for what is not known yet.

    Attributes:
        position: lowest and highest [m].
        speed: highest, either way [m/s].
        pressure: lowest and highest of either chamber [Pa].
    """

    position: tuple[float, float]
    speed: float
    pressure: tuple[float, float]

    @classmethod
    def of(cls, axis: CylinderConfig, limits: Limits | None) -> "Bounds":
        """Return the bounds of an axis by its stroke, and by the limits of a plan, if any."""
        h = axis.parameters.h
        limits = limits or Limits((-h, h), np.inf, (-np.inf, np.inf), np.inf)
        low, high = limits.position
        free = _KEPT_FREE * (high - low)
        return cls((low + free, high - free), (1.0 - _KEPT_FREE) * limits.speed, limits.pressure)

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
        is_inside = self.pressure[0] <= pressures.min() and pressures.max() <= self.pressure[1]
        return "" if is_inside else "pressure"


# A run of strokes from which `identify` learns most of what matters: both ways, three openings.

_SHARES = (1.0, 0.65, 0.35)  # of the largest opening, beyond the dead-zone
_OPENINGS = (0.9, 0.75, 0.6, 0.5, 0.4, 0.3, 0.25)  # largest ones, the first that stays within
_REST, _SHORTEST, _LONGEST = 0.35, 0.3, 2.5  # [s]
_PROBE = 0.3  # [s] over which the speed at an opening is taken
_USED = 0.8  # of the room to one side
_MOST_PAIRS = 2


class StrokeRun(NamedTuple):
    """A run of strokes.

    Attributes:
        axis: that it is for.
        interval: between two set-points [s].
        names: of the parts, in order, each with the time at which it begins [s].
        setpoints: of the run, as shares of the full opening, shape (rows,).
        states: that are expected, shape (rows, 4) [m, m/s, Pa, Pa].
        start: where the piston begins [m].
        openings: of the strokes, as shares of the full opening.
    """

    axis: str
    interval: float
    names: tuple[tuple[float, str], ...]
    setpoints: Values
    states: Values
    start: float
    openings: tuple[float, ...]

    @property
    def duration(self) -> float:
        """Of the run [s]."""
        return len(self.setpoints) * self.interval


def plan_strokes(twin: Twin, bounds: Bounds, duration: float) -> StrokeRun:
    """Return strokes both ways at three openings that stay within the bounds.

    Args:
        twin: of the machine as it is known.
        bounds: of the motion.
        duration: that the run may take [s].

    Raises:
        ConfigError: no opening stays within the bounds, or the time is too short.
    """
    dead = twin.parameters.beta / twin.full_opening
    left, shortest = "position", np.inf
    for largest in _OPENINGS:
        openings = tuple(dead + share * (largest - dead) for share in _SHARES)
        if openings[-1] <= dead:
            continue
        for pairs in range(_MOST_PAIRS, 0, -1):
            names, setpoints = _join(twin, bounds, openings, pairs)
            shortest = min(shortest, len(setpoints) * twin.interval)
            if len(setpoints) * twin.interval > duration:
                continue
            states = twin.run(setpoints, bounds.middle)
            left = bounds.leaves(states)
            if left:
                break
            return StrokeRun(
                twin.axis, twin.interval, names, setpoints, states, bounds.middle, openings
            )
    if shortest > duration:
        raise ConfigError(f"--duration: is too short; the shortest run takes {shortest:.1f} s")
    raise ConfigError(
        f"--design: strokes of any opening would leave the limits, the last that of {left}; give "
        "wider [limits]"
    )


def _join(
    twin: Twin, bounds: Bounds, openings: tuple[float, ...], pairs: int
) -> tuple[tuple[tuple[float, str], ...], Values]:
    """Return strokes to both sides of the middle, pair by pair, with rests."""
    rest = np.zeros(round(_REST / twin.interval))
    parts, names, rows = [rest], [], len(rest)
    for opening in sorted(openings):
        speeds = {way: _speed(twin, bounds, way * opening) for way in (1.0, -1.0)}
        # The slower way has its time, and the other goes as far.
        way_m = min(_USED * bounds.room, _LONGEST * min(speeds.values()))
        names.append((rows * twin.interval, f"strokes of {100.0 * opening:.0f} %"))
        for first in (1.0, -1.0) * pairs:
            for way in (first, -first):
                seconds = max(way_m / speeds[way], _SHORTEST)
                stroke = np.full(max(1, round(seconds / twin.interval)), way * opening)
                parts += [stroke, rest]
                rows += len(stroke) + len(rest)
    return tuple(names), np.concatenate(parts)


def _speed(twin: Twin, bounds: Bounds, opening: float) -> float:
    """Return the speed that an opening gives [m/s]."""
    probe = np.full(max(4, round(_PROBE / twin.interval)), opening)
    states = twin.run(probe, bounds.middle)
    return max(float(np.abs(states[len(probe) // 2 :, 1]).mean()), 1e-4)


# The set-points of a run as a course of few points, straight between.

_STRAIGHT = 1e-9  # of the full opening
_DIGITS = 6


def shorten_course(setpoints: Values, interval: float) -> list[tuple[float, float]]:
    """Return times [s] and values that lead through all set-points on straight lines.

    Args:
        setpoints: of each row, shape (rows,).
        interval: between two rows [s].
    """
    bends = np.abs(np.diff(setpoints, n=2)) > _STRAIGHT
    kept = np.flatnonzero(np.concatenate([[True], bends, [True]]))
    return [
        (round(row * interval, 9), round(float(setpoints[row]), _DIGITS)) for row in kept.tolist()
    ]
