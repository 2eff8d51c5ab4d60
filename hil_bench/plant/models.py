"""Which model stands behind a bench's cylinder."""

from enum import StrEnum

from hil_bench.plant.full_order import FullOrderPlant, largest_step
from hil_bench.plant.options import PlantOptions
from hil_bench.plant.parameters import PlantParameters
from hil_bench.plant.reduced_order import (
    ReducedOrderPlant,
    balanced_reduced_state,
    largest_reduced_step,
)
from hil_bench.plant.state import balanced_state
from hil_bench.plant.stepping import Plant, Solver


class Model(StrEnum):
    """The paper's two models."""

    FULL_ORDER = "full-order"
    REDUCED = "reduced"


def plant_at_rest(
    model: Model,
    parameters: PlantParameters,
    *,
    options: PlantOptions,
    solver: Solver,
    dt: float,
    x: float = 0.0,
    delay: float = 0.0,
) -> Plant:
    """Return a plant whose pressures hold the piston and the loads of the options.

    Args:
        model: which.
        parameters: of valve and cylinder.
        options: what the paper leaves open.
        solver: of the equations.
        dt: step [s].
        x: piston position [m].
        delay: in place of the spool's lag, for the reduced model [s].
    """
    F_L = options.load_at(x)
    if model is Model.REDUCED:
        state = balanced_reduced_state(parameters, x=x, F_L=F_L)
        return ReducedOrderPlant(
            parameters, options=options, solver=solver, dt=dt, state=state, delay=delay
        )
    state = balanced_state(parameters, x=x, F_L=F_L)
    return FullOrderPlant(parameters, options=options, solver=solver, dt=dt, state=state)


def largest_stable_step(
    model: Model, parameters: PlantParameters, options: PlantOptions, solver: Solver
) -> float:
    """Return the largest step that a solver can take over the operating range [s].

    As `hil_bench.plant.full_order.largest_step`.
    """
    find = largest_reduced_step if model is Model.REDUCED else largest_step
    return find(parameters, options, solver)
