"""The units and the usual sizes of the quantities of a recording."""

from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from hil_bench.abilities.recording.reading import given_units
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import Recording, recording_channels
from hil_bench.shown_units import display_unit


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
