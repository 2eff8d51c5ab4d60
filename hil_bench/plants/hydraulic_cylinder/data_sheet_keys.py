"""The keys of a data sheet in ``[plant.NAME]``; each group fills physical keys beside it."""

from enum import StrEnum
from typing import Final

from hil_bench.config.settings import Key
from hil_bench.config.values import number, text
from hil_bench.units import (
    BAR,
    CELSIUS,
    CUBIC_CENTIMETRE,
    HERTZ,
    LITRE_PER_MINUTE,
    METRE,
    MILLIMETRE,
    MILLISECOND,
    ONE,
    PERCENT,
    REVOLUTION_PER_MINUTE,
    Unit,
)


class LineModel(StrEnum):
    """The model of a line between valve and cylinder."""

    VOLUME = "volume"
    WAVES = "waves"


def _datum(name: str, unit: Unit, low: float, high: float) -> Key:
    return Key(name, number(unit, low=low, high=high), None, unit)


CYLINDER_KEYS: Final = (
    _datum("bore_mm", MILLIMETRE, 1.0, 5000.0),
    _datum("rod_mm", MILLIMETRE, 0.5, 5000.0),
    _datum("second_rod_mm", MILLIMETRE, 0.0, 5000.0),
    _datum("dead_volume_a_cm3", CUBIC_CENTIMETRE, 1e-3, 1e6),
    _datum("dead_volume_b_cm3", CUBIC_CENTIMETRE, 1e-3, 1e6),
    _datum("line_a_length_m", METRE, 0.0, 1000.0),
    _datum("line_a_inner_mm", MILLIMETRE, 0.1, 500.0),
    _datum("line_b_length_m", METRE, 0.0, 1000.0),
    _datum("line_b_inner_mm", MILLIMETRE, 0.1, 500.0),
    _datum("breakaway_pressure_bar", BAR, 0.0, 100.0),
)

VALVE_KEYS: Final = (
    _datum("rated_flow_l_min", LITRE_PER_MINUTE, 0.01, 1e5),
    _datum("rated_pressure_drop_bar", BAR, 0.1, 350.0),
    _datum("spool_stroke_mm", MILLIMETRE, 0.01, 100.0),
    _datum("overlap_percent", PERCENT, 0.0, 90.0),
    _datum("ratio_a_b", ONE, 0.1, 10.0),
    _datum("flow_at_half_opening_percent", PERCENT, 50.0, 99.0),
    _datum("null_leakage_l_min", LITRE_PER_MINUTE, 1e-4, 1e4),
    _datum("null_leakage_pressure_bar", BAR, 0.1, 1000.0),
    _datum("frequency_90deg_hz", HERTZ, 0.1, 5000.0),
    _datum("step_response_ms", MILLISECOND, 0.1, 10_000.0),
)

OIL_KEYS: Final = (
    Key("oil", text),
    _datum("oil_temperature_c", CELSIUS, -40.0, 120.0),
)

PUMP_KEYS: Final = (
    _datum("pump_displacement_cm3", CUBIC_CENTIMETRE, 0.01, 1e4),
    _datum("pump_speed_rpm", REVOLUTION_PER_MINUTE, 1.0, 20_000.0),
    _datum("pump_volumetric_efficiency_percent", PERCENT, 1.0, 100.0),
)

DATA_SHEET_KEYS: Final = (*CYLINDER_KEYS, *VALVE_KEYS, *OIL_KEYS, *PUMP_KEYS)
