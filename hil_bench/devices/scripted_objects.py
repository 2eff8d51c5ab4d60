"""Objects that follow a script: a course over time, or another object that the bus writes.

So a device made from its EDS file lives without any plant behind it.
"""

import bisect
import math
from dataclasses import dataclass
from typing import Protocol

from hil_bench.canopen_device.object_dictionary import Variable
from hil_bench.devices.bound_objects import QuantitySource

_NS = 1e-9


class Course(Protocol):
    """The course of an object's value over time."""

    def value_at(self, time: float) -> float:
        """Return the value at a time since the start of the bench [s]."""


@dataclass(frozen=True, slots=True)
class Points:
    """Straight lines between points, constant before the first and behind the last.

    Attributes:
        times: rising, 0 or more [s].
        values: as many.
        repeats: whether the last point is the first again.
    """

    times: tuple[float, ...]
    values: tuple[float, ...]
    repeats: bool = False

    def value_at(self, time: float) -> float:
        """Return the value at a time [s]."""
        last = self.times[-1]
        if self.repeats and last > 0.0:
            time = math.fmod(time, last)
        place = bisect.bisect_right(self.times, time)
        if place == 0:
            return self.values[0]
        if place == len(self.times):
            return self.values[-1]
        start, end = self.times[place - 1], self.times[place]
        share = (time - start) / (end - start)
        return self.values[place - 1] + share * (self.values[place] - self.values[place - 1])


@dataclass(frozen=True, slots=True)
class Sine:
    """A sine around an offset.

    Attributes:
        amplitude: of the sine.
        offset: its mean.
        period: of the sine [s].
        phase: at the start [rad].
    """

    amplitude: float
    offset: float
    period: float
    phase: float = 0.0

    def value_at(self, time: float) -> float:
        """Return the value at a time [s]."""
        angle = 2.0 * math.pi * math.fmod(time / self.period, 1.0) + self.phase
        return self.offset + self.amplitude * math.sin(angle)


class ScriptedCourse:
    """An object that shows a course over time.

    Args:
        shown: the object.
        course: what it shows.
    """

    def __init__(self, shown: QuantitySource, course: Course) -> None:
        self._shown, self._course = shown, course
        self._start: int | None = None

    def advance(self, now: int) -> None:
        """Show what the course has at `now` [ns]; the first call is its start."""
        if self._start is None:
            self._start = now
        self._shown.publish(self._course.value_at((now - self._start) * _NS), now)


class ScriptedFollower:
    """An object that follows another one of its node, such as an output that the bus writes.

    Args:
        shown: the object, with scale and offset.
        followed: what it follows.
        lag: time constant with which it does [s]; 0 for at once.
    """

    def __init__(self, shown: QuantitySource, followed: Variable, lag: float) -> None:
        self._shown, self._followed, self._lag = shown, followed, lag
        self._value = float(followed.value)
        self._last: int | None = None

    def advance(self, now: int) -> None:
        """Follow up to `now` [ns]."""
        target = float(self._followed.value)
        passed = 0.0 if self._last is None else (now - self._last) * _NS
        self._last = now
        share = 1.0 if self._lag == 0.0 else -math.expm1(-passed / self._lag)
        self._value += share * (target - self._value)
        if not math.isfinite(self._value):  # REAL objects may hold NaN: it passes with its cause
            self._value = target
        self._shown.publish(self._value, now)
