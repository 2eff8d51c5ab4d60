"""The largest step at which the midpoint rule follows the piston's swing on the oil.

It stands apart from `model.stability`, the limits of explicit solvers, since that needs NumPy. The
linearly implicit midpoint rule is stable at every step, so it has no other limit.
"""

import math

from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters

RESOLUTION = 1.0
"""Largest frequency of a swing times step: then a period has six steps."""


def largest_midpoint_step(parameters: PlantParameters, options: PlantOptions) -> float:
    """Return the largest step at which the midpoint rule follows the piston's swing on the oil [s].

    It is stable beyond, but what it shows is no motion of the model: at `RESOLUTION` the swing's
    frequency comes out 7 % low, at ten times that 73 %.
    """
    p = parameters
    stiffness = max(
        p.E * (p.A_A**2 / (p.V_A0 + p.A_A * x) + p.A_B**2 / (p.V_B0 - p.A_B * x))
        for x in (-p.h, p.h)
    )
    return _resolution_limit(stiffness, parameters, options)


def largest_reduced_midpoint_step(parameters: PlantParameters, options: PlantOptions) -> float:
    """Return the same for the reduced model [s]."""
    p = parameters
    return _resolution_limit(4.0 * p.E * p.mean_area**2 / p.total_volume, parameters, options)


def _resolution_limit(
    stiffness: float, parameters: PlantParameters, options: PlantOptions
) -> float:
    """Return `RESOLUTION` over the frequency of the sliding piston on the oil [s]."""
    m = parameters.m + options.load_mass
    square = stiffness / m - (0.5 * parameters.sigma / m) ** 2
    return RESOLUTION / math.sqrt(square) if square > 0.0 else math.inf
