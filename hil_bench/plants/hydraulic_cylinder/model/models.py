"""The models of a bench's cylinder."""

from enum import StrEnum

from hil_bench.plants.hydraulic_cylinder.model.full_order import largest_step
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.reduced_order import largest_reduced_step
from hil_bench.plants.hydraulic_cylinder.model.stepping import Solver


class Model(StrEnum):
    """The paper's two models."""

    FULL_ORDER = "full-order"
    REDUCED = "reduced"


def largest_stable_step(
    model: Model, parameters: PlantParameters, options: PlantOptions, solver: Solver
) -> float:
    """Return the largest step that a solver can take over the operating range [s].

    As `model.full_order.largest_step`.
    """
    find = largest_reduced_step if model is Model.REDUCED else largest_step
    return find(parameters, options, solver)
