"""A sensor's measuring chain, put together from its stages.

    quantity, at each tick
        hysteresis -> offset and gain error, temperature drift -> bandwidth
    samples, at the sensor's own times
        noise -> quantisation -> range -> delay
    value, at each tick: the latest that is there

A stage that is off is not called at all.
"""

from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

from hil_bench.devices.measurement.conversion import Quantisation, Range
from hil_bench.devices.measurement.low_pass import (
    FirstOrderLowPass,
    LowPass,
    SecondOrderLowPass,
    Unlimited,
)
from hil_bench.devices.measurement.noise import (
    Draw,
    FirstOrderNoise,
    SecondOrderNoise,
    WhiteNoise,
    normal_numbers,
)
from hil_bench.devices.measurement.parameters import ChainParameters
from hil_bench.devices.measurement.sensing_element import DriftingError, Hysteresis, LinearError
from hil_bench.devices.measurement.speed import SpeedEstimate

if TYPE_CHECKING:
    from numpy.random import Generator

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
