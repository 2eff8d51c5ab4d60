"""Units: the one place where a data-sheet unit meets SI.

Values inside the bench are SI. A `Unit` converts where a person reads or writes: `bench.toml`, the
status line, plots; in which units people are shown values, they choose.
"""

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

from hil_bench.errors import ConfigError


class Unit(NamedTuple):
    """A unit of measure.

    Attributes:
        symbol: how people read it, as in ``l/(min bar)``.
        suffix: how a key or a variable ends in it, as in ``_l_min_bar``; empty for a number.
        factor: the SI value of one of it.
    """

    symbol: str
    suffix: str
    factor: float = 1

    def to_si(self, value: float) -> float:
        """Return `value`, given in this unit, in SI."""
        return value * self.factor

    def from_si(self, value: float) -> float:
        """Return `value`, given in SI, in this unit."""
        return value / self.factor

    @property
    def si(self) -> str:
        """The symbol of its SI unit; empty for a number."""
        symbol = si_unit(self.symbol)[0]
        return "" if symbol == "-" else symbol


# Exact by definition (NIST SP 811, 2008, appendix B.8).
_INCH, _FOOT, _POUND, _US_GALLON = 0.0254, 0.3048, 0.45359237, 3.785411784e-3
_POUND_FORCE, _KILOGRAM_FORCE, _ATMOSPHERE = 4.4482216152605, 9.80665, 101_325.0
_PSI = _POUND_FORCE / _INCH**2

