"""A run of strokes from which `identify` learns most of what matters: both ways, three openings."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.design.bounds import Bounds
from hil_bench.abilities.identification.design.twin import Twin
from hil_bench.errors import ConfigError

Values = npt.NDArray[np.float64]

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
