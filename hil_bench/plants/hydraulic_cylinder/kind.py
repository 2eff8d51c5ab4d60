"""The hydraulic cylinder as a kind of plant."""

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from hil_bench.config.settings import Problems, Settings
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig, configure
from hil_bench.plants.hydraulic_cylinder.cylinder import build_cylinder
from hil_bench.plants.hydraulic_cylinder.data_sheet.derive import apply_data_sheet, find_leftovers
from hil_bench.plants.hydraulic_cylinder.keys import AXIS_KEYS
from hil_bench.plants.hydraulic_cylinder.picture import cylinder_page
from hil_bench.plants.hydraulic_cylinder.quantities import QUANTITIES
from hil_bench.plants.hydraulic_cylinder.resolution import find_unresolved
from hil_bench.plants.hydraulic_cylinder.summary import USUAL_RESULTS, summarise
from hil_bench.plants.hydraulic_cylinder.valve_controlled import VALVE_NODES, ValveControlled
from hil_bench.plants.kind import Fact
from hil_bench.plants.page import Page
from hil_bench.plants.plant import Plant, PlantGroup
from hil_bench.plants.quantity import Quantity


class HydraulicCylinder(ValveControlled[CylinderConfig]):
    """A valve-controlled cylinder by Ruderman 2017, full-order or reduced."""

    name = "hydraulic_cylinder"
    keys = AXIS_KEYS
    quantities: tuple[Quantity, ...] = QUANTITIES
    usual_results = USUAL_RESULTS
    default_nodes = MappingProxyType(
        {**VALVE_NODES, "position": {"profile": "encoder_406", "node_id": 4}}
    )

    def configure(
        self, name: str, settings: Settings, step_us: int, problems: Problems
    ) -> CylinderConfig | None:
        """Return the record of an axis."""
        return configure(self, name, settings, step_us, problems)

    def derive(self, settings: Settings, problems: Problems) -> Settings:
        """Return the settings of an axis with what its data sheets determine."""
        return apply_data_sheet(settings, problems)

    def find_leftovers(self, settings: Settings) -> Iterator[tuple[str, str]]:
        """Yield the parts of an axis that are still Table I's beside data sheets of others."""
        return find_leftovers(settings)

    def summarise(self, axis: CylinderConfig, tick_us: int, step_us: int) -> Sequence[Fact]:
        """Return speeds, forces, pressures, frequencies and energies of an axis."""
        return summarise(axis, tick_us, step_us)

    def build(
        self, axis: CylinderConfig, dt: float, start: Mapping[str, float] | None = None
    ) -> Plant:
        """Return the model of an axis."""
        return build_cylinder(axis, dt, start)

    def group(self, plants: Sequence[Plant]) -> PlantGroup | None:
        """Return the group that moves the models without extensions in one call."""
        from hil_bench.plants.hydraulic_cylinder.group import (  # noqa: PLC0415 - wants NumPy
            group_cylinders,
        )

        return group_cylinders(plants)

    def page(self, axis: CylinderConfig) -> Page:
        """Return the picture of an axis, to scale."""
        return cylinder_page(axis)

    def find_doubts(self, axis: CylinderConfig, tick_us: int, step_us: int) -> Iterator[str]:
        """Yield the oscillations that neither tick nor step resolves."""
        return find_unresolved(axis, tick_us, step_us)


HYDRAULIC_CYLINDER: Final = HydraulicCylinder()
