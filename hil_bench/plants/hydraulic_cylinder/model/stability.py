"""The largest step at which an explicit solver is stable over the whole operating range.

The model is linearised at points all over its range: positions along the stroke, valve closed and
fully open either way, the piston at standstill, sliding, and pressed against an end stop, pressure
drops from the full one down to `HARMLESS_DROP`. Each mode lambda of each linearisation must decay
in the solver as it does in the model: |R(lambda dt)| <= 1 with the solver's stability function R.

Three things are left out. Where the Stribeck curve falls, small openings have no stable motion in
the model either. Where a pressure drop is below `HARMLESS_DROP`, the square root of eqs. (5), (6)
is so steep that an explicit step rings, but by no more than that drop. And with the printed sign
the piston at standstill has no slope; it chatters at any step, by F_s dt / m.
"""

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.plants.hydraulic_cylinder.model.constants import supply_constants
from hil_bench.plants.hydraulic_cylinder.model.extensions import MeteringLands
from hil_bench.plants.hydraulic_cylinder.model.load import SpringLoad
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.supply import supply_compliance

HARMLESS_DROP = 1e-4
"""Pressure drop, as a share of P_S - P_T, below which ringing at an orifice is let pass."""

Modes = npt.NDArray[np.complex128]

# Shares of the stroke's half; the extremes are at its ends, where one chamber is smallest.
_POSITIONS = (-1.0, -0.5, 0.0, 0.5, 1.0)

# A mode slower than this share of the fastest is no limit; rounding can make it seem to grow.
_SLOW = 1e-6

# Damping below this share of a mode's frequency is rounding.
_UNDAMPED = 1e-9

# Runge-Kutta's region of stability ends before |lambda dt| = 2.9 to the left and 2.83 upwards.
_REACH = np.linspace(0.0, 3.0, 301)[1:]


class _Motion(NamedTuple):
    """The slope of the piston's force over velocity [N s/m] and over position [N/m]."""

    slope: float
    stiffness: float


def largest_euler_step(parameters: PlantParameters, options: PlantOptions) -> float:
    """Return the largest step at which forward Euler takes the full model [s]; 0 where none is."""
    return euler_limit(find_modes(parameters, options))


def largest_runge_kutta_step(parameters: PlantParameters, options: PlantOptions) -> float:
    """Return the largest step at which classical Runge-Kutta takes the full model [s]."""
    modes = find_modes(parameters, options)
    if options.bristles is not None:
        fastest = _largest_velocity(parameters, options)
        modes = np.append(modes, -options.bristles.sigma_0 * fastest / parameters.F_c)
    return runge_kutta_limit(modes)


def euler_limit(modes: Modes) -> float:
    """Return the largest step at which forward Euler is stable [s]; 0 where none is.

    R(z) = 1 + z, so each mode allows -2 Re(lambda) / |lambda|²: of an oscillation 2 zeta / omega.
    """
    damping = np.where(-modes.real > _UNDAMPED * np.abs(modes), -modes.real, 0.0)
    return float(np.min(2.0 * damping / np.abs(modes) ** 2))


def runge_kutta_limit(modes: Modes) -> float:
    """Return the largest step at which the classical Runge-Kutta method is stable [s].

    R(z) = 1 + z + z²/2 + z³/6 + z⁴/24, followed outwards on the ray of each mode.
    """
    size = np.abs(modes)
    z = np.outer(modes / size, _REACH)
    growth = np.abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0))))
    leaves = growth > 1.0 + _UNDAMPED
    first = np.where(leaves.any(axis=1), leaves.argmax(axis=1), _REACH.size) - 1
    return float(np.min(_REACH[np.maximum(first, 0)] / size))


def find_modes(parameters: PlantParameters, options: PlantOptions) -> Modes:
    """Return the modes of the linearised full model over its operating range [1/s]."""
    matrices = np.array(list(_cylinder_matrices(parameters, options)))
    modes = np.concatenate([np.linalg.eigvals(matrices).ravel(), _spool_modes(parameters)])
    if options.supply is not None:
        supply = supply_constants(options.supply, parameters.E)
        relief = options.supply
        rate = relief.relief_gradient / supply_compliance(relief.relief_pressure, supply)
        modes = np.append(modes, -rate)
    return _fast(modes)


def find_reduced_modes(parameters: PlantParameters, options: PlantOptions) -> Modes:
    """Return the modes of the linearised reduced model over its operating range [1/s].

    Its only volume is constant, so the stroke's ends differ by their stops alone.
    """
    p = parameters
    m = p.m + options.load_mass
    per_C = 4.0 * p.E / p.total_volume
    # The drop of eq. (14) is half of P_S - sign(z) P_L, and so is its slope over P_L.
    losses = [0.5 * slope + p.C_L for slope in _orifice_slopes(parameters, options)]
    matrices = [
        [
            [0.0, 1.0, 0.0],
            [-motion.stiffness / m, -motion.slope / m, p.mean_area / m],
            [0.0, -p.mean_area * per_C, -loss * per_C],
        ]
        for loss in losses
        for motion in _motions(parameters, options, is_end=True)
    ]
    return _fast(np.linalg.eigvals(np.array(matrices)).ravel())


