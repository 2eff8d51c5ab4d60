"""From the keys of a data sheet to the physical keys of an axis."""

import math
from collections.abc import Iterator

from hil_bench.config.settings import Origin, Problems, Setting, Settings
from hil_bench.plants.hydraulic_cylinder.data_sheet.oil import (
    Derived,
    Sheet,
    derive_oil,
    derive_pump,
    find_assumed_supply,
    find_oil,
)
from hil_bench.plants.hydraulic_cylinder.data_sheet.valve import derive_valve
from hil_bench.plants.hydraulic_cylinder.keys import CYLINDER_SHEET, DATA_SHEET_KEYS, LineModel

# Areas, volumes, mass and friction of a cylinder from its data sheet.


STEEL = 7850.0
"""Density of steel [kg/m³]."""

DEAD_SHARE = 0.05
"""A typical dead volume, as a share of the volume that the piston sweeps."""

BREAKAWAY_BAR = 1.8
"""A typical breakaway pressure of piston and rod seals: that of Table I of Ruderman 2017."""

COULOMB_SHARE = 2.0 / 3.0
"""A typical sliding friction, as a share of the breakaway friction: that of Table I."""

VISCOUS_PRESSURE = 4e5
"""A typical viscous friction, as a pressure at 1 m/s: that of Table I [Pa s/m]."""

_NAMES = tuple(key.name for key in CYLINDER_SHEET)
_RODS = ("bore_mm", "rod_mm", "second_rod_mm")


def ring_area(outer: float, inner: float) -> float:
    """Return the area pi / 4 (D² - d²) of a ring [m²] between two diameters [m]."""
    return 0.25 * math.pi * (outer * outer - inner * inner)


def chamber_volume(area: float, stroke: float, dead: float, line: float) -> float:
    """Return the volume of a chamber and its line at mid-stroke [m³].

    Args:
        area: of the piston in it [m²].
        stroke: from stop to stop [m].
        dead: volume left in it with the piston at its end [m³].
        line: volume between it and the valve [m³].
    """
    return 0.5 * area * stroke + dead + line


def piston_mass(bore: float, rod: float, second_rod: float, stroke: float) -> float:
    """Return the typical mass of piston and rods of steel [kg].

    The piston is 0.6 bores long, each rod as long as the stroke and one and a half bores.

    Args:
        bore: diameter [m].
        rod: diameter of the rod in chamber B [m].
        second_rod: diameter of the rod in chamber A, 0 for none [m].
        stroke: from stop to stop [m].
    """
    rods = ring_area(rod, 0.0) + ring_area(second_rod, 0.0)
    return STEEL * (ring_area(bore, 0.0) * 0.6 * bore + rods * (stroke + 1.5 * bore))


def derive_cylinder(sheet: Sheet) -> Iterator[Derived]:
    """Yield what bore, rods, stroke, dead volumes, lines and breakaway pressure determine."""
    has_waves = sheet.settings["line_model"].value is LineModel.WAVES
    given = sheet.given(name for name in _NAMES if not (has_waves and name.startswith("line_")))
    if not given:
        return
    wanted = (("bore_mm", "63"), ("rod_mm", "36"), ("stroke_mm", "500"))
    if not sheet.require(given[0], wanted) or not _has_sound_rods(sheet):
        return
    bore, rod, second = (sheet.si(name, 0.0) for name in _RODS)
    stroke = sheet.number("stroke_mm") * 1e-3
    area_a, area_b = ring_area(bore, second), ring_area(bore, rod)
    sources = ("bore_mm", "second_rod_mm") if second else ("bore_mm",)
    yield Derived("piston_area_cm2", area_a * 1e4, sources)
    yield Derived("rod_side_area_cm2", area_b * 1e4, ("bore_mm", "rod_mm"))
    for side, key, area in (
        ("a", "piston_side_volume_cm3", area_a),
        ("b", "rod_side_volume_cm3", area_b),
    ):
        lines = () if has_waves else (f"line_{side}_length_m", f"line_{side}_inner_mm")
        yield from _derive_volume(sheet, side, key, area, stroke, lines)
    mass = piston_mass(bore, rod, second, stroke)
    rods = sheet.given((*_RODS, "stroke_mm"))
    what = "piston and rod of steel, no load"
    yield Derived("moving_mass_kg", mass, rods, what, yields=True)
    yield from _derive_friction(sheet, area_a)


def _has_sound_rods(sheet: Sheet) -> bool:
    bore = sheet.number("bore_mm")
    for name in _RODS[1:]:
        rod = sheet.number(name, 0.0)
        if rod >= bore:
            right = f"give less than {bore:g}"
            sheet.refuse(name, f"{rod:g} is not thinner than bore_mm = {bore:g}; {right}")
    if sheet.number("stroke_mm") <= 0.0:
        sheet.refuse("stroke_mm", f"{sheet.number('stroke_mm'):g} is no stroke; give more than 0")
    return sheet.is_sound


def _derive_volume(
    sheet: Sheet, side: str, key: str, area: float, stroke: float, names: tuple[str, ...]
) -> Iterator[Derived]:
    """Yield the volume of a chamber and its line at mid-stroke.

    Args:
        sheet: of the axis.
        side: "a" or "b".
        key: of the volume.
        area: of the piston in the chamber [m²].
        stroke: from stop to stop [m].
        names: of the keys of length and inner diameter of a line that counts as volume.
    """
    lines = sheet.given(names)
    if len(lines) == 1:
        other = next(name for name in names if name not in lines)
        right = f"give {other} too"
        sheet.refuse(lines[0], f"does not say the line's volume by itself; {right}")
        return
    line = ring_area(sheet.si(lines[1]), 0.0) * sheet.si(lines[0]) if lines else 0.0
    dead_key = f"dead_volume_{side}_cm3"
    has_dead = sheet.has(dead_key)
    dead = sheet.si(dead_key) if has_dead else DEAD_SHARE * area * stroke
    own = (dead_key, *lines) if has_dead else lines
    rods = (
        sheet.given(("bore_mm", "second_rod_mm"))
        if side == "a"
        else sheet.given(("bore_mm", "rod_mm"))
    )
    typical = "" if has_dead else f"dead volume {DEAD_SHARE:.0%} of the swept".replace("%", " %")
    volume = chamber_volume(area, stroke, dead, line) * 1e6
    yield Derived(key, volume, (*rods, "stroke_mm", *own), typical, yields=not own)


def _derive_friction(sheet: Sheet, area: float) -> Iterator[Derived]:
    has_datum = sheet.has("breakaway_pressure_bar")
    breakaway = sheet.number("breakaway_pressure_bar", BREAKAWAY_BAR)
    strength = breakaway * 1e5 * area
    source = ("breakaway_pressure_bar", "bore_mm") if has_datum else ("bore_mm",)
    typical = "" if has_datum else f"breakaway at {BREAKAWAY_BAR:g} bar"
    yield Derived("static_friction_n", strength, source, typical, yields=not has_datum)
    share = "two thirds of the breakaway friction"
    yield Derived("coulomb_friction_n", COULOMB_SHARE * strength, source, share, yields=True)
    viscous = f"{VISCOUS_PRESSURE * 1e-5:g} bar at 1 m/s"
    sigma = VISCOUS_PRESSURE * area
    yield Derived("viscous_friction_n_s_m", sigma, ("bore_mm",), viscous, yields=True)


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
