"""From the keys of a data sheet to the physical keys of an axis."""

from collections.abc import Iterator

from hil_bench.config.settings import Origin, Problems, Setting, Settings
from hil_bench.plants.hydraulic_cylinder.data_sheet.cylinder import derive_cylinder
from hil_bench.plants.hydraulic_cylinder.data_sheet.oil import (
    Derived,
    Sheet,
    derive_oil,
    derive_pump,
    find_assumed_supply,
    find_oil,
)
from hil_bench.plants.hydraulic_cylinder.data_sheet.valve import derive_valve
from hil_bench.plants.hydraulic_cylinder.keys import DATA_SHEET_KEYS

_PARTS = (
    ("piston_area_cm2", "the cylinder", "bore_mm, rod_mm and stroke_mm"),
    ("orifice_width_mm", "the valve", "rated_flow_l_min and rated_pressure_drop_bar"),
    ("bulk_modulus_mpa", "the oil", "oil or bulk_modulus_mpa"),
    ("supply_pressure_bar", "the supply", "supply_pressure_bar"),
)
"""The parts of an axis: a physical key that stands for each, and what gives it."""


def apply_data_sheet(settings: Settings, problems: Problems) -> Settings:
    """Return the settings of an axis with the physical keys that its data sheets determine.

    Args:
        settings: of the axis, one for each key.
        problems: where problems are noted: data that are missing, given twice or impossible.
    """
    sheet = Sheet(settings, problems)
    if not sheet.given(key.name for key in DATA_SHEET_KEYS):
        return settings
    oil = find_oil(sheet)
    of_oil = list(sheet.take(derive_oil(sheet, oil)))
    density = next((each.value for each in of_oil if each.key == "oil_density_kg_m3"), None)
    density = sheet.number("oil_density_kg_m3") if density is None else density
    derived = [
        *of_oil,
        *sheet.take(derive_cylinder(sheet)),
        *sheet.take(derive_valve(sheet, density)),
        *sheet.take(derive_pump(sheet)),
    ]
    return settings | {each.key: fill(settings, each) for each in derived}


def find_leftovers(settings: Settings) -> Iterator[tuple[str, str]]:
    """Yield the keys that Table I still fills although a data sheet fills others, and why not."""
    yield from find_assumed_supply(settings)
    names = [key.name for key in DATA_SHEET_KEYS if settings[key.name].origin is not Origin.DEFAULT]
    if not names:
        return
    for key, part, right in _PARTS:
        setting = settings[key]
        if setting.origin is Origin.DEFAULT:
            wrong = f"{setting.value:g} is Table I's, although {names[0]} describes another machine"
            yield key, f"{wrong}; give {part} too: {right}"


def fill(settings: Settings, derived: Derived) -> Setting:
    """Return the setting of a physical key with what a data sheet says of it."""
    old = settings[derived.key]
    return old._replace(value=derived.value, origin=Origin.DATA_SHEET, reason=derived.reason)
