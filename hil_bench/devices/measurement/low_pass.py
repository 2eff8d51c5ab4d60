"""Bandwidth and noise: exact low-passes, seeded streams, and noise of a given RMS."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from numpy.random import Generator

# Parameters of a measuring chain: data-sheet figures in SI, all of them off by default.
#
# The quantity's own unit, Pa or m, is written [q].


class OverRange(StrEnum):
    """The output of a chain beyond its range."""

    SATURATE = "saturate"
    INVALID = "invalid"


@dataclass(frozen=True, slots=True)
class ChainParameters:
    """One sensor's measuring chain, in the order of its stages.

    Attributes:
        hysteresis: width of the loop, up to down [q].
        offset_error: what is shown at 0 [q].
        gain_error: too much for each one of the quantity [-].
        offset_drift: growth of the offset error with temperature [q/K].
        gain_drift: growth of the gain error with temperature [1/K].
        temperature: points of time [s] and temperature above the reference temperature [K]: linear
            between them, constant beyond; none for the reference temperature.
        bandwidth: frequency of -3 dB [Hz]; 0 for no limit.
        order: of that low-pass, 1 or 2.
        damping_ratio: of the low-pass of order 2.
        sampling_period_ns: between two samples [ns]; 0 where each tick samples.
        sampling_phase_ns: of the first sample [ns].
        noise_density: of white noise before the low-pass, one-sided [q/√Hz].
        noise_rms: of white noise, independent from sample to sample [q].
        resolution: step of the shown value [q]; 0 for none.
        range: ends of what can be shown [q]; None for no ends.
        over_range: what is given beyond them.
        delay_ns: from a sample to its value [ns].
        speed_window_ns: over which speed is the mean of the measured movement [ns]; 0 where speed
            is that of the plant.
    """

    hysteresis: float = 0.0
    offset_error: float = 0.0
    gain_error: float = 0.0
    offset_drift: float = 0.0
    gain_drift: float = 0.0
    temperature: tuple[tuple[float, float], ...] = ()
    bandwidth: float = 0.0
    order: int = 1
    damping_ratio: float = 0.7
    sampling_period_ns: int = 0
    sampling_phase_ns: int = 0
    noise_density: float = 0.0
    noise_rms: float = 0.0
    resolution: float = 0.0
    range: tuple[float, float] | None = None
    over_range: OverRange = OverRange.SATURATE
    delay_ns: int = 0
    speed_window_ns: int = 0

    @property
    def is_ideal(self) -> bool:
        """True if every stage is off: the quantity is shown unchanged."""
        return not self.has_temperature and not (
            self.hysteresis
            or self.offset_error
            or self.gain_error
            or self.bandwidth
            or self.sampling_period_ns
            or self.noise_density
            or self.noise_rms
            or self.resolution
            or self.range
            or self.delay_ns
            or self.speed_window_ns
        )

    @property
    def has_temperature(self) -> bool:
        """True if temperature changes the measurement."""
        return bool(self.temperature and (self.offset_drift or self.gain_drift))


# Bandwidth: low-passes that are exact for an input that is linear from tick to tick.
#
# The plant's quantities are known at the ticks, the end of each included, so between two of them
# the input is a ramp (a first-order hold without delay), and the answer of the filter to it is
# known in closed form at any time of the tick. Such a filter is given its input at each tick by
# `advance`; `at` then gives its output at a time of the tick that has just gone by.

Transition = tuple[float, float, float, float]
"""Φ(t), row by row: what the free oscillation makes of error and error rate within t."""


class LowPass(Protocol):
    """A low-pass, which limits the bandwidth of a signal."""

    def settle(self, value: float) -> None:
        """Begin as if `value` had been the input for ever."""

    def advance(self, value: float) -> None:
        """Take the input at the end of the next tick."""

    def at(self, time: float) -> float:
        """Return the output at a time [s] since the start of the latest tick."""


class Unlimited:
    """No limit: the output is the input, linear from tick to tick."""

    def __init__(self, tick: float) -> None:
        self._tick = tick
        self.settle(0.0)

    def settle(self, value: float) -> None:
        """Begin with `value`."""
        self._from = self._to = value

    def advance(self, value: float) -> None:
        """Take the input at the end of the next tick."""
        self._from, self._to = self._to, value

    def at(self, time: float) -> float:
        """Return the input at a time [s] since the start of the latest tick."""
        if time == self._tick:
            return self._to
        return self._from + (self._to - self._from) * (time / self._tick)


class FirstOrderLowPass:
    """τ y' + y = u.

    Args:
        bandwidth: frequency of -3 dB [Hz].
        tick: time between two inputs [s].
    """

    def __init__(self, bandwidth: float, tick: float) -> None:
        self._time_constant = 1.0 / (2.0 * math.pi * bandwidth)
        self._tick = tick
        self._decay = math.exp(-tick / self._time_constant)
        self.settle(0.0)

    def settle(self, value: float) -> None:
        """Begin as if `value` had been the input for ever."""
        self._input = self._value = self._base = value
        self._slope = self._error = 0.0

    def advance(self, value: float) -> None:
        """Take the input at the end of the next tick."""
        slope = (value - self._input) / self._tick
        # After a long time the output of a ramp is the ramp, the time constant late.
        base = self._input - slope * self._time_constant
        error = self._value - base
        self._base, self._slope, self._error = base, slope, error
        self._value = base + slope * self._tick + error * self._decay
        self._input = value

    def at(self, time: float) -> float:
        """Return the output at a time [s] since the start of the latest tick."""
        if time == self._tick:
            return self._value
        decay = math.exp(-time / self._time_constant)
        return self._base + self._slope * time + self._error * decay


class SecondOrderLowPass:
    """y'' + 2 ζ ω y' + ω² y = ω² u.

    Args:
        bandwidth: frequency of -3 dB [Hz].
        damping_ratio: ζ.
        tick: time between two inputs [s].
    """

    def __init__(self, bandwidth: float, damping_ratio: float, tick: float) -> None:
        self._omega = natural_frequency(bandwidth, damping_ratio)
        self._damping_ratio = damping_ratio
        self._lag = 2.0 * damping_ratio / self._omega
        self._tick = tick
        self._transition = transition(self._omega, damping_ratio, tick)
        self.settle(0.0)

    def settle(self, value: float) -> None:
        """Begin as if `value` had been the input for ever."""
        self._input = self._value = self._base = value
        self._rate = self._slope = self._error = self._error_rate = 0.0

    def advance(self, value: float) -> None:
        """Take the input at the end of the next tick."""
        slope = (value - self._input) / self._tick
        base = self._input - slope * self._lag
        error, error_rate = self._value - base, self._rate - slope
        self._base, self._slope, self._error, self._error_rate = base, slope, error, error_rate
        p11, p12, p21, p22 = self._transition
        self._value = base + slope * self._tick + p11 * error + p12 * error_rate
        self._rate = slope + p21 * error + p22 * error_rate
        self._input = value

    def at(self, time: float) -> float:
        """Return the output at a time [s] since the start of the latest tick."""
        if time == self._tick:
            return self._value
        p11, p12, _, _ = transition(self._omega, self._damping_ratio, time)
        return self._base + self._slope * time + p11 * self._error + p12 * self._error_rate


def natural_frequency(bandwidth: float, damping_ratio: float) -> float:
    """Return ω [rad/s] of the second-order low-pass that is at -3 dB at `bandwidth` [Hz]."""
    skew = 1.0 - 2.0 * damping_ratio**2
    # sqrt(1 + skew²) + skew loses all digits for a large damping ratio; its inverse does not.
    return 2.0 * math.pi * bandwidth * math.sqrt(math.hypot(1.0, skew) - skew)


@lru_cache(maxsize=4096)
def transition(omega: float, damping_ratio: float, time: float) -> Transition:
    """Return Φ(t) of e'' + 2 ζ ω e' + ω² e = 0 for (e, e')."""
    sigma = damping_ratio * omega
    if damping_ratio < 1.0:
        frequency = omega * math.sqrt(1.0 - damping_ratio**2)
        decay = math.exp(-sigma * time)
        cosine = decay * math.cos(frequency * time)
        sine = decay * math.sin(frequency * time) / frequency
    elif damping_ratio == 1.0:
        cosine = math.exp(-sigma * time)
        sine = cosine * time
    else:
        spread = omega * math.sqrt(damping_ratio**2 - 1.0)
        # The slower of both poles is taken out, so that nothing overflows.
        slow = math.exp((spread - sigma) * time)
        cosine = 0.5 * slow * (1.0 + math.exp(-2.0 * spread * time))
        sine = -0.5 * slow * math.expm1(-2.0 * spread * time) / spread
    return cosine + sigma * sine, sine, -(omega**2) * sine, cosine - sigma * sine


# Noise: seeded streams, white noise of a given RMS, and noise that the bandwidth shapes.

Draw = Callable[[], float]
"""Gives the next number of a normal distribution with mean 0 and variance 1."""

_BLOCK = 256  # numbers drawn at once: a single one costs ten times as much


def random_stream(seed: int, *names: str) -> "Generator":
    """Return the random generator of what `names` name; another name gives an independent one."""
    from numpy.random import PCG64, Generator, SeedSequence  # noqa: PLC0415 - only who builds a bench needs it

    return Generator(PCG64(SeedSequence(seed, spawn_key=tuple("/".join(names).encode()))))


def normal_numbers(stream: "Generator") -> Draw:
    """Return a callable that draws from the stream; the numbers are those of single draws."""
    return _normal_numbers(stream).__next__


def _normal_numbers(stream: "Generator") -> Iterator[float]:
    while True:
        yield from stream.standard_normal(_BLOCK).tolist()


class WhiteNoise:
    """Noise that is independent from sample to sample."""

    def __init__(self, rms: float, draw: Draw) -> None:
        self._rms = rms
        self._draw = draw

    def add_to(self, value: float) -> float:
        """Return a sample with noise."""
        return value + self._rms * self._draw()


class FirstOrderNoise:
    """White noise after a low-pass of first order, exact at the samples.

    Args:
        density: one-sided, before the low-pass [1/√Hz].
        bandwidth: of the low-pass, -3 dB [Hz].
        period: between two samples [s].
        draw: where its numbers come from.
    """

    def __init__(self, density: float, bandwidth: float, period: float, draw: Draw) -> None:
        # π/2 times the bandwidth is the noise bandwidth of a first-order low-pass.
        rms = density * math.sqrt(0.5 * math.pi * bandwidth)
        self._decay = math.exp(-2.0 * math.pi * bandwidth * period)
        self._new = rms * math.sqrt(1.0 - self._decay**2)
        self._draw = draw
        self._value = rms * draw()

    def add_to(self, value: float) -> float:
        """Return a sample with noise."""
        self._value = self._decay * self._value + self._new * self._draw()
        return value + self._value


class SecondOrderNoise:
    """White noise after a low-pass of second order, exact at the samples.

    Args:
        density: one-sided, before the low-pass [1/√Hz].
        bandwidth: of the low-pass, -3 dB [Hz].
        damping_ratio: of the low-pass.
        period: between two samples [s].
        draw: where its numbers come from.
    """

    def __init__(
        self, density: float, bandwidth: float, damping_ratio: float, period: float, draw: Draw
    ) -> None:
        omega = natural_frequency(bandwidth, damping_ratio)
        # ω / (8 ζ) is the noise bandwidth [Hz]; the stationary covariance is diag(rms², ω² rms²).
        rms = density * math.sqrt(omega / (8.0 * damping_ratio))
        self._transition = p11, p12, p21, p22 = transition(omega, damping_ratio, period)
        # What is new in a period is what the free decay of the old leaves of that covariance.
        q11 = 1.0 - p11**2 - (omega * p12) ** 2
        q12 = -p11 * p21 - omega**2 * p12 * p22
        q22 = omega**2 - p21**2 - (omega * p22) ** 2
        self._new11 = rms * math.sqrt(max(q11, 0.0))
        self._new21 = rms * q12 / math.sqrt(q11) if q11 > 0.0 else 0.0
        self._new22 = math.sqrt(max(rms**2 * q22 - self._new21**2, 0.0))
        self._draw = draw
        self._value, self._rate = rms * draw(), omega * rms * draw()

    def add_to(self, value: float) -> float:
        """Return a sample with noise."""
        p11, p12, p21, p22 = self._transition
        noise, rate = self._value, self._rate
        first, second = self._draw(), self._draw()
        self._value = p11 * noise + p12 * rate + self._new11 * first
        self._rate = p21 * noise + p22 * rate + self._new21 * first + self._new22 * second
        return value + self._value
