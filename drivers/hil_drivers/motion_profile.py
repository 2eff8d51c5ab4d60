"""Smooth moves from point to point.

Each move is the quintic s(r) = 10 r³ - 15 r⁴ + 6 r⁵ of its time fraction r, which starts and ends
at rest and without acceleration; its greatest speed is 15/8 D / T and its greatest acceleration
10/√3 D / T² for a distance D in a time T.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import NamedTuple

PEAK_SPEED = 15 / 8
PEAK_ACCELERATION = 10 / math.sqrt(3)


class SetPoint(NamedTuple):
    """A set-point of the piston: position [m], speed [m/s], acceleration [m/s²]."""

    position: float
    speed: float
    acceleration: float


class Move(NamedTuple):
    """One move: from and to [m], in a time [s]."""

    origin: float
    target: float
    time: float

    def at(self, time: float) -> SetPoint:
        """Return the set-point at `time` [s] from the move's start; before it, at its origin."""
        if time >= self.time:
            return SetPoint(self.target, 0.0, 0.0)
        if time <= 0:
            return SetPoint(self.origin, 0.0, 0.0)
        r = time / self.time
        distance = self.target - self.origin
        mean_speed = distance / self.time
        return SetPoint(
            self.origin + distance * r**3 * (10 - 15 * r + 6 * r**2),
            mean_speed * 30 * r**2 * (1 - r) ** 2,
            mean_speed / self.time * 60 * r * (1 - r) * (1 - 2 * r),
        )


class MotionProfile:
    """Moves through waypoints, with a rest after each.

    Args:
        start: position at time 0 [m].
        waypoints: positions to move to, one after the other [m].
        speed: greatest speed [m/s].
        acceleration: greatest acceleration [m/s²].
        dwell: rest at each waypoint [s].
        repeat: go on from the last waypoint to the first one, for ever.

    Attributes:
        duration: time until the last waypoint's rest is over, the first time round [s].

    Raises:
        ValueError: no waypoint, a number that is not finite, or a limit that is not positive.
    """

    def __init__(
        self,
        start: float,
        waypoints: Sequence[float],
        *,
        speed: float,
        acceleration: float,
        dwell: float = 0.5,
        repeat: bool = False,
    ) -> None:
        if not waypoints or not all(map(math.isfinite, (start, *waypoints))):
            raise ValueError(
                f"start {start}, waypoints {list(waypoints)}: finite positions are right"
            )
        if not (0 < speed < math.inf and 0 < acceleration < math.inf and 0 <= dwell < math.inf):
            raise ValueError(
                f"speed {speed} m/s, acceleration {acceleration} m/s², dwell {dwell} s: "
                "positive limits and a dwell of 0 or more are right"
            )
        points = [start, *waypoints, *(waypoints[:1] if repeat else ())]
        self._moves = [
            Move(origin, target, shortest_time(target - origin, speed, acceleration))
            for origin, target in pairwise(points)
        ]
        ends = list(accumulate(move.time + dwell for move in self._moves))
        self._starts = [0.0, *ends[:-1]]
        self.duration = ends[len(waypoints) - 1]
        # Round again: the way back to the first waypoint takes the place of the way to it.
        self._loop = (ends[0], ends[-1]) if repeat and ends[-1] > ends[0] else None

    def at(self, time: float) -> SetPoint:
        """Return the set-point at `time` [s]: before 0 the start, past the end the last point."""
        if self._loop is not None and time >= self._loop[1]:
            first, last = self._loop
            time = first + math.fmod(time - first, last - first)
        number = max(bisect_right(self._starts, time) - 1, 0)
        return self._moves[number].at(time - self._starts[number])


def shortest_time(distance: float, speed: float, acceleration: float) -> float:
    """Return the least time [s] for a distance [m] within speed [m/s] and acceleration [m/s²]."""
    distance = abs(distance)
    return max(
        PEAK_SPEED * distance / speed, math.sqrt(PEAK_ACCELERATION * distance / acceleration)
    )
