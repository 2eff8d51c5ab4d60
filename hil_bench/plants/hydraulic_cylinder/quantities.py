"""The quantities of the cylinder, in the paper's symbols where it has some."""

from collections.abc import Sequence
from typing import Final

from hil_bench.plants.hydraulic_cylinder.model.state import PlantOutput
from hil_bench.plants.plant import Quantity, Shown

_PLACE = {field: place for place, field in enumerate(PlantOutput._fields)}

POSITION: Final = Quantity(
    "position",
    "m",
    _PLACE["x"],
    tolerance=1e-3,
    residual=0.5e-3,
    is_anchor=True,
    shown=Shown("x {:+z8.2f} mm", 1e3),
)
"""Of the piston; a command that is late by 2 ms moves it by 0.5 mm at 0.25 m/s."""
SPEED: Final = Quantity("speed", "m/s", _PLACE["v"])
PRESSURE_A: Final = Quantity(
    "P_A",
    "Pa",
    _PLACE["P_A"],
    tolerance=2e5,
    residual=0.25e5,
    is_anchor=True,
    shown=Shown("P_A {:z5.1f}", 1e-5),
)
PRESSURE_B: Final = Quantity(
    "P_B",
    "Pa",
    _PLACE["P_B"],
    tolerance=2e5,
    residual=0.25e5,
    is_anchor=True,
    shown=Shown("P_B {:z5.1f} bar", 1e-5),
)
SPOOL_SETPOINT: Final = Quantity("spool_setpoint", "-", None, is_share=True)
SPOOL_POSITION: Final = Quantity(
    "spool_position",
    "-",
    _PLACE["nu"],
    is_share=True,
    tolerance=0.02,
    residual=0.03,
    shown=Shown("spool {:+z6.1f} %", 100.0),
)
FLOW_A: Final = Quantity("Q_A", "m³/s", _PLACE["Q_A"], is_recorded=False)
FLOW_B: Final = Quantity("Q_B", "m³/s", _PLACE["Q_B"], is_recorded=False)

QUANTITIES: Final = (
    POSITION,
    SPEED,
    PRESSURE_A,
    PRESSURE_B,
    SPOOL_SETPOINT,
    SPOOL_POSITION,
    FLOW_A,
    FLOW_B,
)


def with_lines(quantities: Sequence[Quantity], sides: str) -> tuple[Quantity, ...]:
    """Return the quantities of a plant with lines at these sides, "a", "b" or "ab".

    `P_A_valve` and `P_B_valve` are the pressures at the valve's ends of the lines.
    """
    first = _after(quantities)
    at_valve = (
        Quantity(f"P_{side.upper()}_valve", "Pa", first + place) for place, side in enumerate(sides)
    )
    return (*quantities, *at_valve)


P_S: Final = "P_S"
"""Pressure of a supply unit, an axis' own or shared [Pa]."""
Q_S: Final = "Q_S"
"""What an axis draws from it [m³/s]: of a shared one on average over a tick, of its own now."""

T_OIL: Final = "T_oil"
"""Temperature of the supply's oil [°C]."""


FILTER_DROP: Final = "filter_drop"
"""Pressure drop over the supply's filter, as its clogging indicator has it [Pa]."""


def with_supply(
    quantities: Sequence[Quantity], *, is_shared: bool, has_filter: bool
) -> tuple[Quantity, ...]:
    """Return the quantities of a plant with those of its supply unit, which come last.

    Args:
        quantities: of the plant.
        is_shared: whether others draw from the unit too; such a unit knows its oil's temperature.
        has_filter: whether the unit has one.
    """
    seen = [(P_S, "Pa"), (Q_S, "m³/s")]
    seen += [(T_OIL, "°C")] if is_shared else []
    seen += [(FILTER_DROP, "Pa")] if has_filter else []
    places = enumerate(seen, _after(quantities))
    return (*quantities, *(Quantity(name, unit, place) for place, (name, unit) in places))


def _after(quantities: Sequence[Quantity]) -> int:
    """Return the first place behind the outputs of a plant."""
    return 1 + max(each.output for each in quantities if each.output is not None)


LOAD: Final = "load"
"""What acts on the piston from outside [N]."""

P_A: Final = PRESSURE_A.name
P_B: Final = PRESSURE_B.name
PORTS: Final = (P_A, P_B)
"""The pressures at the cylinder's ports."""