def _fast(modes: Modes) -> Modes:
    """Return the modes without those whose growth or decay is rounding."""
    is_fast = np.abs(modes) > _SLOW * np.abs(modes).max()
    return np.asarray(modes[is_fast], dtype=np.complex128)


def _cylinder_matrices(
    parameters: PlantParameters, options: PlantOptions
) -> Iterator[list[list[float]]]:
    """Yield the linearised eqs. (8), (9), (12) in x, v, P_A, P_B at points of the range."""
    slopes = _orifice_slopes(parameters, options)
    for share, slope_A, slope_B in itertools.product(_POSITIONS, slopes, slopes):
        is_end = abs(share) == 1.0
        for motion in _motions(parameters, options, is_end=is_end):
            yield _matrix(parameters, options, share * parameters.h, (slope_A, slope_B), motion)


def _matrix(
    parameters: PlantParameters,
    options: PlantOptions,
    x: float,
    slopes: tuple[float, float],
    motion: _Motion,
) -> list[list[float]]:
    """Return the linearisation at position x [m], with the slopes of both orifices."""
    p = parameters
    m = p.m + options.load_mass
    per_C_A = p.E / (p.V_A0 + p.A_A * x)
    per_C_B = p.E / (p.V_B0 - p.A_B * x)
    loss_A = slopes[0] + p.C_L + options.C_LA
    loss_B = slopes[1] + p.C_L + options.C_LB
    return [
        [0.0, 1.0, 0.0, 0.0],
        [-motion.stiffness / m, -motion.slope / m, p.A_A / m, -p.A_B / m],
        [0.0, -p.A_A * per_C_A, -loss_A * per_C_A, p.C_L * per_C_A],
        [0.0, p.A_B * per_C_B, p.C_L * per_C_B, -loss_B * per_C_B],
    ]


def _widest_opening(parameters: PlantParameters, options: PlantOptions) -> float:
    """Return the opening of the widest edge of the wide open valve [m]."""
    lands = MeteringLands() if options.lands is None else options.lands
    opening = max(parameters.alpha, options.alpha_negative or 0.0)
    if lands.are_apart:
        # Both edges of a port may be open at once, and one of less overlap opens wider.
        reach = opening + max(parameters.beta, options.beta_negative or 0.0)
        least = min(parameters.beta if own is None else own for own in lands.overlaps)
        opening = reach + max(-2.0 * least, -least) + lands.null_opening
    return lands.largest_gain * opening


def _orifice_slopes(parameters: PlantParameters, options: PlantOptions) -> tuple[float, ...]:
    """Return -dQ/dP [m³/(s Pa)] of eqs. (5), (6): closed, wide open at the full drop, and steep."""
    span = parameters.P_S - parameters.P_T
    opening = _widest_opening(parameters, options)
    return (
        0.0,
        *(
            parameters.K * opening * _root_slope(drop, options.laminar_transition)
            for drop in (span, HARMLESS_DROP * span)
        ),
    )


def _root_slope(drop: float, transition: float) -> float:
    """Return d/d(drop) of drop / (drop² + transition²)^(1/4) [1/sqrt(Pa)]."""
    total = drop**2 + transition**2
    return float((1.0 - 0.5 * drop**2 / total) / total**0.25)


def _motions(parameters: PlantParameters, options: PlantOptions, *, is_end: bool) -> list[_Motion]:
    """Return the force slopes of a sliding and a standing piston, free and in contact."""
    spring = math.fsum(
        load.spring_stiffness for load in options.loads if isinstance(load, SpringLoad)
    )
    motions = [_Motion(parameters.sigma, spring)]
    if options.bristles is not None:
        slope = parameters.sigma + options.bristles.sigma_1
        motions.append(_Motion(slope, spring + options.bristles.sigma_0))
    elif options.tanh_gain != math.inf:
        motions.append(_Motion(parameters.sigma + options.tanh_gain * parameters.F_s, spring))
    stop = options.end_stop
    if stop is None or not is_end:
        return motions
    pressed = [
        _Motion(slope + stop.damping, stiffness + stop.stiffness) for slope, stiffness in motions
    ]
    return motions + pressed


def _spool_modes(parameters: PlantParameters) -> Modes:
    """Return the modes of the spool's position loop, eq. (3)."""
    xi, omega_0 = parameters.xi, parameters.omega_0
    root = np.sqrt(complex(xi**2 - 1.0))
    slow = -1.0 / (xi + root)  # -xi + root without its cancellation
    return omega_0 * np.array([slow, -xi - root], dtype=np.complex128)


def _largest_velocity(parameters: PlantParameters, options: PlantOptions) -> float:
    """Return the velocity at which the wide open valve fills the smaller chamber [m/s]."""
    span = parameters.P_S - parameters.P_T
    opening = _widest_opening(parameters, options)
    area = min(parameters.A_A, parameters.A_B)
    return parameters.K * opening * math.sqrt(span) / area
