"""The keys of a table ``[plant.NAME]`` with ``kind = "fmu"``; `docs/fmu.md` tells their meaning."""

import re
from collections.abc import Callable
from typing import Final

from hil_bench.config.settings import Key
from hil_bench.config.values import as_table, boolean, describe, find_nearest, number, text
from hil_bench.errors import ConfigError
from hil_bench.units import KILOGRAM, NEWTON, UNITS_OF, Unit

UNITS: Final = {
    **{unit.symbol: (symbol, unit) for symbol, units in UNITS_OF.items() for unit in units},
    "1": ("-", Unit("-", "")),
    **{unit.symbol: (unit.symbol, unit) for unit in (NEWTON, KILOGRAM)},
    "kN": ("N", Unit("kN", "_kn", 1e3)),
    "N.m": ("N m", Unit("N m", "_n_m")),
    "m3/s": ("m³/s", Unit("m³/s", "_m3_s")),
    "r/min": ("rad/s", UNITS_OF["rad/s"][-1]),
}
"""Units of an FMU's variables: the SI unit, and what one of them is; spelled as FMI does, too."""

_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")

Bindings = dict[str, dict[str, str]]


def bindings(names: re.Pattern[str], right_name: str) -> Callable[[object], Bindings]:
    """Return a reader of variables by names, each with a unit where one is given.

    Args:
        names: those that are right.
        right_name: the same in words.
    """
    right = 'give NAME = "VARIABLE", or NAME = { variable = "VARIABLE", unit = "mm" }'

    def read(value: object) -> Bindings:
        table = as_table(value, right)
        for name in table:
            if not names.fullmatch(name):
                raise ConfigError(f"{describe(name)} cannot be a name; {right_name}")
        return {name: _variable(name, given, right) for name, given in table.items()}

    return read


def _variable(name: str, given: object, right: str) -> dict[str, str]:
    """Return a variable, and its unit where one is given.

    Raises:
        ConfigError: it is something else.
    """
    told = {"variable": given} if isinstance(given, str) else given
    if (
        not isinstance(told, dict)
        or told.keys() - {"variable", "unit"}
        or not all(isinstance(each, str) for each in told.values())
    ):
        raise ConfigError(f"{name} = {describe(given)} binds nothing; {right}")
    if "variable" not in told:
        raise ConfigError(f"{name} has no variable; {right}")
    if told.get("unit", "-") not in UNITS:
        nearest = find_nearest(told["unit"], list(UNITS))
        raise ConfigError(f"{name}: {describe(told['unit'])} is no known unit; {nearest} is")
    return dict(told)


_bound = bindings(_NAME, "give at most 32 letters, digits or _")


def _numbers(value: object) -> dict[str, float]:
    """Read numbers by the names of their variables."""
    read, table = number(), as_table(value, "give VARIABLE = NUMBER")
    return {name: read(given) for name, given in table.items()}


FMU_KEYS: Final = (
    Key("file", text, example='"axis.fmu"'),
    Key("command", text, example='"u"'),
    Key("full_command", number(low=-1e9, high=1e9), 1.0),
    Key("outputs", _bound, example='{ position = "x" }'),
    Key("inputs", _bound),
    Key("parameters", _numbers),
    Key("own_process", boolean, True),
)
