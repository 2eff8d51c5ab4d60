"""Errors of prediction in the units of a user: of the position, the speed, a pressure, a time."""

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.errors import ConfigError

Values = npt.NDArray[np.float64]

_LEAST = 2e-3  # [m] of travel, or a stroke has no speed
_WINDOW = (0.25, 0.75)  # of the travel, between which the speed counts
_ARRIVAL = 0.9  # of the travel
_MOST = 0.9  # of the strokes are within what is stated
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
BEYOND = 1.3
"""Times what is stated that errors beyond the largest opening are within: 92 % of those of forty
strange machines that were not worked on."""


class StrokeError(NamedTuple):
    """The error of prediction in a stroke that was left out; NaN where it has none.

    Attributes:
        position: rms [m].
        speed: of the mean speed, as a share of it.
        pressure: rms of the worse pressure over the middle of the travel [Pa].
        time: at which nine tenths of the travel are reached [s].
    """

    position: float
    speed: float
    pressure: float
    time: float


class Quantity(NamedTuple):
    """A quantity of `StrokeError` as a user reads it."""

    unit: str
    factor: float


QUANTITIES = {
    "position": Quantity("mm", 1e3),
    "speed": Quantity("%", 1e2),
    "pressure": Quantity("bar", 1e-5),
    "time": Quantity("ms", 1e3),
}
"""Those of `StrokeError`, by its fields."""


class Limit(NamedTuple):
    """A limit of a user on an error of prediction.

    Attributes:
        quantity: of `QUANTITIES`.
        most: in its unit.
    """

    quantity: str
    most: float

    def __str__(self) -> str:
        return f"{self.quantity} {self.most:g} {QUANTITIES[self.quantity].unit}"


def read_limit(text: str) -> Limit:
    """Return the limit that a text such as ``position 1 mm`` states.

    Raises:
        ConfigError: it states none.
    """
    found = re.fullmatch(rf"\s*(\w+)\s+({_NUMBER})\s*(mm|%|bar|ms)\s*", text)
    known = ", ".join(f'"{name} 1 {one.unit}"' for name, one in QUANTITIES.items())
    if found is None or found[1] not in QUANTITIES or QUANTITIES[found[1]].unit != found[3]:
        raise ConfigError(f'--require "{text}": give one of {known}')
    if not 0.0 < (most := float(found[2])) < math.inf:
        raise ConfigError(f'--require "{text}": give a number above 0')
    return Limit(found[1], most)


def measure_errors(model: Values, record: Values, interval: float) -> StrokeError:
    """Return the errors of a stroke.

    Args:
        model: position, P_A and P_B, shape (rows, 3) [m], [Pa].
        record: likewise; not a number for what is missing.
        interval: between two rows [s].
    """
    x, x_model = record[:, 0], model[:, 0]
    position = float(np.sqrt(np.nanmean(np.square(x_model - x))))
    travel = x[-1] - x[0]
    if not abs(travel) > _LEAST:
        return StrokeError(position, math.nan, _rms(model[:, 1:] - record[:, 1:]), math.nan)
    way, way_model = (x - x[0]) / travel, (x_model - x[0]) / travel
    first, last = _reach(way, _WINDOW[0]), _reach(way, _WINDOW[1])
    middle = slice(first, max(last, first + 1) + 1)
    gone = way[last] - way[first]
    speed = (way_model[last] - way_model[first]) / gone - 1.0 if gone > 0.0 else math.nan
    pressure = _rms(model[middle, 1:] - record[middle, 1:])
    late = abs(_arrival(way) - _arrival(way_model)) * interval
    return StrokeError(position, abs(speed), pressure, late)


def _arrival(way: Values) -> float:
    """Return the rows until nine tenths of the travel are reached."""
    farthest = np.maximum.accumulate(way)
    if farthest[-1] < _ARRIVAL:
        # It ends before: it would be there later, at the speed that it has had.
        return len(way) * _ARRIVAL / max(float(farthest[-1]), 1e-3)
    return float(np.interp(_ARRIVAL, farthest, np.arange(len(way))))


def _reach(way: Values, share: float) -> int:
    """Return the first row at which a share of the travel is reached, the last where none is."""
    there = way >= share
    return int(np.argmax(there)) if there.any() else len(way) - 1


def _rms(deviations: Values) -> float:
    """Return the rms of the worse column."""
    there = deviations[:, np.isfinite(deviations).any(axis=0)]
    return float(np.sqrt(np.nanmean(np.square(there), axis=0)).max()) if there.size else math.nan


def stated_error(errors: Sequence[StrokeError], quantity: str) -> float:
    """Return the error that nine of ten strokes are within, in its unit; NaN where none has it.

    It is the next larger of the errors that were seen, so that few strokes promise less.
    """
    values = sorted(filter(math.isfinite, (getattr(each, quantity) for each in errors)))
    if not values:
        return math.nan
    place = math.ceil(_MOST * (len(values) + 1)) - 1
    return QUANTITIES[quantity].factor * float(values[min(place, len(values) - 1)])


def describe_errors(errors: Sequence[StrokeError]) -> str:
    """Return the errors that nine of ten strokes are within; empty where no stroke has any."""
    return ", ".join(
        f"{name} {value:.3g} {one.unit}"
        for name, one in QUANTITIES.items()
        if math.isfinite(value := stated_error(errors, name))
    )


def find_exceeded(errors: Sequence[StrokeError], limits: Sequence[Limit]) -> list[str]:
    """Return the limits that the errors exceed, or that no stroke shows, a line each."""
    lines = []
    for limit in limits:
        stated, unit = stated_error(errors, limit.quantity), QUANTITIES[limit.quantity].unit
        if math.isnan(stated):
            lines.append(f"{limit}: no stroke that was left out shows it")
        elif stated > limit.most:
            lines.append(f"{limit}: the error of prediction is {stated:.3g} {unit}")
    return lines
