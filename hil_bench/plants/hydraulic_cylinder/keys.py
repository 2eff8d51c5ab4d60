"""The keys of a cylinder's table ``[plant.NAME]``: name, unit, default, and what each one fills.

`docs/configuration.md` tells the meaning of each. The defaults are Table I of Ruderman 2017.
"""

from enum import StrEnum

from hil_bench.config.settings import Key
from hil_bench.config.values import boolean, choice, describe, number, points, text
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.data_sheet_keys import DATA_SHEET_KEYS, LineModel
from hil_bench.plants.hydraulic_cylinder.data_sheet_keys import PUMP_KEYS as DISPLACEMENT_KEYS
from hil_bench.plants.hydraulic_cylinder.model.models import Model
from hil_bench.plants.hydraulic_cylinder.model.stepping import Solver
from hil_bench.units import (
    BAR,
    CELSIUS,
    CUBIC_CENTIMETRE,
    DEGREE,
    KILOGRAM,
    KILOGRAM_PER_CUBIC_METRE,
    LITRE,
    LITRE_PER_MINUTE,
    LITRE_PER_MINUTE_BAR,
    MEGAPASCAL,
    MICROMETRE,
    MILLIMETRE,
    MILLIMETRE_PER_SECOND,
    MILLISECOND,
    NEWTON,
    NEWTON_PER_MILLIMETRE,
    NEWTON_SECOND_PER_METRE,
    ONE,
    PASCAL,
    PERCENT,
    RADIAN_PER_SECOND,
    SECOND_AND_NEWTON,
    SECOND_PER_METRE,
    SQUARE_CENTIMETRE,
    SQUARE_MILLIMETRE_PER_SECOND,
    WATT_PER_KELVIN,
    Unit,
)


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


def _quantity(name: str, default: float, unit: Unit, field: str) -> Key:
    return Key(name, number(unit), default, unit, field)


PARAMETER_KEYS = (
    _quantity("orifice_full_opening_mm", 1.0, MILLIMETRE, "alpha"),
    _quantity("spool_overlap_mm", 0.3, MILLIMETRE, "beta"),
    _quantity("spool_natural_frequency_rad_s", 1200.0, RADIAN_PER_SECOND, "omega_0"),
    _quantity("spool_damping_ratio", 0.7, ONE, "xi"),
    _quantity("discharge_coefficient", 0.65, ONE, "C_d"),
    _quantity("orifice_width_mm", 20.0, MILLIMETRE, "w"),
    _quantity("oil_density_kg_m3", 850.0, KILOGRAM_PER_CUBIC_METRE, "rho"),
    _quantity("bulk_modulus_mpa", 100.0, MEGAPASCAL, "E"),
    _quantity("supply_pressure_bar", 100.0, BAR, "P_S"),
    _quantity("tank_pressure_bar", 0.0, BAR, "P_T"),
    _quantity("internal_leakage_l_min_bar", 0.0, LITRE_PER_MINUTE_BAR, "C_L"),
    _quantity("piston_area_cm2", 50.0, SQUARE_CENTIMETRE, "A_A"),
    _quantity("rod_side_area_cm2", 47.0, SQUARE_CENTIMETRE, "A_B"),
    _quantity("piston_side_volume_cm3", 1200.0, CUBIC_CENTIMETRE, "V_A0"),
    _quantity("rod_side_volume_cm3", 1150.0, CUBIC_CENTIMETRE, "V_B0"),
    _quantity("moving_mass_kg", 20.0, KILOGRAM, "m"),
    _quantity("coulomb_friction_n", 600.0, NEWTON, "F_c"),
    _quantity("static_friction_n", 900.0, NEWTON, "F_s"),
    _quantity("viscous_friction_n_s_m", 2000.0, NEWTON_SECOND_PER_METRE, "sigma"),
    _quantity("stribeck_velocity_mm_s", 20.0, MILLIMETRE_PER_SECOND, "chi"),
    _quantity("stribeck_exponent", 0.8, ONE, "delta"),
    # A data sheet gives the full stroke, the model wants half of it.
    _quantity("stroke_mm", 400.0, Unit("mm", "_mm", 0.5e-3), "h"),
)

OPTION_KEYS = (
    Key("signed_root", boolean, True),
    _quantity("tanh_gain_s_m", 400.0, SECOND_PER_METRE, "tanh_gain"),
    _quantity("laminar_transition_pa", 300.0, PASCAL, "laminar_transition"),
    # What is None is as for non_negative spool positions.
    Key("orifice_full_opening_negative_mm", number(MILLIMETRE), None, MILLIMETRE, "alpha_negative"),
    Key("spool_overlap_negative_mm", number(MILLIMETRE), None, MILLIMETRE, "beta_negative"),
    _quantity("external_leakage_a_l_min_bar", 0.0, LITRE_PER_MINUTE_BAR, "C_LA"),
    _quantity("external_leakage_b_l_min_bar", 0.0, LITRE_PER_MINUTE_BAR, "C_LB"),
)

