"""Parameters of a measuring chain: data-sheet figures in SI, all of them off by default.

The quantity's own unit, Pa or m, is written [q].
"""

from dataclasses import dataclass
from enum import StrEnum


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
