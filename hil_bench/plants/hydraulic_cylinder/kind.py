"""The hydraulic cylinder as a kind of plant, and its common parts with a hydraulic motor."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final, Self

from hil_bench.config.settings import Problems, Settings
from hil_bench.plants.hydraulic_cylinder import configuration, summary
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig, full_opening_mm
from hil_bench.plants.hydraulic_cylinder.cylinder import build_cylinder
from hil_bench.plants.hydraulic_cylinder.data_sheet import derive as data_sheet
from hil_bench.plants.hydraulic_cylinder.keys import (
    AXIS_KEYS,
    FILTER_RATING,
    SUPPLY_KEY,
    LineModel,
    Supply,
)
from hil_bench.plants.hydraulic_cylinder.picture import cylinder_page
from hil_bench.plants.hydraulic_cylinder.quantities import (
    P_A,
    P_B,
    QUANTITIES,
    with_lines,
    with_supply,
)
from hil_bench.plants.hydraulic_cylinder.resolution import find_unresolved
from hil_bench.plants.plant import AxisT, Plant, PlantGroup, PlantKind, Quantity
from hil_bench.units import MILLIMETRE

# Common parts of the kinds of plants that a spool valve controls: cylinder and motor.


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


class HydraulicCylinder(ValveControlled[CylinderConfig]):
    """A valve-controlled cylinder by Ruderman 2017, full-order or reduced."""

    name = "hydraulic_cylinder"
    keys = AXIS_KEYS
    quantities: tuple[Quantity, ...] = QUANTITIES
    usual_results = summary.USUAL_RESULTS
    default_nodes = MappingProxyType(
        {**VALVE_NODES, "position": {"profile": "encoder_406", "node_id": 4}}
    )

    configure = configuration.configure
    derive = staticmethod(data_sheet.apply_data_sheet)
    find_leftovers = staticmethod(data_sheet.find_leftovers)
    summarise = staticmethod(summary.summarise)
    page = staticmethod(cylinder_page)
    find_doubts = staticmethod(find_unresolved)

    def build(
        self, axis: CylinderConfig, dt: float, start: Mapping[str, float] | None = None
    ) -> Plant:
        """Return the model of an axis."""
        return build_cylinder(axis, dt, start)

    def group(self, plants: Sequence[Plant]) -> PlantGroup | None:
        """Return the group that moves the models without extensions in one call."""
        from hil_bench.plants.hydraulic_cylinder.cylinder import (  # noqa: PLC0415 - wants NumPy
            group_cylinders,
        )

        return group_cylinders(plants)


HYDRAULIC_CYLINDER: Final = HydraulicCylinder()