END_STOP_KEYS = (
    _quantity("end_stop_stiffness_n_mm", 2e5, NEWTON_PER_MILLIMETRE, "stiffness"),
    _quantity("end_stop_damping_n_s_m", 2e4, NEWTON_SECOND_PER_METRE, "damping"),
)

CAVITATION_KEYS = (_quantity("cavitation_floor_bar", -1.01325, BAR, "cavitation_floor"),)

AIR_KEYS = (
    _quantity("entrained_air_percent", 0.0, PERCENT, "air_fraction"),
    _quantity("entrained_air_exponent", 1.4, ONE, "air_exponent"),
)

BRISTLE_KEYS = (
    _quantity("bristle_stiffness_n_mm", 1e4, NEWTON_PER_MILLIMETRE, "sigma_0"),
    _quantity("bristle_damping_n_s_m", 2e3, NEWTON_SECOND_PER_METRE, "sigma_1"),
)

LAND_KEYS = (
    _quantity("land_gain_pa", 1.0, ONE, "gain_pa"),
    _quantity("land_gain_at", 1.0, ONE, "gain_at"),
    _quantity("land_gain_pb", 1.0, ONE, "gain_pb"),
    _quantity("land_gain_bt", 1.0, ONE, "gain_bt"),
    _quantity("flow_saturation", 0.0, ONE, "saturation"),
    # What is None is as for the whole spool.
    Key("land_overlap_pa_mm", number(MILLIMETRE), None, MILLIMETRE, "overlap_pa"),
    Key("land_overlap_at_mm", number(MILLIMETRE), None, MILLIMETRE, "overlap_at"),
    Key("land_overlap_pb_mm", number(MILLIMETRE), None, MILLIMETRE, "overlap_pb"),
    Key("land_overlap_bt_mm", number(MILLIMETRE), None, MILLIMETRE, "overlap_bt"),
    _quantity("null_opening_um", 0.0, MICROMETRE, "null_opening"),
)

LINE_MODEL_KEY = Key("line_model", choice(LineModel), LineModel.VOLUME)

VISCOSITY_KEY = _quantity("oil_viscosity_mm2_s", 46.0, SQUARE_MILLIMETRE_PER_SECOND, "viscosity")

WALL_KEYS = {
    side: (
        Key(f"line_{side}_modulus_mpa", number(MEGAPASCAL), None, MEGAPASCAL, "bulk_modulus"),
        Key(f"line_{side}_wall_mm", number(MILLIMETRE), None, MILLIMETRE, "wall"),
    )
    for side in "ab"
}

COMPENSATOR_KEY = Key("compensator_margin_bar", number(BAR), None, BAR, "compensator_margin")

CUSHION_KEYS = {
    end: (
        Key(f"{end}_length_mm", number(MILLIMETRE), None, MILLIMETRE, "length"),
        Key(f"{end}_orifice_mm", number(MILLIMETRE), None, MILLIMETRE, "orifice"),
    )
    for end in ("cushion_a", "cushion_b")
}

COUNTERBALANCE_KEYS = (
    Key("counterbalance_setting_bar", number(BAR), None, BAR, "setting"),
    _quantity("counterbalance_pilot_ratio", 3.0, ONE, "pilot_ratio"),
    _quantity("counterbalance_opening_bar", 30.0, BAR, "span"),
    _quantity("counterbalance_time_ms", 10.0, MILLISECOND, "time_constant"),
)

COUNTERBALANCE_RATING = (
    Key("counterbalance_rated_flow_l_min", number(LITRE_PER_MINUTE), None, LITRE_PER_MINUTE),
    Key("counterbalance_rated_drop_bar", number(BAR), None, BAR),
)

PUMP_KEYS = (
    _quantity("pump_margin_bar", 20.0, BAR, "margin"),
    _quantity("pump_swivel_time_ms", 100.0, MILLISECOND, "swivel_time"),
    _quantity("pump_leakage_l_min_bar", 0.012, LITRE_PER_MINUTE_BAR, "leakage"),
)

FILTER_RATING = (
    Key(
        "filter_rated_flow_l_min",
        number(LITRE_PER_MINUTE, low=0.01, high=1e5),
        None,
        LITRE_PER_MINUTE,
    ),
    Key("filter_rated_drop_bar", number(BAR, low=1e-3, high=100.0), None, BAR),
)

_VISCOUS = number(SQUARE_MILLIMETRE_PER_SECOND, low=0.1, high=1e4)

FILTER_KEYS = (
    *FILTER_RATING,
    Key("filter_rated_viscosity_mm2_s", _VISCOUS, 30.0, SQUARE_MILLIMETRE_PER_SECOND),
    Key("filter_bypass_bar", number(BAR, low=0.01, high=1000.0), None, BAR),
)

SUPPLY_KEY = Key("supply", supply, Supply.CONSTANT)

