"""The flow of a pump from its data sheet."""

from collections.abc import Iterator

from hil_bench.plants.hydraulic_cylinder.data_sheet.sheet import Derived, Sheet
from hil_bench.plants.hydraulic_cylinder.data_sheet_keys import PUMP_KEYS
from hil_bench.plants.hydraulic_cylinder.keys import Supply

EFFICIENCY = 0.92
"""A typical volumetric efficiency of a gear or piston pump at its rated pressure."""

_NAMES = tuple(key.name for key in PUMP_KEYS)


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
