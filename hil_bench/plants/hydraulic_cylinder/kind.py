"""The hydraulic cylinder as a kind of plant."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

from hil_bench.plants.hydraulic_cylinder import configuration, summary
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.cylinder import build_cylinder
from hil_bench.plants.hydraulic_cylinder.data_sheet import derive as data_sheet
from hil_bench.plants.hydraulic_cylinder.keys import AXIS_KEYS
from hil_bench.plants.hydraulic_cylinder.picture import cylinder_page
from hil_bench.plants.hydraulic_cylinder.quantities import QUANTITIES
from hil_bench.plants.hydraulic_cylinder.resolution import find_unresolved
from hil_bench.plants.hydraulic_cylinder.valve_controlled import VALVE_NODES, ValveControlled
from hil_bench.plants.plant import Plant, PlantGroup, Quantity


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
        from hil_bench.plants.hydraulic_cylinder.group import (  # noqa: PLC0415 - wants NumPy
            group_cylinders,
        )

        return group_cylinders(plants)


HYDRAULIC_CYLINDER: Final = HydraulicCylinder()
