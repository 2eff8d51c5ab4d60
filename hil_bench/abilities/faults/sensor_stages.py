"""Effects of faults on a sensor's value and on its rate of change."""

import math
from typing import Protocol

from hil_bench.abilities.faults.words import BrokenReading
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