CONTROL_KEY = Key("pump_control", choice(PumpControl), PumpControl.FIXED)

SUPPLY_KEYS = (
    _quantity("pump_flow_l_min", 60.0, LITRE_PER_MINUTE, "pump_flow"),
    _quantity("relief_pressure_bar", 100.0, BAR, "relief_pressure"),
    _quantity("relief_gradient_l_min_bar", 12.0, LITRE_PER_MINUTE_BAR, "relief_gradient"),
    _quantity("supply_line_volume_cm3", 500.0, CUBIC_CENTIMETRE, "line_volume"),
    _quantity("accumulator_volume_l", 0.0, LITRE, "accumulator_volume"),
    _quantity("accumulator_precharge_bar", 60.0, BAR, "precharge_pressure"),
    _quantity("accumulator_exponent", 1.4, ONE, "gas_exponent"),
)

CONSTANT_LOAD_KEYS = (_quantity("load_n", 0.0, NEWTON, "load_force"),)

SPRING_KEYS = (
    _quantity("load_spring_n_mm", 0.0, NEWTON_PER_MILLIMETRE, "spring_stiffness"),
    _quantity("load_spring_rest_mm", 0.0, MILLIMETRE, "spring_rest"),
)

SLOPE_KEYS = (
    _quantity("load_mass_kg", 0.0, KILOGRAM, "load_mass"),
    _quantity("load_slope_deg", 0.0, DEGREE, "slope"),
)

SERIES_KEY = Key("load_series_s_n", points(SECOND_AND_NEWTON), (), SECOND_AND_NEWTON, "load_series")

LOAD_KEYS = (*CONSTANT_LOAD_KEYS, *SPRING_KEYS, *SLOPE_KEYS, SERIES_KEY)

DELAY_KEY = _quantity("spool_delay_ms", 0.0, MILLISECOND, "delay")

_TANK_KEYS = tuple(
    key for key in PARAMETER_KEYS if key.name in {"supply_pressure_bar", "tank_pressure_bar"}
)

TANK_KEYS = (
    Key("oil", text),
    Key("tank_volume_l", number(LITRE, low=0.1, high=1e6), None, LITRE, "volume"),
    Key("start_temperature_c", number(CELSIUS, low=-40.0, high=120.0), 40.0, CELSIUS, "start"),
    Key("ambient_temperature_c", number(CELSIUS, low=-60.0, high=80.0), 20.0, CELSIUS, "ambient"),
    Key("tank_cooling_w_k", number(low=0.0, high=1e6), 10.0, WATT_PER_KELVIN, "walls"),
    Key("cooler_w_k", number(low=0.0, high=1e7), 0.0, WATT_PER_KELVIN, "cooler"),
    Key("cooler_from_c", number(CELSIUS, low=-40.0, high=120.0), 50.0, CELSIUS, "cooled_from"),
    Key(
        "pump_efficiency_percent",
        number(PERCENT, low=10.0, high=100.0),
        88.0,
        PERCENT,
        "efficiency",
    ),
)
"""Of a shared supply, for the temperature of its oil."""

SHARED_KEYS = (
    *DISPLACEMENT_KEYS,
    *_TANK_KEYS,
    _quantity("bulk_modulus_mpa", 1400.0, MEGAPASCAL, "modulus"),
    *SUPPLY_KEYS,
    CONTROL_KEY,
    *PUMP_KEYS,
    VISCOSITY_KEY,
    *FILTER_KEYS,
    *TANK_KEYS,
)
"""Of a supply that several axes share."""

AXIS_KEYS = (
    Key("model", choice(Model), Model.FULL_ORDER),
    *DATA_SHEET_KEYS,
    DELAY_KEY,
    *PARAMETER_KEYS,
    *OPTION_KEYS,
    Key("end_stop", boolean, True),
    *END_STOP_KEYS,
    Key("cavitation", boolean, True),
    *CAVITATION_KEYS,
    *AIR_KEYS,
    Key("friction", choice(Friction), Friction.STRIBECK),
    *BRISTLE_KEYS,
    *LAND_KEYS,
    LINE_MODEL_KEY,
    VISCOSITY_KEY,
    *WALL_KEYS["a"],
    *WALL_KEYS["b"],
    COMPENSATOR_KEY,
    *CUSHION_KEYS["cushion_a"],
    *CUSHION_KEYS["cushion_b"],
    Key("counterbalance", choice(Lines), Lines.NONE),
    *COUNTERBALANCE_KEYS,
    *COUNTERBALANCE_RATING,
    SUPPLY_KEY,
    *SUPPLY_KEYS,
    CONTROL_KEY,
    *PUMP_KEYS,
    *FILTER_KEYS,
    *LOAD_KEYS,
    _quantity("position_mm", 0.0, MILLIMETRE, "position"),
    Key("solver", choice(Solver), Solver.LINEARLY_IMPLICIT_MIDPOINT),
)
