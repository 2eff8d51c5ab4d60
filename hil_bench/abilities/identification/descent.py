"""Least squares between bounds: Levenberg and Marquardt's steps, projected.

SciPy's `least_squares` halts early on these problems: many unknowns are at a bound (no leakage, no
null opening), which `trf` shuns with steps that grow ever shorter, and `dogbox` rarely leaves.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float64]

_FIRST, _LEAST, _MOST = 1e-2, 1e-6, 1e6  # damping, as a share of the curvature
_FACTOR = 8.0
_TRIES = 6  # of steps from one place


def descend(
    residuals: Callable[[Values], Values],
    slopes: Callable[[Values], Values],
    begin: Values,
    bounds: tuple[Values, Values],
    rounds: int,
    exact: float,
) -> Values:
    """Return variables at which the sum of squares of residuals is least, or nearly so.

    Args:
        residuals: at variables, shape (residuals,).
        slopes: of the residuals at variables, shape (residuals, variables).
        begin: variables where the search begins.
        bounds: lowest and highest variables.
        rounds: slopes that are taken at most.
        exact: share of the cost by which the last step has lowered it.
    """
    here = np.clip(begin, *bounds)
    off, damping = residuals(here), _FIRST
    for _ in range(rounds):
        slope, cost = slopes(here), float(off @ off)
        hessian, gradient = slope.T @ slope, slope.T @ off
        for _ in range(_TRIES):
            there = here + damped_step(here, hessian, gradient, damping, bounds)
            off_there = residuals(there)
            lowered = cost - float(off_there @ off_there)
            if lowered > 0.0:
                break
            damping = min(max(damping * _FACTOR, 1e-4), _MOST)
        else:
            break
        here, off = there, off_there
        damping = max(damping / _FACTOR, _LEAST)
        if lowered < exact * cost:
            break
    return here


def damped_step(
    here: Values, hessian: Values, gradient: Values, damping: float, bounds: tuple[Values, Values]
) -> Values:
    """Return one damped step; variables that would leave their bounds end there."""
    low, high = bounds
    damped = hessian + np.diag(damping * np.diag(hessian) + 1e-12)
    step = np.zeros(len(here))
    is_free = ~((here <= low) & (gradient > 0.0)) & ~((here >= high) & (gradient < 0.0))
    while is_free.any():
        pull = gradient + damped @ np.where(is_free, 0.0, step)
        own = np.ix_(is_free, is_free)
        step[is_free] = np.linalg.lstsq(damped[own], -pull[is_free], rcond=1e-14)[0]
        is_out = is_free & ((here + step < low) | (here + step > high))
        if not is_out.any():
            break
        step[is_out] = (np.clip(here + step, low, high) - here)[is_out]
        is_free &= ~is_out
    return np.asarray(np.clip(here + step, low, high) - here)
