"""The valve-controlled hydraulic cylinder of Ruderman, IECON 2017."""

from hil_bench.plants.hydraulic_cylinder.model.constants import ExtensionState
from hil_bench.plants.hydraulic_cylinder.model.extensions import (
    CounterbalanceValve,
    Cushion,
    EntrainedAir,
    LuGreFriction,
    MeteringLands,
    SupplyUnit,
    VariablePump,
)
from hil_bench.plants.hydraulic_cylinder.model.full_order import FullOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.load import (
    ConstantLoad,
    Load,
    LoadSeries,
    MassOnSlope,
    SpringLoad,
)
from hil_bench.plants.hydraulic_cylinder.model.models import Model
from hil_bench.plants.hydraulic_cylinder.model.options import EndStop, PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters, paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.reduced_order import ReducedOrderPlant, spool_delay
from hil_bench.plants.hydraulic_cylinder.model.state import (
    PlantInput,
    PlantOutput,
    PlantState,
    balanced_state,
)
from hil_bench.plants.hydraulic_cylinder.model.stepping import PlantModel, Solver
from hil_bench.plants.hydraulic_cylinder.model.waves import Line

__all__ = [
    "ConstantLoad",
    "CounterbalanceValve",
    "Cushion",
    "EndStop",
    "EntrainedAir",
    "ExtensionState",
    "FullOrderPlant",
    "Line",
    "Load",
    "LoadSeries",
    "LuGreFriction",
    "MassOnSlope",
    "MeteringLands",
    "Model",
    "PlantInput",
    "PlantModel",
    "PlantOptions",
    "PlantOutput",
    "PlantParameters",
    "PlantState",
    "ReducedOrderPlant",
    "Solver",
    "SpringLoad",
    "SupplyUnit",
    "VariablePump",
    "balanced_state",
    "paper_parameters",
    "spool_delay",
]
