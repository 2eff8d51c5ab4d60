"""The valve-controlled hydraulic cylinder of Ruderman, IECON 2017."""

from hil_bench.plant.full_order import FullOrderPlant, Solver
from hil_bench.plant.options import EndStop, PlantOptions
from hil_bench.plant.parameters import PlantParameters, paper_parameters
from hil_bench.plant.state import PlantInput, PlantOutput, PlantState, balanced_state

__all__ = [
    "EndStop",
    "FullOrderPlant",
    "PlantInput",
    "PlantOptions",
    "PlantOutput",
    "PlantParameters",
    "PlantState",
    "Solver",
    "balanced_state",
    "paper_parameters",
]
