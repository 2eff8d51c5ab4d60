"""The valve-controlled hydraulic cylinder of Ruderman, IECON 2017."""

from hil_bench.plant.extended_constants import ExtensionState
from hil_bench.plant.extensions import EntrainedAir, LuGreFriction, SupplyUnit
from hil_bench.plant.full_order import FullOrderPlant
from hil_bench.plant.loads import ConstantLoad, Load, LoadSeries, MassOnSlope, SpringLoad
from hil_bench.plant.models import Model
from hil_bench.plant.options import EndStop, PlantOptions
from hil_bench.plant.parameters import PlantParameters, paper_parameters
from hil_bench.plant.reduced_order import ReducedOrderPlant, spool_delay
from hil_bench.plant.state import PlantInput, PlantOutput, PlantState, balanced_state
from hil_bench.plant.stepping import Plant, Solver

__all__ = [
    "ConstantLoad",
    "EndStop",
    "EntrainedAir",
    "ExtensionState",
    "FullOrderPlant",
    "Load",
    "LoadSeries",
    "LuGreFriction",
    "MassOnSlope",
    "Model",
    "Plant",
    "PlantInput",
    "PlantOptions",
    "PlantOutput",
    "PlantParameters",
    "PlantState",
    "ReducedOrderPlant",
    "Solver",
    "SpringLoad",
    "SupplyUnit",
    "balanced_state",
    "paper_parameters",
    "spool_delay",
]
