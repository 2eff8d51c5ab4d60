"""The dimensions of units: the check that bar is not compared with mm.

A dimension is a product of base units, such as kg/(m s²) for a pressure. The radian is one of them:
without it 1 Hz would be 1 rad/s, and 50 % an angle.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

from hil_bench import units
from hil_bench.units import Unit

Dimension = tuple[tuple[str, int], ...]
"""Base units with their exponents, sorted; empty for a pure number."""

NUMBER: Final[Dimension] = ()
TIME: Final[Dimension] = (("s", 1),)


class MeasuredUnit(NamedTuple):
    """A unit that may stand behind a number.

    Attributes:
        unit: symbol and factor.
        dimension: what it measures.
    """

    unit: Unit
    dimension: Dimension


def power(**exponents: int) -> Dimension:
    """Return a dimension, as in ``power(m=1, s=-1)``."""
    return tuple(sorted((base, number) for base, number in exponents.items() if number))


def multiply(left: Dimension, right: Dimension, sign: int = 1) -> Dimension:
    """Return the dimension of a product, or of a quotient where `sign` is -1."""
    exponents = dict(left)
    for base, number in right:
        exponents[base] = exponents.get(base, 0) + sign * number
    return power(**exponents)


_LENGTH, _SPEED, _FORCE = power(m=1), power(m=1, s=-1), power(kg=1, m=1, s=-2)
_PRESSURE, _RATE = power(kg=1, m=-1, s=-2), power(s=-1)
_ANGLE = power(rad=1)

_UNITS: Final = (
    *(MeasuredUnit(unit, NUMBER) for unit in (units.ONE, units.PERCENT)),
    *(MeasuredUnit(unit, _ANGLE) for unit in (units.DEGREE, units.RADIAN, units.REVOLUTION)),
    *(
        MeasuredUnit(unit, TIME)
        for unit in (units.SECOND, units.MILLISECOND, units.MICROSECOND, Unit("min", "_min", 60.0))
    ),
    *(MeasuredUnit(unit, _LENGTH) for unit in (units.METRE, units.MILLIMETRE, units.MICROMETRE)),
    *(MeasuredUnit(unit, _SPEED) for unit in (units.METRE_PER_SECOND, units.MILLIMETRE_PER_SECOND)),
    MeasuredUnit(Unit("m/s²", "_m_s2"), power(m=1, s=-2)),
    MeasuredUnit(Unit("mm/s²", "_mm_s2", 1e-3), power(m=1, s=-2)),
    *(
        MeasuredUnit(unit, _PRESSURE)
        for unit in (units.PASCAL, units.BAR, units.MILLIBAR, units.KILOPASCAL, units.MEGAPASCAL)
    ),
    MeasuredUnit(Unit("Pa/s", "_pa_s"), multiply(_PRESSURE, _RATE)),
    MeasuredUnit(units.BAR_PER_SECOND, multiply(_PRESSURE, _RATE)),
    *(MeasuredUnit(unit, _FORCE) for unit in (units.NEWTON, Unit("kN", "_kn", 1e3))),
    *(
        MeasuredUnit(unit, multiply(_FORCE, _LENGTH, -1))
        for unit in (Unit("N/m", "_n_per_m"), units.NEWTON_PER_MILLIMETRE)
    ),
    MeasuredUnit(units.KILOGRAM, power(kg=1)),
    MeasuredUnit(units.HERTZ, _RATE),
    *(
        MeasuredUnit(unit, multiply(_ANGLE, _RATE))
        for unit in (units.RADIAN_PER_SECOND, units.REVOLUTION_PER_MINUTE)
    ),
    MeasuredUnit(units.NEWTON_METRE, multiply(_FORCE, _LENGTH)),
    *(
        MeasuredUnit(unit, power(m=3, s=-1))
        for unit in (units.CUBIC_METRE_PER_SECOND, units.LITRE_PER_MINUTE)
    ),
    *(
        MeasuredUnit(unit, power(m=3))
        for unit in (Unit("m³", "_m3"), units.LITRE, units.CUBIC_CENTIMETRE)
    ),
    *(MeasuredUnit(unit, power(m=2)) for unit in (Unit("m²", "_m2"), units.SQUARE_CENTIMETRE)),
    MeasuredUnit(units.CELSIUS, ((units.CELSIUS.symbol, 1),)),
)

UNITS: Final[Mapping[str, MeasuredUnit]] = MappingProxyType(
    {each.unit.symbol: each for each in _UNITS}
)
"""The units of the language, by symbol."""

_SPELLINGS = str.maketrans({"²": "2", "³": "3", "µ": "u"})
_BY_SPELLING = {symbol.translate(_SPELLINGS): each for symbol, each in UNITS.items()}
_BY_SUFFIX = {each.unit.suffix: each for each in _UNITS if each.unit.suffix}

REFERENCES: Final[Mapping[Dimension, float]] = MappingProxyType(
    {_PRESSURE: 1e6, _LENGTH: 1e-2, _SPEED: 0.1, _FORCE: 1e3, TIME: 0.1}
)
"""What counts as a margin of 1 where a comparison names no tolerance [SI]; 1 for all others."""


def find_unit(symbol: str) -> MeasuredUnit | None:
    """Return a unit by its symbol, ``cm3`` for ``cm³`` too; None for no unit of the language."""
    return _BY_SPELLING.get(symbol.translate(_SPELLINGS))


def dimension_of(symbol: str) -> Dimension:
    """Return the dimension of a recorded signal; one of its own for an unknown symbol."""
    found = find_unit(symbol)
    return found.dimension if found else ((symbol, 1),)


def unit_of_name(name: str) -> MeasuredUnit:
    """Return the unit that the name of a parameter ends in, as in ``target_mm``; else a number."""
    fits = [suffix for suffix in _BY_SUFFIX if name.endswith(suffix) and name != suffix]
    return _BY_SUFFIX[max(fits, key=len)] if fits else UNITS[units.ONE.symbol]


def show_dimension(dimension: Dimension) -> str:
    """Return the name of a dimension in messages: the units that a person would give."""
    symbols = [symbol for symbol, each in UNITS.items() if each.dimension == dimension]
    if dimension == NUMBER:
        return "a number"
    if symbols:
        return f"in {symbols[min(1, len(symbols) - 1)]}"
    if dimension == (("", 1),):
        return "without a unit"
    return "in " + " ".join(f"{base}^{n}" if n != 1 else base for base, n in dimension)
