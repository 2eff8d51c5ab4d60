"""The right-hand side of the full-order model, taken from the plant that steps it.

A step of forward Euler is the right-hand side times dt, so the plant itself says how fast each
state changes, with every option that it knows.
"""

import math

import numpy as np
import numpy.typing as npt

from hil_bench.plant import (
    FullOrderPlant,
    PlantInput,
    PlantOptions,
    PlantParameters,
    PlantState,
    Solver,
    balanced_state,
)
from hil_bench.plant.full_order import largest_euler_step

Rates = npt.NDArray[np.float64]
"""Time derivatives of x, v, P_A, P_B, nu, nu_dot."""


def state_rates(
    parameters: PlantParameters,
    options: PlantOptions,
    state: PlantState,
    plant_input: PlantInput,
) -> Rates:
    """Return the time derivatives of the six states [m/s, m/s², Pa/s, Pa/s, m/s, m/s²]."""
    return _rates(_plant(parameters, options, state), plant_input)


def orifice_state_at(
    parameters: PlantParameters, options: PlantOptions, spool_position: float
) -> float:
    """Return the orifice state z [m] at a spool position [m], eq. (2)."""
    state = balanced_state(parameters)._replace(nu=spool_position)
    return _plant(parameters, options, state).output.z


def friction_at(parameters: PlantParameters, options: PlantOptions, velocity: float) -> float:
    """Return the friction force [N] at a piston velocity [m/s], eq. (13)."""
    # Balanced pressures leave the friction alone to slow the piston down.
    state = balanced_state(parameters)._replace(v=velocity)
    return -parameters.m * float(state_rates(parameters, options, state, PlantInput(0.0))[1])


def _plant(parameters: PlantParameters, options: PlantOptions, state: PlantState) -> FullOrderPlant:
    # A power of two, so that multiplying and dividing by it round nothing.
    dt = 2.0 ** math.floor(math.log2(min(0.5 * largest_euler_step(parameters, options), 1e-4)))
    return FullOrderPlant(
        parameters, options=options, solver=Solver.FORWARD_EULER, dt=dt, state=state
    )


def _rates(plant: FullOrderPlant, plant_input: PlantInput) -> Rates:
    before = np.array(plant.state)
    plant.step(plant_input)
    return np.asarray((np.array(plant.state) - before) / plant.dt, dtype=np.float64)
