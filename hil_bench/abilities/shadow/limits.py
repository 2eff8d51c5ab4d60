"""Up to which residual a twin follows its machine."""

import math

from hil_bench.bench.configuration import BenchConfig
from hil_bench.devices.measurement.parameters import ChainParameters

_PUNCTUAL = 2e-3
"""Lateness of frames up to which the limits hold; more widens them, in proportion [s]."""
_NOISE = 3.0
"""How many standard deviations of a sensor's noise come to that."""
_FIRST_ORDER = 0.5 * math.pi
"""Bandwidth of white noise behind a low-pass of first order, by its frequency of -3 dB."""


def fit_limits(config: BenchConfig) -> dict[str, dict[str, float]]:
    """Return the limits of each axis by quantity, for the sensors that a configuration gives it."""
    limits = {
        axis.name: {
            quantity.name: quantity.residual
            for quantity in axis.kind.quantities
            if quantity.residual is not None
        }
        for axis in config.axes
    }
    bases = {axis: dict(of_axis) for axis, of_axis in limits.items()}
    for node in config.nodes:
        quantity, axis = node.kind.measured(node), str(node.axis)
        chain = getattr(node, "chain", None)
        if quantity is None or chain is None or quantity not in bases.get(axis, {}):
            continue
        fitted = math.hypot(bases[axis][quantity], _NOISE * noise_of(chain))
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
