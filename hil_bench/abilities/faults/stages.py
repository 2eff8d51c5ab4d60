"""Stages that faults put into signals: of sensors, with their rate of change, and of spools."""

import math
from typing import Protocol

from hil_bench.abilities.faults.checks import BrokenReading
from hil_bench.devices.measurement.low_pass import Draw, FirstOrderLowPass


class SensorStage(Protocol):
    """One fault of one sensor."""

    def value(self, value: float) -> float:
        """Return the measured value in place of `value`; called once a tick."""

    def rate(self, rate: float) -> float:
        """Return the measured rate of change in place of `rate`; called after `value`."""


class Frozen:
    """The first value stays, and does not change."""

    def __init__(self) -> None:
        self._value: float | None = None

    def value(self, value: float) -> float:
        """Return the first value."""
        if self._value is None:
            self._value = value
        return self._value

    def rate(self, rate: float) -> float:  # noqa: ARG002 - what stands has no speed
        """Return 0."""
        return 0.0


class Shifted:
    """The value is off by an amount that grows.

    Args:
        offset: at the first tick.
        slope: growth [1/s].
        tick: time between two calls [s].
    """

    def __init__(self, offset: float, slope: float, tick: float) -> None:
        self._offset, self._slope, self._tick = offset, slope, tick
        self._calls = 0

    def value(self, value: float) -> float:
        """Return the value and the present amount."""
        offset = self._offset + self._slope * self._calls * self._tick
        self._calls += 1
        return value + offset

    def rate(self, rate: float) -> float:
        """Return the rate and that of the amount."""
        return rate + self._slope


class Noisy:
    """Noise is added to the value; its rate stays."""

    def __init__(self, rms: float, draw: Draw) -> None:
        self._rms, self._draw = rms, draw

    def value(self, value: float) -> float:
        """Return the value with noise."""
        return value + self._rms * self._draw()

    def rate(self, rate: float) -> float:
        """Return the rate."""
        return rate


class Broken:
    """Nothing is measured any more: there is no value, or one beyond every range."""

    def __init__(self, reading: BrokenReading) -> None:
        readings = {
            BrokenReading.NOTHING: math.nan,
            BrokenReading.LOW: -math.inf,
            BrokenReading.HIGH: math.inf,
        }
        self._reading = readings[reading]

    def value(self, value: float) -> float:  # noqa: ARG002 - the wire is broken
        """Return NaN, or an infinity."""
        return self._reading

    def rate(self, rate: float) -> float:  # noqa: ARG002 - the wire is broken
        """Return NaN."""
        return math.nan


class Lag:
    """A first-order lag, which leaves out what is no number.

    Args:
        time_constant: of the lag [s].
        tick: time between two calls [s].
        start: where it begins; without it, settled at the first value.
    """

    def __init__(self, time_constant: float, tick: float, start: float | None = None) -> None:
        self._low_pass = FirstOrderLowPass(1.0 / (2.0 * math.pi * time_constant), tick)
        self._tick = tick
        self._is_settled = start is not None
        self._low_pass.settle(start or 0.0)

    def follow(self, value: float) -> float:
        """Return the value behind the low-pass."""
        if not math.isfinite(value):
            return value
        if not self._is_settled:
            self._low_pass.settle(value)
            self._is_settled = True
        self._low_pass.advance(value)
        return self._low_pass.at(self._tick)


class Slowed:
    """Value and rate come late, by a first-order lag."""

    def __init__(self, time_constant: float, tick: float) -> None:
        self.value = Lag(time_constant, tick).follow
        self.rate = Lag(time_constant, tick).follow


class Growth:
    """An amount that grows from tick to tick.

    Args:
        full: what it comes to.
        ticks: how long that takes; 0 for at once.
    """

    def __init__(self, full: float, ticks: int) -> None:
        self._full, self._ticks = full, ticks
        self._passed = 0

    @property
    def is_full(self) -> bool:
        """True if it has grown to its full size."""
        return self._passed > self._ticks

    def next(self) -> float:
        """Return the amount of the next tick."""
        share = 1.0 if self._passed >= self._ticks else self._passed / self._ticks
        self._passed += 1
        return self._full * share


class Bound:
    """A silted spool: it moves once its set-point is off by a band, and then all the way.

    Args:
        band: how far the set-point must be off [m], which grows.
        position: where the spool is at first [m].
    """

    def __init__(self, band: Growth, position: float) -> None:
        self._band, self._position = band, position

    def follow(self, setpoint: float) -> float:
        """Return the position of the spool [m] for a set-point [m]."""
        if abs(setpoint - self._position) > self._band.next():
            self._position = setpoint
        return self._position


class Weak:
    """Solenoids without their full force: the spool goes no further than a share of its stroke.

    Args:
        loss: share of the stroke that is lost, which grows.
        full: spool position of 100 % [m].
    """

    def __init__(self, loss: Growth, full: float) -> None:
        self._loss, self._full = loss, full

    def follow(self, setpoint: float) -> float:
        """Return the position of the spool [m] for a set-point [m]."""
        reach = self._full * (1.0 - self._loss.next())
        return min(max(setpoint, -reach), reach)
