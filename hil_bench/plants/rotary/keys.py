"""The keys of a motor's table ``[plant.NAME]``; valve, oil and supply have those of the cylinder.

`parameters.tsv` declares the motor's own.
"""

from pathlib import Path
from typing import Final

from hil_bench.config.rows import read_rows
from hil_bench.plants.hydraulic_cylinder.keys import (
    AIR_KEYS,
    CAVITATION_KEY,
    CAVITATION_KEYS,
    COMPENSATOR_KEY,
    CYLINDER_SHEET,
    FILTER_KEYS,
    LAND_KEYS,
    LINE_MODEL_KEY,
    OIL_SHEET,
    OPTION_KEYS,
    PARAMETER_KEYS,
    PUMP_SHEET,
    SUPPLY_KEY,
    SUPPLY_KEYS,
    VALVE_SHEET,
    VISCOSITY_KEY,
    WALL_KEYS,
)

_ROWS: Final = read_rows(Path(__file__).with_name("parameters.tsv"))

MOTOR_KEYS: Final = _ROWS.groups["motor"]
"""What no motor can be without."""

RATING_KEYS: Final = _ROWS.groups["rating"]
"""Of the data sheet: efficiencies, and speed and pressure drop at which they hold."""

LINE_KEYS: Final = tuple(key for key in CYLINDER_SHEET if key.name.startswith("line_"))
VOLUME_KEYS: Final = _ROWS.groups["volumes"]
FRICTION_KEYS: Final = _ROWS.groups["friction"]
LOAD_KEYS: Final = _ROWS.groups["load"]
(SERIES_KEY,) = _ROWS.groups["series"]
(ANGLE_KEY,) = _ROWS.groups["angle"]

_OF_PISTON = {"A_A", "A_B", "V_A0", "V_B0", "m", "F_c", "F_s", "sigma", "chi", "delta", "h"}
HYDRAULIC_KEYS: Final = tuple(key for key in PARAMETER_KEYS if key.field not in _OF_PISTON)
"""Those of the cylinder's parameters that its valve, its oil and its supply have."""

_OF_CYLINDER = {"signed_root", "tanh_gain_s_m"}
VALVE_OPTION_KEYS: Final = tuple(key for key in OPTION_KEYS if key.name not in _OF_CYLINDER)

DATA_SHEET_KEYS: Final = (*RATING_KEYS, *LINE_KEYS, *VALVE_SHEET, *OIL_SHEET, *PUMP_SHEET)

ROTARY_KEYS: Final = (
    *MOTOR_KEYS,
    *DATA_SHEET_KEYS,
    *VOLUME_KEYS,
    *FRICTION_KEYS,
    *HYDRAULIC_KEYS,
    *VALVE_OPTION_KEYS,
    CAVITATION_KEY,
    *CAVITATION_KEYS,
    *AIR_KEYS,
    *LAND_KEYS,
    LINE_MODEL_KEY,
    *WALL_KEYS["a"],
    *WALL_KEYS["b"],
    COMPENSATOR_KEY,
    SUPPLY_KEY,
    *SUPPLY_KEYS,
    VISCOSITY_KEY,
    *FILTER_KEYS,
    *LOAD_KEYS,
    SERIES_KEY,
    ANGLE_KEY,
)
