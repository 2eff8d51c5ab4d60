"""A value that follows its target at limited speed, as the ramps of CiA 408 (0x6330 to 0x6336) do.

Speeding up is the way from 0, slowing down the way to 0; each has a time for the positive and
for the negative side. A time is that of the way between 0 and 100 %, so that a ramp's steepness
does not depend on the set-point. A way through 0 slows down on one side and speeds up on the
other.

The value moves towards the target that it has known since the last call: a target that is new
at one tick begins to act there, and a ramp of 100 ms ends 100 ms later, at that tick.
"""

import math
from typing import Final, NamedTuple

_ARRIVED: Final = 1e-6
"""Distance to the target that is nothing but rounding [increments]."""


class RampTimes(NamedTuple):
    """Times of the four quadrants [ns for one increment]; 0 is no ramp."""

    speed_up_positive: float = 0.0
    speed_up_negative: float = 0.0
    slow_down_positive: float = 0.0
    slow_down_negative: float = 0.0

    def of(self, value: float, goal: float) -> float:
        """Return the time that holds from `value` to `goal`, which are not on different sides."""
        is_positive = value > 0.0 or goal > 0.0
        if abs(goal) > abs(value):
            return self.speed_up_positive if is_positive else self.speed_up_negative
        return self.slow_down_positive if is_positive else self.slow_down_negative


def advance(value: float, target: float, elapsed: float, times: RampTimes) -> float:
    """Return the value on the way from `value` to `target` after `elapsed` [ns]."""
    while value != target:
        goal = 0.0 if value * target < 0.0 else target
        time = times.of(value, goal)
        needed = abs(goal - value) * time
        if needed - elapsed > _ARRIVED * time:
            return value + math.copysign(elapsed / time, goal - value)
        value, elapsed = goal, max(elapsed - needed, 0.0)
    return value


class Ramp:
    """The ramp of one valve.

    Attributes:
        times: of its four quadrants.
        is_running: whether the value is still on its way.
    """

    def __init__(self) -> None:
        self.times = RampTimes()
        self.is_running = False
        self._value = self._target = 0.0
        self._then = 0

    def follow(self, target: float, now: int) -> float:
        """Return the value at `now` [ns], and aim at `target` from now on."""
        value = advance(self._value, self._target, now - self._then, self.times)
        self._value = advance(value, target, 0.0, self.times)
        self._target, self._then = target, now
        self.is_running = self._value != target
        return self._value

    def restart(self, value: float) -> None:
        """Stand still at `value`."""
        self._value = self._target = value
        self.is_running = False
