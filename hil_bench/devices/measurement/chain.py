"""A sensor's measuring chain, put together from its stages.

    quantity, at each tick
        hysteresis -> offset and gain error, temperature drift -> bandwidth
    samples, at the sensor's own times
        noise -> quantisation -> range -> delay
    value, at each tick: the latest that is there

A stage that is off is not called at all.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from hil_bench.devices.measurement.low_pass import (
    ChainParameters,
    Draw,
    FirstOrderLowPass,
    FirstOrderNoise,
    LowPass,
    OverRange,
    SecondOrderLowPass,
    SecondOrderNoise,
    Unlimited,
    WhiteNoise,
    normal_numbers,
)

if TYPE_CHECKING:
    from numpy.random import Generator


# The stages of the converter: quantisation and range.


class Quantisation:
    """Values in whole steps."""

    def __init__(self, step: float) -> None:
        self._step = step

    def convert(self, value: float) -> float:
        """Return the nearest step; of two that are as near, the even one."""
        return round(value / self._step) * self._step


class Range:
    """Ends beyond which there is no other value, or none."""

    def __init__(self, low: float, high: float, over_range: OverRange) -> None:
        self._low, self._high = low, high
        is_saturating = over_range is OverRange.SATURATE
        self._below = low if is_saturating else math.nan
        self._above = high if is_saturating else math.nan

    def convert(self, value: float) -> float:
        """Return the value within the range; beyond it, the end of the range or NaN."""
        if value > self._high:
            return self._above
        if value < self._low:
            return self._below
        return value


# Speed as a position sensor finds it: from the positions that it has measured.


class SpeedEstimate:
    """Mean speed over the latest samples of a position.

    Args:
        window: over which the mean is taken [s]; at least one period of the samples is.
        period: between two samples [s].

    Attributes:
        value: the mean speed; 0 before there is a second sample.
    """

    def __init__(self, window: float, period: float) -> None:
        intervals = max(1, round(window / period))
        self._positions: deque[float] = deque(maxlen=intervals + 1)
        self._period = period
        self.value = 0.0

    def take(self, position: float) -> None:
        """Take the next sample."""
        positions = self._positions
        positions.append(position)
        if len(positions) > 1:
            self.value = (position - positions[0]) / ((len(positions) - 1) * self._period)


# The stages of the sensing element: hysteresis, and the errors of offset and gain.


class Hysteresis:
    """Backlash between quantity and element: the play operator.

    Args:
        width: of the loop, from the rising to the falling branch.
    """

    def __init__(self, width: float) -> None:
        self._reach = 0.5 * width
        self._value: float | None = None

    def follow(self, quantity: float) -> float:
        """Return the output of the element; at first it is in the middle of the loop."""
        if self._value is None:
            self._value = quantity
        elif quantity - self._value > self._reach:
            self._value = quantity - self._reach
        elif self._value - quantity > self._reach:
            self._value = quantity + self._reach
        return self._value


class LinearError:
    """Errors of offset and gain that do not change."""

    def __init__(self, offset: float, gain: float) -> None:
        self._offset = offset
        self._factor = 1.0 + gain

    def follow(self, quantity: float) -> float:
        """Return the quantity with both errors."""
        return quantity * self._factor + self._offset


class DriftingError:
    """Errors of offset and gain that grow with the temperature.

    Args:
        offset: at the reference temperature.
        gain: at the reference temperature.
        offset_drift: growth of the offset [1/K].
        gain_drift: growth of the gain [1/K].
        temperature: points of time [s] and temperature above the reference [K], one or more.
        period: time from one call of `follow` to the next [s].
    """

    def __init__(
        self,
        offset: float,
        gain: float,
        *,
        offset_drift: float,
        gain_drift: float,
        temperature: Sequence[tuple[float, float]],
        period: float,
    ) -> None:
        self._offset, self._gain = offset, gain
        self._offset_drift, self._gain_drift = offset_drift, gain_drift
        self._temperature = TemperatureSeries(temperature)
        self._period = period
        self._calls = 0

    def follow(self, quantity: float) -> float:
        """Return the quantity with both errors at the present temperature."""
        warmth = self._temperature.at(self._calls * self._period)
        self._calls += 1
        gain = self._gain + self._gain_drift * warmth
        return quantity + quantity * gain + self._offset + self._offset_drift * warmth


class TemperatureSeries:
    """A temperature over time, for times that do not go back."""

    def __init__(self, points: Sequence[tuple[float, float]]) -> None:
        self._rest = list(reversed(points))
        self._before = self._after = self._rest[-1]

    def at(self, time: float) -> float:
        """Return the temperature [K] at a time [s]: linear between points, constant beyond."""
        while self._rest and self._rest[-1][0] <= time:
            self._before = self._rest.pop()
            self._after = self._rest[-1] if self._rest else self._before
        start, value = self._before
        end, next_value = self._after
        if time <= start or end <= start:
            return value
        return value + (next_value - value) * ((time - start) / (end - start))


Stage = Callable[[float], float]

_S_PER_NS = 1e-9


class MeasuringChain:
    """The chain of one sensor.

    Its time is 0 in the first call of `measure`, and before that the quantity did not change.

    Args:
        parameters: of the stages.
        tick_ns: time between two calls of `measure` [ns].
        stream: where noise comes from.
    """

    def __init__(self, parameters: ChainParameters, tick_ns: int, stream: "Generator") -> None:
        self._tick_ns = tick_ns
        self._period_ns = parameters.sampling_period_ns or tick_ns
        self._delay_ns = parameters.delay_ns
        phase_ns = parameters.sampling_phase_ns
        if not parameters.sampling_period_ns:
            # Without a clock of its own, a sensor shows at each tick what was the delay ago.
            phase_ns = -parameters.delay_ns % tick_ns
        self._sample_ns = phase_ns or self._period_ns
        self._now_ns = -tick_ns
        tick, period = tick_ns * _S_PER_NS, self._period_ns * _S_PER_NS
        self._element = element_stages(parameters, tick)
        self._low_pass = low_pass(parameters, tick)
        self._converter = converter_stages(parameters, period, normal_numbers(stream))
        self._waiting: deque[tuple[int, float]] = deque()
        self._value = 0.0
        self._speed: SpeedEstimate | None = None
        if parameters.speed_window_ns:
            self._speed = SpeedEstimate(parameters.speed_window_ns * _S_PER_NS, period)

    def measure(self, quantity: float) -> float:
        """Take the quantity at the end of the next tick; return the value that is there then.

        NaN stands for no value.
        """
        for follow in self._element:
            quantity = follow(quantity)
        then = self._now_ns
        now = self._now_ns = then + self._tick_ns
        if then < 0:
            self._begin(quantity)
            return self._value
        self._low_pass.advance(quantity)
        waiting = self._waiting
        while self._sample_ns <= now:
            sample = self._low_pass.at((self._sample_ns - then) * _S_PER_NS)
            waiting.append((self._sample_ns + self._delay_ns, self._convert(sample)))
            self._sample_ns += self._period_ns
        while waiting and waiting[0][0] <= now:
            self._show(waiting.popleft()[1])
        return self._value

    def speed(self, quantity: float) -> float:
        """Return the measured speed; `quantity`, the true one, where the chain finds none."""
        return quantity if self._speed is None else self._speed.value

    def _begin(self, quantity: float) -> None:
        self._low_pass.settle(quantity)
        self._show(self._convert(quantity))

    def _convert(self, sample: float) -> float:
        for convert in self._converter:
            sample = convert(sample)
        return sample

    def _show(self, value: float) -> None:
        self._value = value
        if self._speed is not None:
            self._speed.take(value)


def element_stages(parameters: ChainParameters, tick: float) -> tuple[Stage, ...]:
    """Return the stages before the low-pass that are on, in their order."""
    stages: list[Stage] = []
    if parameters.hysteresis:
        stages.append(Hysteresis(parameters.hysteresis).follow)
    offset, gain = parameters.offset_error, parameters.gain_error
    if parameters.has_temperature:
        error = DriftingError(
            offset,
            gain,
            offset_drift=parameters.offset_drift,
            gain_drift=parameters.gain_drift,
            temperature=parameters.temperature,
            period=tick,
        )
        stages.append(error.follow)
    elif offset or gain:
        stages.append(LinearError(offset, gain).follow)
    return tuple(stages)


def low_pass(parameters: ChainParameters, tick: float) -> LowPass:
    """Return the low-pass that limits the bandwidth."""
    if not parameters.bandwidth:
        return Unlimited(tick)
    if parameters.order == 1:
        return FirstOrderLowPass(parameters.bandwidth, tick)
    return SecondOrderLowPass(parameters.bandwidth, parameters.damping_ratio, tick)


def converter_stages(parameters: ChainParameters, period: float, draw: Draw) -> tuple[Stage, ...]:
    """Return the stages of a sample that are on, in their order."""
    stages: list[Stage] = []
    if parameters.noise_density:
        stages.append(shaped_noise(parameters, period, draw))
    if parameters.noise_rms:
        stages.append(WhiteNoise(parameters.noise_rms, draw).add_to)
    if parameters.resolution:
        stages.append(Quantisation(parameters.resolution).convert)
    if parameters.range is not None:
        stages.append(Range(*parameters.range, parameters.over_range).convert)
    return tuple(stages)


def shaped_noise(parameters: ChainParameters, period: float, draw: Draw) -> Stage:
    """Return the noise that a density before the low-pass makes behind it."""
    density, bandwidth = parameters.noise_density, parameters.bandwidth
    if parameters.order == 1:
        return FirstOrderNoise(density, bandwidth, period, draw).add_to
    damping_ratio = parameters.damping_ratio
    return SecondOrderNoise(density, bandwidth, damping_ratio, period, draw).add_to
