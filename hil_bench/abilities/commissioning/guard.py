"""Samples of an axis against the limits of a step."""

import math
from typing import NamedTuple

from hil_bench.abilities.commissioning.plan import NEAR_STOP, Limits
from hil_bench.errors import HilBenchError


class LimitError(HilBenchError):
    """A step left one of its limits, and the valve was closed."""


class Sample(NamedTuple):
    """The drivers' values at one moment; the fields of `SAMPLE_CHANNELS`, in SI units."""

    time: float
    position: float
    speed: float
    pressure_a: float
    pressure_b: float
    spool_setpoint: float
    spool_position: float


def check_sample(sample: Sample, limits: Limits) -> None:
    """Compare a sample with the limits; a `LimitError` says which it is beyond, or what is none."""
    _check_range("position", sample.position, limits.position, 1e-3, "mm")
    _check_range("speed", sample.speed, (-limits.speed, limits.speed), 1e-3, "mm/s")
    _check_range("pressure at A", sample.pressure_a, limits.pressure, 1e5, "bar")
    _check_range("pressure at B", sample.pressure_b, limits.pressure, 1e5, "bar")
    if limits.contact_speed is not None:
        low, high = limits.position
        lowest = -limits.contact_speed if sample.position < low + NEAR_STOP else -math.inf
        highest = limits.contact_speed if sample.position > high - NEAR_STOP else math.inf
        _check_range("speed at the end stop", sample.speed, (lowest, highest), 1e-3, "mm/s")


def _check_range(
    what: str, value: float, limits: tuple[float, float], factor: float, unit: str
) -> None:
    """Compare a value with its limits.

    Raises:
        LimitError: it is beyond them, or no number.
    """
    low, high = limits
    if math.isnan(value):
        raise LimitError(f"{what} is not valid by the status of its sensor")
    if not low <= value <= high:
        beyond = low if value < low else high
        raise LimitError(
            f"{what} {value / factor:.4g} {unit} is beyond its limit of {beyond / factor:g} {unit}"
        )