ONE = Unit("-", "")
PERCENT = Unit("%", "_percent", 1e-2)
PERCENT_PER_SECOND = Unit("%/s", "_percent_s", 1e-2)
PPM_PER_KELVIN = Unit("ppm/K", "_ppm_k", 1e-6)
HERTZ = Unit("Hz", "_hz")
SECOND = Unit("s", "_s")
CELSIUS = Unit("°C", "_c")
WATT_PER_KELVIN = Unit("W/K", "_w_k")
REVOLUTION_PER_MINUTE = Unit("rpm", "_rpm", math.tau / 60.0)
CUBIC_CENTIMETRE_PER_REVOLUTION = Unit("cm³/rev", "_cm3_rev", 1e-6 / math.tau)
MICROSECOND = Unit("us", "_us", 1e-6)
MILLISECOND = Unit("ms", "_ms", 1e-3)
METRE = Unit("m", "_m")
MICROMETRE = Unit("um", "_um", 1e-6)
MICROMETRE_PER_KELVIN = Unit("um/K", "_um_k", 1e-6)
MICROMETRE_PER_ROOT_HERTZ = Unit("um/√Hz", "_um_rthz", 1e-6)
MILLIMETRE = Unit("mm", "_mm", 1e-3)
SQUARE_CENTIMETRE = Unit("cm²", "_cm2", 1e-4)
SQUARE_MILLIMETRE_PER_SECOND = Unit("mm²/s", "_mm2_s", 1e-6)
CUBIC_CENTIMETRE = Unit("cm³", "_cm3", 1e-6)
LITRE = Unit("l", "_l", 1e-3)
INCH = Unit("in", "_in", _INCH)
INCH_PER_SECOND = Unit("in/s", "_in_s", _INCH)
METRE_PER_SECOND = Unit("m/s", "_m_s")
MILLIMETRE_PER_SECOND = Unit("mm/s", "_mm_s", 1e-3)
MILLIMETRE_PER_MINUTE = Unit("mm/min", "_mm_min", 1e-3 / 60.0)
DEGREE = Unit("deg", "_deg", math.pi / 180.0)
DEGREE_PER_SECOND = Unit("deg/s", "_deg_s", math.pi / 180.0)
DEGREE_PER_KELVIN = Unit("deg/K", "_deg_k", math.pi / 180.0)
DEGREE_PER_ROOT_HERTZ = Unit("deg/√Hz", "_deg_rthz", math.pi / 180.0)
RADIAN = Unit("rad", "_rad")
REVOLUTION = Unit("rev", "_rev", math.tau)
RADIAN_PER_SECOND = Unit("rad/s", "_rad_s")
SECOND_PER_METRE = Unit("s/m", "_s_m")
KILOGRAM = Unit("kg", "_kg")
KILOGRAM_PER_CUBIC_METRE = Unit("kg/m³", "_kg_m3")
NEWTON = Unit("N", "_n")
KILONEWTON = Unit("kN", "_kn", 1e3)
POUND_FORCE = Unit("lbf", "_lbf", _POUND_FORCE)
NEWTON_METRE = Unit("N m", "_n_m")
POUND_FORCE_FOOT = Unit("lbf ft", "_lbf_ft", _POUND_FORCE * _FOOT)
NEWTON_METRE_SECOND = Unit("N m s", "_n_m_s")
KILOGRAM_SQUARE_METRE = Unit("kg m²", "_kg_m2")
NEWTON_SECOND_PER_METRE = Unit("N s/m", "_n_s_m")
NEWTON_PER_MILLIMETRE = Unit("N/mm", "_n_mm", 1e3)
PASCAL = Unit("Pa", "_pa")
MILLIBAR = Unit("mbar", "_mbar", 1e2)
KILOPASCAL = Unit("kPa", "_kpa", 1e3)
BAR = Unit("bar", "_bar", 1e5)
BAR_PER_SECOND = Unit("bar/s", "_bar_s", 1e5)
BAR_PER_KELVIN = Unit("bar/K", "_bar_k", 1e5)
BAR_PER_ROOT_HERTZ = Unit("bar/√Hz", "_bar_rthz", 1e5)
MEGAPASCAL = Unit("MPa", "_mpa", 1e6)
MEGAPASCAL_PER_SECOND = Unit("MPa/s", "_mpa_s", 1e6)
PSI = Unit("psi", "_psi", _PSI)
PSI_PER_SECOND = Unit("psi/s", "_psi_s", _PSI)
CUBIC_METRE_PER_SECOND = Unit("m³/s", "_m3_s")
LITRE_PER_MINUTE = Unit("l/min", "_l_min", 1e-3 / 60.0)
US_GALLON = Unit("gal", "_gal", _US_GALLON)
US_GALLON_PER_MINUTE = Unit("gpm", "_gpm", _US_GALLON / 60.0)
LITRE_PER_MINUTE_BAR = Unit("l/(min bar)", "_l_min_bar", 1e-3 / 60.0 / 1e5)
SECOND_AND_NEWTON = Unit("[s, N]", "_s_n")
SECOND_AND_NEWTON_METRE = Unit("[s, N m]", "_s_n_m")
SECOND_AND_KELVIN = Unit("[s, K]", "_s_k")

UNIT_OF: Mapping[str, Unit] = {
    each.symbol: each for each in tuple(vars().values()) if isinstance(each, Unit)
}
"""By symbol."""

UNITS_OF: Mapping[str, tuple[Unit, ...]] = {
    "-": (ONE, PERCENT),
    "Pa": (PASCAL, MILLIBAR, KILOPASCAL, BAR, MEGAPASCAL),
    "m": (METRE, MILLIMETRE, MICROMETRE),
    "m/s": (METRE_PER_SECOND, MILLIMETRE_PER_SECOND),
    "s": (SECOND, MILLISECOND, MICROSECOND),
    "m³/s": (CUBIC_METRE_PER_SECOND, LITRE_PER_MINUTE),
    "rad": (RADIAN, DEGREE, REVOLUTION),
    "rad/s": (RADIAN_PER_SECOND, DEGREE_PER_SECOND, REVOLUTION_PER_MINUTE),
    "N m": (NEWTON_METRE,),
}
"""Units in which bindings and registers may have a quantity, by its SI unit."""


