"""Common parts of the kinds of plants that a spool valve controls: cylinder and motor."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final, Self

from hil_bench.config.settings import Problems, Settings
from hil_bench.plants.hydraulic_cylinder.configuration import full_opening_mm
from hil_bench.plants.hydraulic_cylinder.keys import FILTER_RATING, SUPPLY_KEY, LineModel, Supply
from hil_bench.plants.hydraulic_cylinder.quantities import P_A, P_B, with_lines, with_supply
from hil_bench.plants.kind import AxisT, PlantKind
from hil_bench.plants.plant import Quantity
from hil_bench.units import MILLIMETRE

VALVE_NODES: Final[Mapping[str, Mapping[str, object]]] = MappingProxyType(
    {
        "valve": {"profile": "valve_408", "node_id": 1},
        "pressure_a": {"profile": "pressure_404", "node_id": 2, "source": P_A},
        "pressure_b": {"profile": "pressure_404", "node_id": 3, "source": P_B},
    }
)
"""The nodes of a file without any, but for the encoder."""


class ValveControlled(PlantKind[AxisT]):
    """A plant between the ports of a spool valve, with its supply and tank."""

    command_unit = MILLIMETRE

    def full_scale(self, settings: Settings) -> float:
        """Return the spool position from which on the orifices are fully open [mm]."""
        return full_opening_mm(settings)

    def lowest_supply_bar(self, settings: Settings) -> float:
        """Return the pressure of the tank [bar]."""
        return float(settings["tank_pressure_bar"].value)

    def supply_of(self, settings: Settings) -> str:
        """Return the name of the supply that an axis shares; empty for one of its own."""
        value = settings[SUPPLY_KEY.name].value
        return "" if value in set(Supply) else str(value)

    def specialise(self, settings: Settings, folder: Path, problems: Problems) -> Self:
        """Return the kind with the pressures at the valve, and with those of a shared supply."""
        quantities = self._see_more(settings)
        if quantities is self.quantities:
            return self
        special = type(self)()
        special.quantities = quantities
        return special

    def _see_more(self, settings: Settings) -> tuple[Quantity, ...]:
        """Return the quantities with those of lines with waves and of a supply unit."""
        quantities = self.quantities
        if settings["line_model"].value is not LineModel.VOLUME:
            sides = "".join(s for s in "ab" if settings[f"line_{s}_length_m"].value)
            quantities = with_lines(quantities, sides)
        is_shared = bool(self.supply_of(settings))
        if not is_shared and settings[SUPPLY_KEY.name].value is not Supply.UNIT:
            return quantities
        has_filter = settings[FILTER_RATING[0].name].value is not None
        return with_supply(quantities, is_shared=is_shared, has_filter=has_filter)
