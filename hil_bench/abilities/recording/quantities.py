"""Recorded quantities: their usual sizes, and even times."""

import math
from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.common.shown_units import display_unit
from hil_bench.abilities.recording.reading import given_units
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import TIME, Recording, recording_channels

# The units and the usual sizes of the quantities of a recording.


class _Quantity(NamedTuple):
    """The units that a quantity may have, and the least and the largest usual values of a run."""

    units: tuple[str, ...]
    low: float = 0.0
    high: float = float("inf")


_LENGTH = _Quantity(("m", "rad"), high=100.0)
_SPEED = _Quantity(("m/s", "rad/s"))
_PRESSURE = _Quantity(("Pa",), 1e4, 3e8)
_SHARE = _Quantity(("-",), high=10.0)
_QUANTITIES: Final[Mapping[str, _Quantity]] = MappingProxyType(
    {
        **dict.fromkeys(("position", "position_setpoint"), _LENGTH),
        "speed": _SPEED,
        **dict.fromkeys(("P_A", "P_B", "P_S", "P_A_valve", "P_B_valve"), _PRESSURE),
        **dict.fromkeys(("spool_setpoint", "spool_position"), _SHARE),
        **dict.fromkeys(("angle", "angle_setpoint"), _Quantity(("rad",))),
        "T_oil": _Quantity(("°C",), high=300.0),
    }
)
"""The quantities of cylinders, motors and supplies by the last part of a channel's name.

A pressure below 0.1 bar or above 3000 bar for a whole run, a stroke beyond 100 m and a spool beyond
ten times its full opening are no machine's: rather, the unit is that of another column.
"""


def highest_of(name: str) -> float:
    """Return the magnitude above which no machine has a quantity [SI], by its channel's name."""
    quantity = _QUANTITIES.get(name.rpartition(".")[2])
    return quantity.high if quantity is not None else math.inf


def check_quantities(recording: Recording, names: Iterable[str]) -> None:
    """Refuse columns whose unit is none of their quantity, as a pressure in mm.

    Args:
        recording: in the bench's units.
        names: of the columns that somebody uses.

    Raises:
        ConfigError: there is one; the message says which units are right.
    """
    given = given_units(recording)
    units = {channel.name: channel.unit for channel in recording_channels(recording)}
    for name in sorted(names):
        quantity = _QUANTITIES.get(name.rpartition(".")[2])
        if quantity is None or name not in units or units[name] in quantity.units:
            continue
        symbol = given.get(name, units[name])
        right = " or ".join(dict.fromkeys(display_unit(unit).symbol for unit in quantity.units))
        raise ConfigError(f'{name} is in "{symbol}", which is no unit of it; give it in {right}')


def find_doubts(
    recording: Recording, names: Iterable[str], highest: Mapping[str, float] | None = None
) -> Iterator[str]:
    """Yield a line for each column whose values are not of the size that its quantity has.

    Args:
        recording: in the bench's units.
        names: of the columns that somebody uses.
        highest: the largest usual value of columns of a known machine; without one, of any.
    """
    given = given_units(recording)
    for name, symbol in recording_channels(recording):
        quantity = _QUANTITIES.get(name.rpartition(".")[2])
        values = np.abs(recording[name])
        finite = values[np.isfinite(values)]
        if quantity is None or name not in names or not len(finite) or not finite.max():
            continue
        largest, limit = float(finite.max()), (highest or {}).get(name, quantity.high)
        if quantity.low <= largest <= limit:
            continue
        unit = display_unit(symbol)
        most = f"{unit.from_si(largest):.4g} {unit.symbol}"
        usual = (
            f"more than {unit.from_si(limit):.4g}"
            if largest > limit
            else f"less than {unit.from_si(quantity.low):.4g}"
        )
        yield (
            f"{name} is {most} at most, {usual} {unit.symbol}; "
            f'check that its unit is "{given.get(name, symbol)}"'
        )


# Rows of loggers made even: jitter, lost samples, empty cells, a coarse column of time.
#
# Who steps the plant from row to row needs rows that are equally far apart. What a logger did is
# named, and what is too long to be bridged stays a gap.


Values = npt.NDArray[np.float64]
Marks = npt.NDArray[np.bool_]

_HELD = "spool_setpoint"  # goes in steps
_UNEVEN = 0.2  # of a row: as `record` counts gaps
_BRIDGED = 5  # rows
_LONGEST = 0.02  # [s]
_FEW = 0.01  # of the steps
_JITTER = 0.01  # of an interval, by which half the rows of a jittering logger are off
_FULL = 0.8  # share of rows that must be whole
_LIKE = 0.02  # of an interval
_COARSE = 1.5  # steps of the clock by which a row may be off


