"""The right-hand side of the full-order model, as the plant's solver for references takes it."""

import math

import numpy as np
import numpy.typing as npt

from hil_bench.plants.hydraulic_cylinder.model import (
    PlantInput,
    PlantOptions,
    PlantParameters,
    PlantState,
    SpringLoad,
    runge_kutta,
)
from hil_bench.plants.hydraulic_cylinder.model.constants import Constants, pack, unpack
from hil_bench.plants.hydraulic_cylinder.model.extended_constants import (
    pack_extended,
    unpack_extended,
)
from hil_bench.plants.hydraulic_cylinder.model.friction import friction_force
from hil_bench.plants.hydraulic_cylinder.model.kernel import make_row
from hil_bench.plants.hydraulic_cylinder.model.spool import orifice_state

Rates = npt.NDArray[np.float64]
"""Time derivatives of x, v, P_A, P_B, nu, nu_dot."""

_ANY_STEP = 1e-4
"""A right-hand side has no step, but a row of constants a place for one [s]."""


def state_rates(
    parameters: PlantParameters,
    options: PlantOptions,
    state: PlantState,
    plant_input: PlantInput,
) -> Rates:
    """Return the time derivatives of the six states [m/s, m/s², Pa/s, Pa/s, m/s, m/s²].

    The loads of the options are those of time 0, bristles are straight, the supply is at P_S.
    """
    row = make_row(pack_extended(parameters, options, _ANY_STEP))
    # The kernel adds the springs, which follow the position.
    loads = [load for load in options.loads if not isinstance(load, SpringLoad)]
    load = plant_input.F_L + math.fsum(load.force_at(state.x, 0.0) for load in loads)
    states = (*state, 0.0, parameters.P_S)
    rates = runge_kutta.state_rates(states, plant_input.u, load, unpack(row), unpack_extended(row))
    return np.array(rates[:6], dtype=np.float64)


def orifice_state_at(
    parameters: PlantParameters, options: PlantOptions, spool_position: float
) -> float:
    """Return the orifice state z [m] at a spool position [m], eq. (2)."""
    return float(orifice_state(spool_position, _constants(parameters, options)[2]))


def friction_at(parameters: PlantParameters, options: PlantOptions, velocity: float) -> float:
    """Return the friction force [N] at a constant piston velocity [m/s], eq. (13)."""
    return float(friction_force(velocity, _constants(parameters, options)[6]))


def _constants(parameters: PlantParameters, options: PlantOptions) -> Constants:
    return unpack(make_row(pack(parameters, options, _ANY_STEP)))