COUNT = "1"
"""The symbol of numbers that are no share of anything: counts, words of bits."""

_MINUTE, _HOUR = 60.0, 3600.0
_OF_KILOGRAM = dict.fromkeys(("kgf", "kp"), _KILOGRAM_FORCE)
SPELLED: Mapping[str, Mapping[str, float]] = {
    "-": {"-": 1.0, COUNT: 1.0, "%": 1e-2},
    "s": {
        **dict.fromkeys(("s", "sec", "second", "Second", "seconds", "Seconds"), 1.0),
        "ms": 1e-3,
        "us": 1e-6,
        "ns": 1e-9,
        "min": _MINUTE,
        "h": _HOUR,
    },
    "m": {
        "m": 1.0,
        "dm": 1e-1,
        "cm": 1e-2,
        "mm": 1e-3,
        "um": 1e-6,
        "km": 1e3,
        "in": _INCH,
        "inch": _INCH,
        "ft": _FOOT,
    },
    "m/s": {
        "m/s": 1.0,
        "cm/s": 1e-2,
        "mm/s": 1e-3,
        "um/s": 1e-6,
        "in/s": _INCH,
        "ft/s": _FOOT,
        "m/min": 1.0 / _MINUTE,
        "mm/min": 1e-3 / _MINUTE,
        "in/min": _INCH / _MINUTE,
        "ft/min": _FOOT / _MINUTE,
        "km/h": 1e3 / _HOUR,
    },
    "m/s²": {"m/s2": 1.0, "mm/s2": 1e-3},
    "m²": {"m2": 1.0, "cm2": 1e-4, "mm2": 1e-6, "in2": _INCH**2, "ft2": _FOOT**2},
    "m³": {
        "m3": 1.0,
        **dict.fromkeys(("l", "L", "dm3"), 1e-3),
        **dict.fromkeys(("ml", "mL", "cm3"), 1e-6),
        "mm3": 1e-9,
        "in3": _INCH**3,
        "ft3": _FOOT**3,
        "gal": _US_GALLON,
    },
    "m³/(s Pa)": {"m3/(s Pa)": 1.0, "l/(min bar)": LITRE_PER_MINUTE_BAR.factor},
    "m³/s": {
        "m3/s": 1.0,
        "m3/min": 1.0 / _MINUTE,
        "m3/h": 1.0 / _HOUR,
        "cm3/s": 1e-6,
        **dict.fromkeys(("l/s", "L/s"), 1e-3),
        **dict.fromkeys(("l/min", "L/min", "lpm", "LPM"), 1e-3 / _MINUTE),
        **dict.fromkeys(("l/h", "L/h"), 1e-3 / _HOUR),
        **dict.fromkeys(("ml/min", "mL/min", "cm3/min"), 1e-6 / _MINUTE),
        **dict.fromkeys(("gpm", "gal/min"), _US_GALLON / _MINUTE),
    },
    "Pa": {
        "Pa": 1.0,
        "hPa": 1e2,
        "kPa": 1e3,
        "MPa": 1e6,
        "GPa": 1e9,
        "N/m2": 1.0,
        "N/mm2": 1e6,
        "mbar": 1e2,
        **dict.fromkeys(("bar", "Bar", "BAR"), 1e5),
        **dict.fromkeys(("psi", "Psi", "PSI"), _PSI),
        "ksi": 1e3 * _PSI,
        "kgf/cm2": 1e4 * _KILOGRAM_FORCE,
        "atm": _ATMOSPHERE,
    },
    "Pa/s": {"Pa/s": 1.0, "kPa/s": 1e3, "MPa/s": 1e6, "bar/s": 1e5, "psi/s": _PSI},
    "N": {"N": 1.0, "daN": 10.0, "kN": 1e3, "MN": 1e6, "lbf": _POUND_FORCE, **_OF_KILOGRAM},
    "N/m": {
        "N/m": 1.0,
        "N/mm": 1e3,
        "kN/m": 1e3,
        "kN/mm": 1e6,
        "lbf/in": _POUND_FORCE / _INCH,
    },
    "N m": {
        **dict.fromkeys(("N m", "Nm", "N.m"), 1.0),
        **dict.fromkeys(("kN m", "kNm", "kN.m"), 1e3),
        "lbf ft": POUND_FORCE_FOOT.factor,
        "lbf in": _POUND_FORCE * _INCH,
    },
    "kg": {"kg": 1.0, "t": 1e3, "lb": _POUND},
    "rad": {
        "rad": 1.0,
        "mrad": 1e-3,
        **dict.fromkeys(("deg", "°"), DEGREE.factor),
        "rev": math.tau,
    },
    "rad/s": {
        "rad/s": 1.0,
        "rev/s": math.tau,
        **dict.fromkeys(("deg/s", "°/s"), DEGREE.factor),
        **dict.fromkeys(
            ("rpm", "RPM", "r/min", "rev/min", "1/min", "min-1", "U/min"),
            REVOLUTION_PER_MINUTE.factor,
        ),
    },
    "Hz": {"Hz": 1.0, "kHz": 1e3},
    "°C": dict.fromkeys(("°C", "degC", "deg C"), 1.0),
}
"""The factors of all units that files and expectations may have, by the bench's unit."""
_KELVIN, _FAHRENHEIT = 273.15, 5.0 / 9.0
_SPELLING = str.maketrans({"²": "2", "³": "3", "µ": "u", "μ": "u", "·": ".", "^": "", "º": "°"})