def make_even(recording: Recording, quantities: list[str]) -> tuple[Recording, tuple[str, ...]]:
    """Return a recording with rows equally far apart, and notes on what was done.

    A recording that is even but for a step now and then is returned as it is. Others are
    interpolated at their usual interval across up to five rows or 20 ms; longer gaps stay.
    `ConfigError` where more than a fifth of the rows have no number in one of the columns.

    Args:
        recording: with a column of time that does not fall.
        quantities: names of the columns that count.
    """
    notes: list[str] = []
    recording = _without_empty(recording, quantities, notes)
    times = np.asarray(recording[TIME.name], dtype=np.float64)
    if len(times) < 3 or not np.isfinite(times).all() or (np.diff(times) < 0.0).any():
        return recording, tuple(notes)
    if float(np.median(np.diff(times))) == 0.0:
        times = _refined(times, notes)
    steps = np.diff(times)
    interval = float(np.median(steps))
    is_off = np.abs(steps - interval) > _UNEVEN * interval
    is_long = steps > max(min(_BRIDGED * interval, _LONGEST), 1.5 * interval)
    is_lost = np.abs(steps - interval * np.round(steps / interval)) < _UNEVEN * interval
    is_near = is_off & ~is_long
    # A few steps of another length, such as where a program goes on, only part the record.
    is_even = float(np.median(np.abs(steps - interval))) < _JITTER * interval
    if interval <= 0.0 or (not (is_near & is_lost).any() and is_near.mean() < _FEW and is_even):
        if notes:
            recording = recording.copy()
            recording[TIME.name] = times
        return recording, tuple(notes)
    share = (np.abs(steps - interval) > _JITTER * interval).mean()
    interval = _round(interval)
    notes.append(
        f"{share:.1%} of the rows are unevenly far apart; interpolated at {1e3 * interval:.4g} ms"
    )
    return _resampled(recording, times, interval, is_long), tuple(notes)


def _round(interval: float) -> float:
    """Return an interval in as few digits as say it to 2 %, so that files of one logger agree."""
    for digits in range(3):
        rounded = float(f"{interval:.{digits}e}")
        if abs(rounded / interval - 1.0) < _LIKE:
            return rounded
    return interval


def _without_empty(recording: Recording, quantities: list[str], notes: list[str]) -> Recording:
    """Return the rows that have a number in each of the columns.

    Raises:
        ConfigError: these are few.
    """
    is_whole = np.ones(len(recording), dtype=np.bool_)
    for name in (TIME.name, *quantities):
        has = np.isfinite(recording[name])
        if has.mean() < _FULL:
            raise ConfigError(
                f"the recording's {name} is no number in {(~has).sum()} of {len(has)} rows; "
                "give a column that is measured in each row"
            )
        is_whole &= has
    if is_whole.all():
        return recording
    notes.append(f"{(~is_whole).sum()} rows with an empty cell count as lost")
    return recording[is_whole]


def _refined(times: Values, notes: list[str]) -> Values:
    """Return times with the digits that a coarse clock lacks, where its rows are even."""
    clock = float(np.min(np.diff(np.unique(times))))
    rows = np.arange(len(times), dtype=np.float64)
    slope, begin = np.polyfit(rows, times, 1)
    even = begin + slope * rows
    if slope <= 0.0 or np.abs(times - even).max() > _COARSE * clock:
        return times
    notes.append(
        f"the column of time has steps of {1e3 * clock:.4g} ms for rows each {1e3 * slope:.4g} ms; "
        "the rows are taken as even"
    )
    return np.asarray(even - even[0] + times[0])


def _resampled(recording: Recording, times: Values, interval: float, is_long: Marks) -> Recording:
    """Return rows at even times, without those within long gaps."""
    grid = times[0] + interval * np.arange(int((times[-1] - times[0]) / interval) + 1)
    # Where between two rows a set-point changed is not known: most likely half-way.
    nearest = np.searchsorted(0.5 * (times[1:] + times[:-1]), grid)
    is_within = np.zeros(len(grid), dtype=np.bool_)
    for place in np.flatnonzero(is_long).tolist():
        is_within |= (grid > times[place]) & (grid < times[place + 1])
    grid, nearest = grid[~is_within], nearest[~is_within]
    even = np.empty(len(grid), dtype=recording.dtype)
    for name in recording.dtype.names or ():
        values = recording[name]
        is_held = name.endswith(f".{_HELD}")
        even[name] = values[nearest] if is_held else np.interp(grid, times, values)
    even[TIME.name] = grid
    return even
