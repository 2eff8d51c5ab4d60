"""Everything a stepping kernel needs to know, as one row of floats.

A row crosses from Python into compiled code faster than a record does. `pack` is written once per
plant, `unpack` sorts the row into one tuple per equation group at the start of a call.
"""

import math
from collections.abc import Sequence

from hil_bench.plants.hydraulic_cylinder.model.chamber import ChamberConstants
from hil_bench.plants.hydraulic_cylinder.model.friction import FrictionConstants
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel
from hil_bench.plants.hydraulic_cylinder.model.load import StopConstants
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.orifice import OrificeConstants
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.spool import (
    OpeningConstants,
    SpoolConstants,
    SpoolTransition,
    spool_reach,
    spool_transition,
)

StepConstants = tuple[float, float, float, float]
"""(dt [s], m [kg], 1 / (E dt) [1/(Pa s)], lowest chamber pressure [Pa])."""

ORIFICE_P_S = 17
"""Place of P_S in the row of constants."""

ROW = 37
"""Constants in a row."""

Constants = tuple[
    StepConstants,
    SpoolConstants,
    OpeningConstants,
    SpoolTransition,
    OrificeConstants,
    ChamberConstants,
    FrictionConstants,
    StopConstants,
]


def pack(parameters: PlantParameters, options: PlantOptions, dt: float) -> Sequence[float]:
    """Return the constants of a plant stepped by `dt` [s], in the order that `unpack` expects."""
    p = parameters
    stop = options.end_stop
    floor = options.cavitation_floor
    alpha_negative, beta_negative = options.alpha_negative, options.beta_negative
    constants: Constants = (
        (dt, p.m + options.load_mass, 1.0 / (p.E * dt), -math.inf if floor is None else floor),
        (
            p.omega_0**2,
            2.0 * p.xi * p.omega_0,
            spool_reach(p.omega_0, p.xi, options.spool_speed),
        ),
        (
            p.alpha,
            p.beta,
            p.alpha if alpha_negative is None else alpha_negative,
            p.beta if beta_negative is None else beta_negative,
        ),
        spool_transition(p.omega_0, p.xi, dt, options.spool_speed),
        (p.K, p.P_S, p.P_T, options.laminar_transition**2, float(options.signed_root)),
        (p.E, p.C_L, p.A_A, p.A_B, p.V_A0, p.V_B0, p.h),
        (p.F_c, p.F_s - p.F_c, p.sigma, math.log(p.chi), p.delta, options.tanh_gain),
        (math.inf, 0.0, 0.0) if stop is None else (p.h, stop.stiffness, stop.damping),
    )
    return [float(value) for group in constants for value in group]


@kernel
def unpack(row: Floats) -> Constants:
    """Return the constants in their groups."""
    return unpack_lane(row, 0, 1)


@kernel
def unpack_lane(row: Floats, first: int, stride: int) -> Constants:
    """Return the constants of one plant among several, whose first is at `first`, in their groups.

    Args:
        row: of all plants; each constant of all of them, then the next constant.
        first: index of the plant's first constant.
        stride: how many places lie between two constants of a plant.
    """
    f, s = first, stride
    return (
        (row[f], row[f + s], row[f + 2 * s], row[f + 3 * s]),
        (row[f + 4 * s], row[f + 5 * s], row[f + 6 * s]),
        (row[f + 7 * s], row[f + 8 * s], row[f + 9 * s], row[f + 10 * s]),
        (row[f + 11 * s], row[f + 12 * s], row[f + 13 * s], row[f + 14 * s], row[f + 15 * s]),
        (row[f + 16 * s], row[f + 17 * s], row[f + 18 * s], row[f + 19 * s], row[f + 20 * s]),
        (
            row[f + 21 * s],
            row[f + 22 * s],
            row[f + 23 * s],
            row[f + 24 * s],
            row[f + 25 * s],
            row[f + 26 * s],
            row[f + 27 * s],
        ),
        (
            row[f + 28 * s],
            row[f + 29 * s],
            row[f + 30 * s],
            row[f + 31 * s],
            row[f + 32 * s],
            row[f + 33 * s],
        ),
        (row[f + 34 * s], row[f + 35 * s], row[f + 36 * s]),
    )
