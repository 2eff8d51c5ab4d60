"""Noise: seeded streams, white noise of a given RMS, and noise that the bandwidth shapes."""

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from hil_bench.devices.measurement.low_pass import natural_frequency, transition

if TYPE_CHECKING:
    from numpy.random import Generator

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
