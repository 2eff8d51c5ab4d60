"""The values of a data sheet, and those of its oil and pump."""

import math
from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

from hil_bench.config.settings import Origin, Problems, Settings
from hil_bench.plants.hydraulic_cylinder.keys import PUMP_SHEET, SUPPLY_KEYS, Supply

# The values of a data sheet, and the values derived from them.


class Derived(NamedTuple):
    """A physical key that a data sheet determines.

    Attributes:
        key: its name.
        value: in the key's unit.
        sources: the data of the sheet that it follows from.
        typical: what of it is a typical value and no datum; empty for nothing.
        yields: whether a value that the file gives for the key itself comes first.
    """

    key: str
    value: float
    sources: tuple[str, ...] = ()
    typical: str = ""
    yields: bool = False

    @property
    def reason(self) -> str:
        """The origin of the value, in the words of `hil-bench check`."""
        parts = [f"from {join(self.sources)}"] if self.sources else []
        parts += [f"typical: {self.typical}"] if self.typical else []
        return "; ".join(parts)


class Sheet:
    """The keys of an axis as data of a sheet.

    Args:
        settings: of the axis, one for each key.
        problems: where problems are noted.

    Attributes:
        is_sound: whether nothing was refused so far.
    """

    def __init__(self, settings: Settings, problems: Problems) -> None:
        self.settings = settings
        self.is_sound = True
        self._problems = problems

    def has(self, *names: str) -> bool:
        """Return True if somebody has given each of these keys."""
        return all(
            self.settings[name].origin is not Origin.DEFAULT
            and self.settings[name].value is not None
            for name in names
        )

    def given(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return those of these keys that somebody has given."""
        return tuple(name for name in names if self.has(name))

    def number(self, name: str, default: float = math.nan) -> float:
        """Return the value of a key in its own unit; a default where it has none."""
        value = self.settings[name].value
        return default if value is None else float(value)

    def si(self, name: str, default: float = math.nan) -> float:
        """Return the value of a key in SI."""
        value = self.settings[name].value
        return default if value is None else self.settings[name].key.unit.to_si(value)

    def refuse(self, name: str, what: str) -> None:
        """Note what is wrong with a key and what would be right."""
        table = self.settings[name].table
        self._problems.add(self._problems.place(table, name), what)
        self.is_sound = False

    def require(self, cause: str, examples: Iterable[tuple[str, str]]) -> bool:
        """Note which of some keys are missing, each with an example; return whether none is."""
        missing = [(name, example) for name, example in examples if not self.has(name)]
        for name, example in missing:
            right = f"give for example {name} = {example}"
            self.refuse(name, f"missing; {cause} is given and needs it; {right}")
        return not missing

    def take(self, derived: Iterable[Derived]) -> Iterator[Derived]:
        """Yield what fills its key; what the file gives a second time is refused."""
        for each in derived:
            if not self.has(each.key):
                yield each
            elif not each.yields:
                right = f"leave it out, or leave out {join(each.sources)}"
                self.refuse(each.key, f"given twice: {join(each.sources)} says it too; {right}")


def join(names: Iterable[str]) -> str:
    """Return names as a sentence lists them."""
    *rest, last = names
    return f"{', '.join(rest)} and {last}" if rest else last


# Density, viscosity and bulk modulus of an oil by its class.


KELVIN = 273.15

EXPANSION = 7e-4
"""A typical thermal expansion of mineral oil [1/K]."""

SOFTENING: Final = 0.0024
"""Decades by which the bulk modulus of mineral oil falls for each K [1/K]."""

TEMPERATURE_C = 40.0
"""Of an oil of which none is given: that of the viscosity in its name."""


class Oil(NamedTuple):
    """A class of oil; all but the viscosity at 40 °C, which ISO 3448 says, are typical values.

    Attributes:
        density: at 15 °C [kg/m³].
        viscosity_40: at 40 °C [mm²/s].
        viscosity_100: at 100 °C [mm²/s].
        bulk_modulus: of the pure oil at 40 °C and some 100 bar, in rigid lines [MPa].
    """

    density: float
    viscosity_40: float
    viscosity_100: float
    bulk_modulus: float

    def density_at(self, temperature: float) -> float:
        """Return the density [kg/m³] at a temperature [°C]."""
        return self.density / (1.0 + EXPANSION * (temperature - 15.0))

    def stiffness_at(self, temperature: float) -> float:
        """Return the bulk modulus at a temperature [°C] over that at 40 °C.

        It falls by 10^0.0024 for each K (A. T. J. Hayward, How to estimate the bulk modulus of
        hydraulic fluids, Hydraulic Pneumatic Power 16, 1970, for isentropic compression).
        """
        return float(10.0 ** (SOFTENING * (TEMPERATURE_C - temperature)))

    def viscosity_at(self, temperature: float) -> float:
        """Return the kinematic viscosity [mm²/s] at a temperature [°C], by ASTM D341.

        log10 log10 (nu + 0.7) = a - b log10 T, through the values at 40 and 100 °C.
        """
        cold, hot = math.log10(40.0 + KELVIN), math.log10(100.0 + KELVIN)
        at_cold = math.log10(math.log10(self.viscosity_40 + 0.7))
        at_hot = math.log10(math.log10(self.viscosity_100 + 0.7))
        share = (math.log10(temperature + KELVIN) - cold) / (hot - cold)
        inner = float(10.0 ** (at_cold + share * (at_hot - at_cold)))
        return float(10.0**inner) - 0.7


OILS: Final[dict[str, Oil]] = {
    "HLP 22": Oil(865.0, 22.0, 4.3, 1400.0),
    "HLP 32": Oil(870.0, 32.0, 5.4, 1400.0),
    "HLP 46": Oil(875.0, 46.0, 6.8, 1400.0),
    "HLP 68": Oil(880.0, 68.0, 8.7, 1400.0),
    "HLP 100": Oil(885.0, 100.0, 11.4, 1400.0),
    "HVLP 32": Oil(870.0, 32.0, 6.3, 1400.0),
    "HVLP 46": Oil(875.0, 46.0, 8.2, 1400.0),
    "HVLP 68": Oil(880.0, 68.0, 10.9, 1400.0),
    "HEES 46": Oil(920.0, 46.0, 9.3, 1500.0),
}
"""By the names of DIN 51524 and ISO 15380: the class and the viscosity grade of ISO 3448."""


def find_oil(sheet: Sheet) -> Oil | None:
    """Return the oil of a sheet; None without one, or for one that is refused."""
    if not sheet.has("oil"):
        if sheet.has("oil_temperature_c"):
            right = 'give oil = "HLP 46" for example'
            sheet.refuse("oil_temperature_c", f"says nothing without an oil; {right}")
        return None
    oil = known_oil(sheet)
    if oil is None:
        known = ", ".join(f'"{each}"' for each in OILS)
        given = sheet.settings["oil"].value
        sheet.refuse("oil", f'"{given}" is unknown; give one of {known}')
    return oil


def known_oil(sheet: Sheet) -> Oil | None:
    """Return the oil of a sheet; None without one, or for one that is unknown."""
    name = " ".join(str(sheet.settings["oil"].value).upper().replace("-", " ").split())
    return OILS.get(name)


def derive_oil(sheet: Sheet, oil: Oil | None) -> Iterator[Derived]:
    """Yield density, bulk modulus and, where a plant asks for it, viscosity of an oil."""
    if oil is None:
        return
    temperature = sheet.number("oil_temperature_c", TEMPERATURE_C)
    density = oil.density_at(temperature)
    sources = sheet.given(("oil", "oil_temperature_c"))
    heat = "" if sheet.has("oil_temperature_c") else f"at {TEMPERATURE_C:g} °C"
    yield Derived("oil_density_kg_m3", density, sources, heat, yields=True)
    what = "oil without air in rigid lines"
    yield Derived("bulk_modulus_mpa", oil.bulk_modulus, ("oil",), what, yields=True)
    if "oil_viscosity_mm2_s" in sheet.settings:
        viscosity = oil.viscosity_at(temperature)
        yield Derived("oil_viscosity_mm2_s", viscosity, sources, heat, yields=True)


# The flow of a pump from its data sheet, and what a supply has that nobody has given.


EFFICIENCY = 0.92
"""A typical volumetric efficiency of a gear or piston pump at its rated pressure."""

_NAMES = tuple(key.name for key in PUMP_SHEET)
_ACTING = ("pump_flow_l_min", "relief_pressure_bar", "supply_pressure_bar")


def derive_pump(sheet: Sheet) -> Iterator[Derived]:
    """Yield the flow Q = V n eta of a pump; in a table of its own a supply always has one."""
    given = sheet.given(_NAMES)
    if not given:
        return
    if "supply" in sheet.settings and sheet.settings["supply"].value is Supply.CONSTANT:
        right = 'give supply = "unit"'
        sheet.refuse(given[0], f"the supply pressure is constant, whatever the pump; {right}")
        return
    wanted = (
        ("pump_displacement_cm3", "28"),
        ("pump_speed_rpm", "1450"),
        ("relief_pressure_bar", "210"),
    )
    if not sheet.require(given[0], wanted):
        return
    efficiency = sheet.si("pump_volumetric_efficiency_percent", EFFICIENCY)
    flow = sheet.number("pump_displacement_cm3") * sheet.number("pump_speed_rpm") * 1e-3
    typical = "" if sheet.has(_NAMES[2]) else f"volumetric efficiency {100 * EFFICIENCY:g} %"
    yield Derived("pump_flow_l_min", flow * efficiency, given, typical)


def find_assumed_supply(settings: Settings) -> Iterator[tuple[str, str]]:
    """Yield the keys of a supply that act although nobody gave them, or do not act although given.

    Args:
        settings: of an axis or of a ``[supply.NAME]``, one for each key.
    """
    if "supply" in settings and settings["supply"].value is Supply.CONSTANT:
        for key in SUPPLY_KEYS:
            value = settings[key.name].value
            if value != key.default:
                yield key.name, f'{value:g}: a constant supply has none; give supply = "unit" too'
        return
    flow, relief, start = (settings[name] for name in _ACTING)
    if flow.origin is Origin.DEFAULT:
        right = "give pump_flow_l_min, or pump_displacement_cm3 and pump_speed_rpm"
        yield flow.key.name, f"{flow.value:g} is an assumption, nothing says the pump; {right}"
    if relief.origin is Origin.DEFAULT and relief.value != start.value:
        wrong = f"{relief.value:g} is an assumption, although {start.key.name} = {start.value:g}"
        yield relief.key.name, f"{wrong}; give what the relief valve is set to"
