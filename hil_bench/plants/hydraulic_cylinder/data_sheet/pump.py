"""The flow of a pump from its data sheet, and what a supply has that nobody has given."""

from collections.abc import Iterator

from hil_bench.config.settings import Origin, Settings
from hil_bench.plants.hydraulic_cylinder.data_sheet.sheet import Derived, Sheet
from hil_bench.plants.hydraulic_cylinder.keys import PUMP_SHEET, SUPPLY_KEYS, Supply

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