class SiUnit(NamedTuple):
    """The way from a unit to the unit that the bench has of the same quantity.

    Attributes:
        symbol: of the bench's unit: SI, but °C for temperatures.
        factor: the value of one of it.
        offset: the value of zero of it.
    """

    symbol: str
    factor: float = 1.0
    offset: float = 0.0


_CONVERSIONS: Mapping[str, SiUnit] = {
    **{each: SiUnit(si, factor) for si, all_ in SPELLED.items() for each, factor in all_.items()},
    "K": SiUnit("°C", 1.0, -_KELVIN),
    **dict.fromkeys(("°F", "degF", "deg F"), SiUnit("°C", _FAHRENHEIT, -32.0 * _FAHRENHEIT)),
}


def read_unit(text: str) -> SiUnit | None:
    """Return the conversion to SI of a unit as loggers spell it: ``[m^3/s]``, ``L/min``.

    The gallon is that of the US. A pressure relative to something (``barg``, ``psia``) is not
    known, for the bench cannot see to what its own is relative.

    Args:
        text: the unit, with or without brackets.

    Returns:
        The unit; None where it is not known.
    """
    return _CONVERSIONS.get(bare_unit(text))


def bare_unit(text: str) -> str:
    """Return a unit without brackets, its letters as `read_unit` takes them: ``m3/s``, ``uV``."""
    symbol = text.strip()
    if symbol[:1] + symbol[-1:] in {"[]", "()"}:
        symbol = symbol[1:-1].strip()
    return symbol.translate(_SPELLING)


@lru_cache(maxsize=256)
def si_unit(symbol: str) -> tuple[str, float]:
    """Return the SI unit of a unit, and its factor; of an unknown one itself, and 1.

    K and °F, which no factor alone converts, count as unknown.
    """
    found = read_unit(symbol)
    return (symbol, 1.0) if found is None or found.offset else (found.symbol, found.factor)


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
    symbol_of_si, factor = si_unit(symbol) if symbol else (unit, 1.0)
    if symbol_of_si != unit:
        usual = ", ".join(each.symbol for each in UNITS_OF.get(unit, ())) or unit
        raise ConfigError(f'"{text}": {symbol} is no unit of it; give one of {usual}')
    try:
        value = float(level) * factor
    except ValueError:
        raise ConfigError(f'"{text}": {level} is no number') from None
    return value
