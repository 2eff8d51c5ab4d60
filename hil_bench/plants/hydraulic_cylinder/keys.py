"""The keys of a cylinder's table ``[plant.NAME]``, by what they fill.

`parameters.tsv` declares each of them. The defaults are Table I of Ruderman 2017.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final

from hil_bench.config.rows import group, with_words
from hil_bench.config.values import Reader, choice, describe
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.model.models import Model
from hil_bench.plants.hydraulic_cylinder.model.stepping import Solver
from hil_bench.plants.hydraulic_cylinder.model.validation import ROWS


class Friction(StrEnum):
    """The models of the piston's friction."""

    STRIBECK = "stribeck"
    LUGRE = "lugre"


class Supply(StrEnum):
    """The supply of port P."""

    CONSTANT = "constant"
    UNIT = "unit"


def supply(value: object) -> str:
    """Return the supply of port P: a `Supply`, or the name of a ``[supply.NAME]``.

    Raises:
        ConfigError: the value is no name.
    """
    if isinstance(value, str) and value:
        return Supply(value) if value in set(Supply) else value
    right = 'give "constant", "unit" or the name of a [supply.NAME]'
    raise ConfigError(f"{describe(value)} is no supply; {right}")


class PumpControl(StrEnum):
    """The quantity that a pump controls."""

    FIXED = "fixed"
    PRESSURE = "pressure-compensated"
    LOAD = "load-sensing"


class Lines(StrEnum):
    """The lines between valve and cylinder that have a counterbalance valve."""

    NONE = "none"
    A = "a"
    B = "b"
    BOTH = "both"


class LineModel(StrEnum):
    """The model of a line between valve and cylinder."""

    VOLUME = "volume"
    WAVES = "waves"


_WORDS: Final[Mapping[str, Reader]] = {
    "model": choice(Model),
    "friction": choice(Friction),
    "line_model": choice(LineModel),
    "counterbalance": choice(Lines),
    "supply": supply,
    "pump_control": choice(PumpControl),
    "solver": choice(Solver),
}

_ROWS: Final = group(with_words(ROWS.keys, _WORDS))
AXIS_KEYS = tuple(key for key in _ROWS.keys if key.group not in {"shared", "tank"})
_BY_NAME: Final = {key.name: key for key in AXIS_KEYS}

PARAMETER_KEYS = _ROWS.groups["parameters"]
OPTION_KEYS = _ROWS.groups["options"]
END_STOP_KEYS = _ROWS.groups["end stop"]
CAVITATION_KEYS = _ROWS.groups["cavitation"]
AIR_KEYS = _ROWS.groups["air"]
BRISTLE_KEYS = _ROWS.groups["bristles"]
LAND_KEYS = _ROWS.groups["lands"]
WALL_KEYS = {side: _ROWS.groups[f"wall {side}"] for side in "ab"}
CUSHION_KEYS = {end: _ROWS.groups[end] for end in ("cushion_a", "cushion_b")}
COUNTERBALANCE_KEYS = _ROWS.groups["counterbalance"]
COUNTERBALANCE_RATING = _ROWS.groups["counterbalance rating"]
PUMP_KEYS = _ROWS.groups["pump"]
FILTER_KEYS = _ROWS.groups["filter"]
FILTER_RATING = FILTER_KEYS[:2]
SUPPLY_KEYS = _ROWS.groups["supply unit"]
CONSTANT_LOAD_KEYS = _ROWS.groups["constant load"]
SPRING_KEYS = _ROWS.groups["spring"]
SLOPE_KEYS = _ROWS.groups["slope"]
CAVITATION_KEY = _BY_NAME["cavitation"]
LINE_MODEL_KEY = _BY_NAME["line_model"]
VISCOSITY_KEY = _BY_NAME["oil_viscosity_mm2_s"]
COMPENSATOR_KEY = _BY_NAME["compensator_margin_bar"]
SUPPLY_KEY = _BY_NAME["supply"]
SERIES_KEY = _BY_NAME["load_series_s_n"]
DELAY_KEY = _BY_NAME["spool_delay_ms"]

CYLINDER_SHEET, VALVE_SHEET, OIL_SHEET, PUMP_SHEET = map(
    _ROWS.sheet, ("cylinder", "valve", "oil", "pump")
)
DATA_SHEET_KEYS = _ROWS.groups["sheet"]

TANK_KEYS = _ROWS.groups["tank"]
"""Of a shared supply, for the temperature of its oil."""

SHARED_KEYS = (
    *PUMP_SHEET,
    _BY_NAME["supply_pressure_bar"],
    _BY_NAME["tank_pressure_bar"],
    *_ROWS.groups["shared"],
    *SUPPLY_KEYS,
    _BY_NAME["pump_control"],
    *PUMP_KEYS,
    VISCOSITY_KEY,
    *FILTER_KEYS,
    _BY_NAME["oil"],
    *TANK_KEYS,
)
"""Of a supply that several axes share."""
