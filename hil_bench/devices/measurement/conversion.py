"""The stages of the converter: quantisation and range."""

import math

from hil_bench.devices.measurement.parameters import OverRange


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
