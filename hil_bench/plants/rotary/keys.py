"""The keys of a motor's table ``[plant.NAME]``; valve, oil and supply have those of the cylinder.

`parameters.tsv` declares the motor's own.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from hil_bench.config.rows import read_rows
from hil_bench.config.settings import Origin, Problems, Settings
from hil_bench.plants.hydraulic_cylinder.data_sheet.cylinder import ring_area
from hil_bench.plants.hydraulic_cylinder.data_sheet.derive import fill
from hil_bench.plants.hydraulic_cylinder.data_sheet.oil import derive_oil, find_oil
from hil_bench.plants.hydraulic_cylinder.data_sheet.pump import derive_pump, find_assumed_supply
from hil_bench.plants.hydraulic_cylinder.data_sheet.sheet import Derived, Sheet
from hil_bench.plants.hydraulic_cylinder.data_sheet.valve import derive_valve
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
    LineModel,
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


# Leakage, friction and volumes of a motor from its data sheet; valve and oil as a cylinder's.

PORT_SHARE = 1.0
"""A typical volume of the motor's passages on each side, as a share of the displacement."""

VISCOUS_SHARE = 0.5
"""A typical part of the friction at rated speed that grows with the speed."""

STARTING_SHARE = 2.0
"""A typical friction at the start, as a multiple of that at rated speed."""

_POINT = ("rated_speed_rpm", "rated_pressure_bar")
_EFFICIENCIES = tuple(key.name for key in RATING_KEYS if key.name not in _POINT)
_VOLUMETRIC, _HYDROMECHANICAL, _STARTING = _EFFICIENCIES


def leakage(displacement: float, speed: float, drop: float, efficiency: float) -> float:
    """Return the leakage C = D omega (1 / eta_v - 1) / dp of a motor [m³/(s Pa)] (ISO 4391).

    Args:
        displacement: D [m³/rad].
        speed: omega at which the efficiency holds [rad/s].
        drop: dp at which it holds [Pa].
        efficiency: eta_v [-].
    """
    return displacement * speed * (1.0 / efficiency - 1.0) / drop


def friction_torque(displacement: float, drop: float, efficiency: float) -> float:
    """Return the torque (1 - eta_hm) D dp that a motor loses [N m] (ISO 4391).

    Args:
        displacement: D [m³/rad].
        drop: dp over the motor [Pa].
        efficiency: eta_hm [-].
    """
    return (1.0 - efficiency) * displacement * drop


def apply_data_sheet(settings: Settings, problems: Problems) -> Settings:
    """Return the settings of a motor with the physical keys that its data sheets determine.

    Args:
        settings: of the axis, one for each key.
        problems: where problems are noted: data that are missing, given twice or impossible.
    """
    sheet = Sheet(settings, problems)
    of_oil = list(sheet.take(derive_oil(sheet, find_oil(sheet))))
    density = next((each.value for each in of_oil if each.key == "oil_density_kg_m3"), None)
    density = sheet.number("oil_density_kg_m3") if density is None else density
    derived = [
        *of_oil,
        *sheet.take(_derive_losses(sheet)),
        *(each for side in "ab" for each in sheet.take(_derive_volume(sheet, side))),
        *sheet.take(derive_valve(sheet, density)),
        *sheet.take(derive_pump(sheet)),
    ]
    return settings | {each.key: fill(settings, each) for each in derived}


def find_leftovers(settings: Settings) -> Iterator[tuple[str, str]]:
    """Yield the keys of which nothing is said, and what stands there instead."""
    yield from find_assumed_supply(settings)
    for key, what, right in (
        ("orifice_width_mm", "the valve is", "rated_flow_l_min and rated_pressure_drop_bar"),
        ("bulk_modulus_mpa", "the oil is", 'oil = "HLP 46" or bulk_modulus_mpa'),
        ("supply_pressure_bar", "the supply is", "supply_pressure_bar"),
    ):
        if settings[key].origin is Origin.DEFAULT:
            value = settings[key].value
            yield key, f"{value:g}: {what} that of Ruderman 2017, Table I; give {right}"
    friction = [settings[name].origin for name in ("coulomb_friction_n_m", _HYDROMECHANICAL)]
    if all(origin is Origin.DEFAULT for origin in friction):
        right = "give hydromechanical_efficiency_percent, or 0 if it is so"
        yield "coulomb_friction_n_m", f"0: a motor without friction; {right}"


def _derive_losses(sheet: Sheet) -> Iterator[Derived]:
    """Yield what the efficiencies of a motor at its rated point determine."""
    given = sheet.given(_EFFICIENCIES)
    if not given:
        if point := sheet.given(_POINT):
            right = f"give {_HYDROMECHANICAL} too"
            sheet.refuse(point[0], f"says nothing without an efficiency; {right}")
        return
    if not sheet.require(given[0], zip(_POINT, ("1500", "200"), strict=True)):
        return
    displacement, speed, drop = (sheet.si(name) for name in ("displacement_cm3_rev", *_POINT))
    if sheet.has(_VOLUMETRIC):
        leak = leakage(displacement, speed, drop, sheet.si(_VOLUMETRIC))
        unit = sheet.settings["internal_leakage_l_min_bar"].key.unit
        sources = (_VOLUMETRIC, *_POINT)
        yield Derived("internal_leakage_l_min_bar", unit.from_si(leak), sources)
    if not sheet.has(_HYDROMECHANICAL):
        if sheet.has(_STARTING):
            sheet.refuse(_STARTING, f"says nothing by itself; give {_HYDROMECHANICAL} too")
        return
    sources = (_HYDROMECHANICAL, *_POINT)
    lost = friction_torque(displacement, drop, sheet.si(_HYDROMECHANICAL))
    part = f"{VISCOUS_SHARE:.0%} of it grow with the speed".replace("%", " %")
    coulomb, viscous = (1.0 - VISCOUS_SHARE) * lost, VISCOUS_SHARE * lost / speed
    yield Derived("coulomb_friction_n_m", coulomb, sources, part)
    yield Derived("viscous_friction_n_m_s", viscous, sources, part)
    if not sheet.has(_STARTING):
        many = f"{STARTING_SHARE:g} times that at rated speed"
        yield Derived("static_friction_n_m", STARTING_SHARE * lost, sources, many, yields=True)
        return
    static = friction_torque(displacement, drop, sheet.si(_STARTING))
    if static < coulomb:
        right = "give less, for friction is largest at the start"
        sheet.refuse(_STARTING, f"is above what {_HYDROMECHANICAL} leaves at speed 0; {right}")
    yield Derived("static_friction_n_m", static, (_STARTING, *_POINT))


def _derive_volume(sheet: Sheet, side: str) -> Iterator[Derived]:
    """Yield the volume between the valve and the rotor on one side."""
    length, inner = f"line_{side}_length_m", f"line_{side}_inner_mm"
    has_waves = sheet.settings["line_model"].value is LineModel.WAVES
    lines = () if has_waves else sheet.given((length, inner))
    if len(lines) == 1:
        other = inner if lines[0] == length else length
        sheet.refuse(lines[0], f"does not say the line's volume by itself; give {other} too")
        return
    line = ring_area(sheet.si(inner), 0.0) * sheet.si(length) * 1e6 if lines else 0.0
    ports = PORT_SHARE * sheet.number("displacement_cm3_rev")
    typical = "passages as large as the displacement"
    sources = ("displacement_cm3_rev", *lines)
    yield Derived(f"volume_{side}_cm3", line + ports, sources, typical, yields=not lines)
