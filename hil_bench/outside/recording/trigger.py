"""The trigger of a recording: a signal that crosses a level."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import TIME, Channel, Recording
from hil_bench.units import UNITS_OF

_CONDITION = re.compile(r"\s*(\S+?)\s*([<>])\s*([-+.\deE]+)\s*(\S*)\s*")


class Trigger(NamedTuple):
    """A signal beyond a level.

    Attributes:
        channel: name of the signal.
        is_above: whether it must be above the level; below otherwise.
        level: in the signal's SI unit.
    """

    channel: str
    is_above: bool
    level: float

    def first(self, rows: Recording) -> int | None:
        """Return the number of the first row that is beyond the level, None for none."""
        import numpy as np  # noqa: PLC0415 - whose rows these are

        values = rows[self.channel]
        hits = np.flatnonzero(values > self.level if self.is_above else values < self.level)
        return int(hits[0]) if hits.size else None


def parse_trigger(text: str, channels: Sequence[Channel]) -> Trigger:
    """Return the trigger that a text such as ``axis1.P_A > 80 bar`` describes.

    Args:
        text: channel, ``<`` or ``>``, level, and its unit where it is not the SI unit.
        channels: the signals there are.

    Raises:
        ConfigError: it says what is wrong.
    """
    match = _CONDITION.fullmatch(text)
    if match is None:
        raise ConfigError(f'trigger "{text}": write it as in "axis1.P_A > 80 bar"')
    name, relation, level, symbol = match.groups()
    units = {channel.name: channel.unit for channel in (TIME, *channels)}
    if name not in units:
        raise ConfigError(f'trigger "{text}": no signal {name}; there are {", ".join(units)}')
    return Trigger(name, relation == ">", quantity(text, level, symbol, units[name]))


def quantity(text: str, level: str, symbol: str, unit: str) -> float:
    """Return a number with the symbol of its unit in the SI unit of a channel.

    Args:
        text: what it is part of, for the message.
        level: the number.
        symbol: of its unit; empty for the SI unit.
        unit: the SI unit.

    Raises:
        ConfigError: it is no number, or the unit is none of the quantity's.
    """
    units = {each.symbol: each.factor for each in UNITS_OF.get(unit, ())} or {unit: 1.0}
    if symbol and symbol not in units:
        raise ConfigError(f'"{text}": {symbol} is no unit of it; give one of {", ".join(units)}')
    try:
        value = float(level) * units.get(symbol, 1.0)
    except ValueError:
        raise ConfigError(f'"{text}": {level} is no number') from None
    return value
