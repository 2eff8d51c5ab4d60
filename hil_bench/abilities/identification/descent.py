"""Least squares between bounds: Levenberg and Marquardt's steps, projected.

Slopes cost a run for each variable, so steps go on by slopes that each step updates (C. G. Broyden,
"A class of methods for solving nonlinear simultaneous equations", Mathematics of Computation 19,
1965), as long as that lowers the cost.

SciPy's `least_squares` halts early on these problems: many unknowns are at a bound (no leakage, no
null opening), which `trf` shuns with steps that grow ever shorter, and `dogbox` rarely leaves.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float64]

_FIRST, _LEAST, _MOST = 1e-2, 1e-6, 1e6  # damping, as a share of the curvature
_FACTOR = 8.0
_TRIES, _TRIES_AGAIN = 6, 2  # of steps from one place, by its own slopes and by updated ones
_UPDATES = 8  # of slopes, by Broyden's rule, before they are taken anew


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
        exact: share of the cost by which the steps from the last slopes have lowered it.
    """
    here = np.clip(begin, *bounds)
    off, damping = residuals(here), _FIRST
    for _ in range(rounds):
        slope, begun = slopes(here), float(off @ off)
        for tries in (_TRIES, *[_TRIES_AGAIN] * _UPDATES):
            hessian, gradient, cost = slope.T @ slope, slope.T @ off, float(off @ off)
            for _ in range(tries):
                step = damped_step(here, hessian, gradient, damping, bounds)
                off_there = residuals(here + step)
                if float(off_there @ off_there) < cost:
                    break
                damping = min(max(damping * _FACTOR, 1e-4), _MOST)
            else:
                break
            # In the measure of the curvature, which asks for no scale of the variables.
            weights = np.diag(hessian) * step
            slope = slope + np.outer(off_there - off - slope @ step, weights / (step @ weights))
            here, off = here + step, off_there
            damping = max(damping / _FACTOR, _LEAST)
        if begun - float(off @ off) < exact * begun:
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
