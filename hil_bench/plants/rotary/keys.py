"""The keys of a motor's table ``[plant.NAME]``; valve, oil and supply have those of the cylinder.

`docs/rotary.md` tells the meaning of each.
"""

from typing import Final

from hil_bench.config.settings import Key
from hil_bench.config.values import boolean, number, points
from hil_bench.plants.hydraulic_cylinder.data_sheet_keys import (
    CYLINDER_KEYS,
    OIL_KEYS,
    PUMP_KEYS,
    VALVE_KEYS,
)
from hil_bench.plants.hydraulic_cylinder.keys import (
    AIR_KEYS,
    CAVITATION_KEYS,
    COMPENSATOR_KEY,
    FILTER_KEYS,
    LAND_KEYS,
    LINE_MODEL_KEY,
    OPTION_KEYS,
    PARAMETER_KEYS,
    SUPPLY_KEY,
    SUPPLY_KEYS,
    VISCOSITY_KEY,
    WALL_KEYS,
)
from hil_bench.units import (
    BAR,
    CUBIC_CENTIMETRE,
    CUBIC_CENTIMETRE_PER_REVOLUTION,
    DEGREE,
    KILOGRAM_SQUARE_METRE,
    NEWTON_METRE,
    NEWTON_METRE_SECOND,
    ONE,
    PERCENT,
    REVOLUTION_PER_MINUTE,
    SECOND_AND_NEWTON_METRE,
    Unit,
)


def _datum(name: str, unit: Unit, low: float, high: float) -> Key:
    return Key(name, number(unit, low=low, high=high), None, unit)


def _quantity(name: str, unit: Unit, low: float, high: float, field: str) -> Key:
    return Key(name, number(unit, low=low, high=high), 0.0, unit, field)


def _required(name: str, unit: Unit, low: float, high: float, field: str, example: str) -> Key:
    return Key(name, number(unit, low=low, high=high), None, unit, field, example)


MOTOR_KEYS: Final = (
    _required(
        "displacement_cm3_rev", CUBIC_CENTIMETRE_PER_REVOLUTION, 0.01, 1e6, "displacement", "28"
    ),
    _required("inertia_kg_m2", KILOGRAM_SQUARE_METRE, 1e-7, 1e6, "inertia", "0.02"),
)
"""What no motor can be without."""

RATING_KEYS: Final = (
    _datum("rated_speed_rpm", REVOLUTION_PER_MINUTE, 0.1, 1e5),
    _datum("rated_pressure_bar", BAR, 1.0, 1e4),
    _datum("volumetric_efficiency_percent", PERCENT, 1.0, 100.0),
    _datum("hydromechanical_efficiency_percent", PERCENT, 1.0, 100.0),
    _datum("starting_efficiency_percent", PERCENT, 1.0, 100.0),
)
"""Of the data sheet: efficiencies, and speed and pressure drop at which they hold."""

LINE_KEYS: Final = tuple(key for key in CYLINDER_KEYS if key.name.startswith("line_"))

VOLUME_KEYS: Final = (
    Key("volume_a_cm3", number(CUBIC_CENTIMETRE, low=1e-3, high=1e6), 0.0, CUBIC_CENTIMETRE, "a"),
    Key("volume_b_cm3", number(CUBIC_CENTIMETRE, low=1e-3, high=1e6), 0.0, CUBIC_CENTIMETRE, "b"),
)

FRICTION_KEYS: Final = (
    _quantity("coulomb_friction_n_m", NEWTON_METRE, 0.0, 1e7, "coulomb"),
    _quantity("static_friction_n_m", NEWTON_METRE, 0.0, 1e7, "static"),
    _quantity("viscous_friction_n_m_s", NEWTON_METRE_SECOND, 0.0, 1e7, "viscous"),
    Key(
        "stribeck_speed_rpm",
        number(REVOLUTION_PER_MINUTE, low=1e-3, high=1e4),
        20.0,
        REVOLUTION_PER_MINUTE,
        "stribeck",
    ),
    Key("stribeck_exponent", number(low=0.1, high=10.0), 1.0, ONE, "exponent"),
)

LOAD_KEYS: Final = (
    _quantity("load_torque_n_m", NEWTON_METRE, -1e7, 1e7, "torque"),
    _quantity("load_viscous_n_m_s", NEWTON_METRE_SECOND, 0.0, 1e7, "damping"),
    _quantity("load_inertia_kg_m2", KILOGRAM_SQUARE_METRE, 0.0, 1e6, "mass"),
)
SERIES_KEY: Final = Key(
    "load_series_s_n_m", points(SECOND_AND_NEWTON_METRE), (), SECOND_AND_NEWTON_METRE, "series"
)

_HYDRAULIC = {
    "orifice_full_opening_mm",
    "spool_overlap_mm",
    "spool_natural_frequency_rad_s",
    "spool_damping_ratio",
    "discharge_coefficient",
    "orifice_width_mm",
    "oil_density_kg_m3",
    "bulk_modulus_mpa",
    "supply_pressure_bar",
    "tank_pressure_bar",
    "internal_leakage_l_min_bar",
}
HYDRAULIC_KEYS: Final = tuple(key for key in PARAMETER_KEYS if key.name in _HYDRAULIC)
"""Those of the cylinder's parameters that its valve, its oil and its supply have."""

_OPTIONS = {
    "laminar_transition_pa",
    "orifice_full_opening_negative_mm",
    "spool_overlap_negative_mm",
    "external_leakage_a_l_min_bar",
    "external_leakage_b_l_min_bar",
}
VALVE_OPTION_KEYS: Final = tuple(key for key in OPTION_KEYS if key.name in _OPTIONS)

ANGLE_KEY: Final = Key("angle_deg", number(DEGREE, low=-1e9, high=1e9), 0.0, DEGREE, "angle")

DATA_SHEET_KEYS: Final = (*RATING_KEYS, *LINE_KEYS, *VALVE_KEYS, *OIL_KEYS, *PUMP_KEYS)

ROTARY_KEYS: Final = (
    *MOTOR_KEYS,
    *DATA_SHEET_KEYS,
    *VOLUME_KEYS,
    *FRICTION_KEYS,
    *HYDRAULIC_KEYS,
    *VALVE_OPTION_KEYS,
    Key("cavitation", boolean, True),
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
