"""The dimensions of units: the check that bar is not compared with mm.

A dimension is a product of base units, such as kg/(m s²) for a pressure. The radian is one of them:
without it 1 Hz would be 1 rad/s, and 50 % an angle.
"""

from collections.abc import Iterator, Mapping
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

_DIMENSIONS: Final[Mapping[str, Dimension]] = {
    "-": NUMBER,
    "s": TIME,
    "m": _LENGTH,
    "m/s": _SPEED,
    "m/s²": power(m=1, s=-2),
    "m²": power(m=2),
    "m³": power(m=3),
    "m³/s": power(m=3, s=-1),
    "m³/(s Pa)": power(kg=-1, m=4, s=1),
    "Pa": _PRESSURE,
    "Pa/s": multiply(_PRESSURE, _RATE),
    "N": _FORCE,
    "N/m": multiply(_FORCE, _LENGTH, -1),
    "N m": multiply(_FORCE, _LENGTH),
    "kg": power(kg=1),
    "rad": _ANGLE,
    "rad/s": multiply(_ANGLE, _RATE),
    "Hz": _RATE,
    "°C": ((units.CELSIUS.symbol, 1),),
}
"""The dimension of each unit of the bench that `units.SPELLED` has."""
_USUAL: Final = {
    "-": ("-", "%"),
    "s": ("s", "ms", "us", "min"),
    "m": ("m", "mm", "um"),
    "m/s": ("m/s", "mm/s"),
    "m/s²": ("m/s²", "mm/s²"),
    "Pa": ("Pa", "bar", "mbar", "kPa", "MPa"),
    "Pa/s": ("Pa/s", "bar/s"),
    "N": ("N", "kN"),
    "N/m": ("N/m", "N/mm"),
    "m³/s": ("m³/s", "l/min"),
    "m³": ("m³", "l", "cm³"),
    "m²": ("m²", "cm²"),
    "rad": ("deg", "rad", "rev"),
    "rad/s": ("rad/s", "rpm"),
}
"""The units that messages name and judgements are given in, in the order of preference."""
_NOT_WRITTEN: Final = frozenset({units.COUNT, "1/min", "min-1", "N.m", "kN.m", "deg C"})
"""Spellings of files that are other things in an expectation, as a difference or a quotient."""
_NO_SUFFIX: Final = frozenset(
    {"h", "t", "in", "second", "Second", "r/min", "°", "°/s", "kN/m", "MN", "kp"}
)
"""Units whose letters at the end of a name mean something else: ``pressure_in``, ``gain_kp``."""
_SUFFIXES: Final = {"-": "", "%": "_percent", "°C": "_c", "N/m": "_n_per_m"}
_SPELLINGS = str.maketrans({"²": "2", "³": "3", "µ": "u"})


def _suffix(symbol: str) -> str:
    """Return the end of a parameter's name that means a unit, as in ``target_mm``."""
    if symbol in _NO_SUFFIX:
        return ""
    letters = symbol.translate(_SPELLINGS).lower().replace("/", "_").replace(" ", "_")
    return _SUFFIXES.get(symbol, f"_{letters.strip('()')}".replace("(", ""))


def _units_of(si: str) -> Iterator[MeasuredUnit]:
    """Yield the units of a dimension, the usual ones first, each by the letters of a person."""
    factors = units.SPELLED[si]
    usual = _USUAL.get(si, (si,))
    plain = {symbol.translate(_SPELLINGS) for symbol in usual}
    for symbol in (*usual, *(each for each in factors if each not in plain | _NOT_WRITTEN)):
        unit = Unit(symbol, _suffix(symbol), factors[symbol.translate(_SPELLINGS)])
        yield MeasuredUnit(units.ONE if unit == units.ONE else unit, _DIMENSIONS[si])


UNITS: Final[Mapping[str, MeasuredUnit]] = MappingProxyType(
    {each.unit.symbol: each for si in _DIMENSIONS for each in _units_of(si)}
)
"""The units of the language, by symbol."""

_BY_SPELLING = {symbol.translate(_SPELLINGS): each for symbol, each in UNITS.items()}
_BY_SUFFIX = {each.unit.suffix: each for each in reversed([*UNITS.values()]) if each.unit.suffix}

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
    if dimension == NUMBER:
        return "a number"
    for si, each in _DIMENSIONS.items():
        if each == dimension:
            return f"in {_USUAL.get(si, (si,))[:2][-1]}"
    if dimension == (("", 1),):
        return "without a unit"
    return "in " + " ".join(f"{base}^{n}" if n != 1 else base for base, n in dimension)
