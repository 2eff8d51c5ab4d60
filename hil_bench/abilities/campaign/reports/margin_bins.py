"""Bins of margins: zero is an edge, so that no bin holds both what holds and what fails."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

LARGEST = 3.0
"""A margin that has a bin, as a share of the tolerance; larger ones are counted beside them."""

_BINS = 30
_ROUND = (1.0, 2.0, 2.5, 5.0, 10.0)


class Bins(NamedTuple):
    """Margins in bins of one width.

    Attributes:
        low: lower edge of the first bin.
        high: upper edge of the last bin.
        counts: margins of each bin.
        below: margins below the first bin, infinite ones too.
        above: margins above the last bin, likewise.
    """

    low: float
    high: float
    counts: list[int]
    below: int
    above: int


def bin_margins(margins: Sequence[float]) -> Bins:
    """Return the bins of some margins, each as a share of the tolerance; NaN is left out."""
    values = np.asarray([each for each in margins if not math.isnan(each)], dtype=np.float64)
    inside = values[np.abs(values) <= LARGEST]
    low = min(0.0, float(inside.min(initial=0.0)))
    high = max(0.0, float(inside.max(initial=0.0)))
    step = _step((high - low) / _BINS)
    first, last = math.floor(low / step), max(math.floor(high / step) + 1, 1)
    edges = np.arange(first, last + 1) * step
    counts, _ = np.histogram(inside, edges)
    below, above = int((values < -LARGEST).sum()), int((values > LARGEST).sum())
    return Bins(float(edges[0]), float(edges[-1]), [int(each) for each in counts], below, above)


def _step(raw: float) -> float:
    """Return the next larger round number."""
    if raw <= 0.0:
        return 0.01
    size = 10.0 ** math.floor(math.log10(raw))
    return next(each * size for each in _ROUND if each * size >= raw * (1.0 - 1e-9))
