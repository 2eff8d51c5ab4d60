"""The keys of a cylinder's table ``[plant.NAME]``, by what they fill, and its lines.

`parameters.tsv` declares each of them. The defaults are Table I of Ruderman 2017.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final

from hil_bench.config.settings import Settings, convert, group, with_words
from hil_bench.config.values import Reader, choice, describe
from hil_bench.errors import ConfigError, ParameterError
from hil_bench.plants.hydraulic_cylinder.model.models import Model
from hil_bench.plants.hydraulic_cylinder.model.stepping import Solver
from hil_bench.plants.hydraulic_cylinder.model.validation import ROWS
from hil_bench.plants.hydraulic_cylinder.model.waves import Line, korteweg


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


# The lines of an axis from its keys: as volumes of the chambers, or with waves.


_STEEL = 206e9
"""Young's modulus of a steel pipe [Pa]."""


def build_lines(axis: Settings) -> dict[str, Line | None]:
    """Return the lines with waves, as `PlantOptions` has them.

    Raises:
        ParameterError: their data are missing or given twice, or there is no line.
    """
    lines = {side: _build_line(axis, side) for side in "ab"}
    has_waves = axis["line_model"].value is LineModel.WAVES
    if has_waves and not any(lines.values()):
        right = "give line_a_length_m and line_a_inner_mm too, or those of line B"
        raise ParameterError(f"waves need a line: {right}", "line_model")
    return {f"line_{side}": line for side, line in lines.items()}


def _build_line(axis: Settings, side: str) -> Line | None:
    """Return a line with waves; None where there is none.

    Raises:
        ParameterError: its data are missing, given twice or make no sense.
    """
    names = (f"line_{side}_length_m", f"line_{side}_inner_mm")
    wall_names = tuple(key.name for key in WALL_KEYS[side])
    given = [name for name in (*names, *wall_names) if axis[name].value is not None]
    if axis["line_model"].value is not LineModel.WAVES:
        for name in wall_names:
            if name in given:
                raise ParameterError(
                    'without waves it says nothing: give line_model = "waves"', name
                )
        return None
    if not given:
        return None
    for name in names:
        if name not in given:
            raise ParameterError(
                f"a line has a length and an inner diameter: give {name} too", given[0]
            )
    if len(given) == len(names) + len(wall_names):
        right = f"leave out one of {' and '.join(wall_names)}"
        raise ParameterError(f"given twice, for the wall says it too: {right}", wall_names[0])
    length, inner = (axis[name].key.unit.to_si(axis[name].value) for name in names)
    modulus = _modulus(axis, side, inner)
    try:
        return Line(
            length=length,
            inner=inner,
            bulk_modulus=modulus,
            **convert(axis, (VISCOSITY_KEY,)),
        )
    except ParameterError as error:
        places = {
            "length": names[0],
            "inner": names[1],
            "bulk_modulus": wall_names[0],
            "viscosity": VISCOSITY_KEY.name,
        }
        raise ParameterError(str(error), places[error.symbols[0]]) from None


def _modulus(axis: Settings, side: str, inner: float) -> float:
    """Return the bulk modulus of the oil in a line with its wall [Pa].

    Raises:
        ParameterError: the wall is none.
    """
    own, wall = convert(axis, WALL_KEYS[side]).values()
    if own is not None:
        return float(own)
    oil = axis["bulk_modulus_mpa"].key.unit.to_si(axis["bulk_modulus_mpa"].value)
    if wall is None:
        return oil
    if wall <= 0.0 or wall >= inner:
        name = f"line_{side}_wall_mm"
        raise ParameterError(
            f"wall = {wall:g} m: must be greater than 0 and less than the inner diameter", name
        )
    return korteweg(oil, inner, wall, _STEEL)
