"""Up to which residual a twin follows its machine."""

import math
from collections.abc import Mapping

from hil_bench.config import BenchConfig, EncoderConfig, PressureConfig
from hil_bench.measurement.parameters import ChainParameters

BASES: Mapping[str, float] = {
    "position": 0.5e-3,
    "P_A": 0.25e5,
    "P_B": 0.25e5,
    "spool_position": 0.03,
}
"""RMS that noise-free sensors keep while frames come in time, in SI units.

A command that is late by 2 ms moves the piston by 0.5 mm at 0.25 m/s.
"""

_PUNCTUAL = 2e-3
"""Lateness of frames up to which the limits hold; more widens them, in proportion [s]."""
_NOISE = 3.0
"""How many standard deviations of a sensor's noise come to that."""
_FIRST_ORDER = 0.5 * math.pi
"""Bandwidth of white noise behind a low-pass of first order, by its frequency of -3 dB."""


def fit_limits(config: BenchConfig) -> dict[str, dict[str, float]]:
    """Return the limits of each axis by quantity, for the sensors that a configuration gives it."""
    limits = {axis.name: dict(BASES) for axis in config.axes}
    for node in config.nodes:
        match node:
            case PressureConfig(axis=str(axis)):
                quantity = node.source.value
            case EncoderConfig(axis=str(axis)):
                quantity = "position"
            case _:
                continue
        fitted = math.hypot(BASES[quantity], _NOISE * noise_of(node.chain))
        limits[axis][quantity] = max(limits[axis][quantity], fitted)
    return limits


def noise_of(chain: ChainParameters) -> float:
    """Return the standard deviation of a measuring chain's noise, in the quantity's unit."""
    return math.hypot(
        chain.noise_rms, chain.noise_density * math.sqrt(_FIRST_ORDER * chain.bandwidth)
    )


def widening(lateness: float) -> float:
    """Return by how much the limits grow if frames came late: the commands did so, too.

    Args:
        lateness: of a window's frames [s].
    """
    return max(1.0, lateness / _PUNCTUAL)
