"""Everything a stepping kernel needs to know, as one row of floats.

A row crosses from Python into compiled code faster than a record does. `pack` is written once per
plant, `unpack` sorts the row into one tuple per equation group at the start of a call.
"""

import math
from collections.abc import Sequence

from hil_bench.plant.chamber import ChamberConstants
from hil_bench.plant.friction import FrictionConstants
from hil_bench.plant.kernel import Floats, kernel
from hil_bench.plant.load import StopConstants
from hil_bench.plant.options import PlantOptions
from hil_bench.plant.orifice import OrificeConstants
from hil_bench.plant.parameters import PlantParameters
from hil_bench.plant.spool import OpeningConstants, SpoolTransition, spool_transition

SpoolConstants = tuple[float, float]
"""(omega_0², 2 xi omega_0)."""

StepConstants = tuple[float, float, float, float]
"""(dt [s], m [kg], 1 / (E dt) [1/(Pa s)], lowest chamber pressure [Pa])."""

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
        (p.omega_0**2, 2.0 * p.xi * p.omega_0),
        (
            p.alpha,
            p.beta,
            p.alpha if alpha_negative is None else alpha_negative,
            p.beta if beta_negative is None else beta_negative,
        ),
        spool_transition(p.omega_0, p.xi, dt),
        (p.K, p.P_S, p.P_T, options.laminar_transition**2, float(options.signed_root)),
        (p.E, p.C_L, p.A_A, p.A_B, p.V_A0, p.V_B0, p.h),
        (p.F_c, p.F_s - p.F_c, p.sigma, math.log(p.chi), p.delta, options.tanh_gain),
        (math.inf, 0.0, 0.0) if stop is None else (p.h, stop.stiffness, stop.damping),
    )
    return [float(value) for group in constants for value in group]


@kernel
def unpack(row: Floats) -> Constants:
    """Return the constants in their groups."""
    return (
        (row[0], row[1], row[2], row[3]),
        (row[4], row[5]),
        (row[6], row[7], row[8], row[9]),
        (row[10], row[11], row[12], row[13]),
        (row[14], row[15], row[16], row[17], row[18]),
        (row[19], row[20], row[21], row[22], row[23], row[24], row[25]),
        (row[26], row[27], row[28], row[29], row[30], row[31]),
        (row[32], row[33], row[34]),
    )
