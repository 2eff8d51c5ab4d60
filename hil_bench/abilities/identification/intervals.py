"""95 % intervals: by the deviations, and by profiles of the cost where it bends."""

from collections.abc import Callable, Mapping

import numpy as np

from hil_bench.abilities.identification.fit import Fit, Values
from hil_bench.abilities.identification.polish import Polish
from hil_bench.abilities.identification.unknowns import Unknowns, kind_of

REACH = 1.96
"""Deviations to each side that hold 95 % of a normal distribution."""

_ENTANGLED = 0.9  # correlation with another variable
_BENT = 5e-3  # standard deviation of a logarithm: below, the cost does not bend within it
_STEPS = 6  # of the fit of all other variables
_FAIR = (0.5, 2.0)  # of the reach: beyond, a profile is too crooked for one more point of it

Interval = tuple[float, float]


def find_intervals(
    unknowns: Unknowns, fit: Fit, deviations: Mapping[str, float], report: Callable[[], None]
) -> dict[str, Interval]:
    """Return the interval of each parameter [SI].

    Args:
        unknowns: of the fit.
        fit: where it has ended.
        deviations: standard deviation of each parameter [SI].
        report: is called after each step.
    """
    guess = unknowns.guess(fit.variables)
    intervals = {}
    for number, name in enumerate(unknowns.names):
        value = guess.value(name)
        reach = REACH * deviations[name]
        low, high = value - reach, value + reach
        if _is_bent(fit.covariance, number, name):
            low, high = (
                _value(unknowns, fit, number, find_end(fit, number, side, report))
                for side in (-1.0, 1.0)
            )
        lowest = 0.0 if kind_of(name).lowest == 0.0 else -np.inf
        intervals[name] = (max(low, lowest), high)
    return intervals


def _is_bent(covariance: Values, number: int, name: str) -> bool:
    """Return True if a variable is a logarithm, uncertain, and entangled with others."""
    deviations = np.sqrt(np.diag(covariance))
    correlations = np.abs(covariance[number] / deviations / deviations[number])
    correlations[number] = 0.0
    return bool(
        kind_of(name).is_log
        and deviations[number] > _BENT
        and correlations.max(initial=0.0) > _ENTANGLED
    )


def find_end(fit: Fit, number: int, side: float, report: Callable[[], None]) -> float:
    """Return the end of a variable's interval, where its profile has risen as far as it may.

    All other variables are fitted anew with this one held. The root of the rise is its distance in
    deviations, were the cost a parabola; one fit and the slope at the optimum tell how it bends.
    """
    deviation = float(np.sqrt(fit.covariance[number, number]))
    shift = side * REACH * deviation
    rise = _rise(fit, number, shift, report)
    # By noise of the expected size; the covariance knows how large it is.
    own = float(fit.spread[number, number])
    found = float(np.sqrt(max(2.0 * rise * own, 0.0))) / deviation
    if not _FAIR[0] * REACH < found < _FAIR[1] * REACH:
        return float(fit.variables[number] + shift)
    # The distance over the root is root + bend root²: REACH where the root is `found`.
    bend = (REACH - found) / found**2
    wanted = REACH + bend * REACH**2
    return float(fit.variables[number] + side * wanted * deviation)


def _rise(fit: Fit, number: int, shift: float, report: Callable[[], None]) -> float:
    """Return by how much the cost rises if a variable is held off its optimum."""
    slope = fit.covariance[:, number] / fit.covariance[number, number]
    lowest, highest = fit.polish.unknowns.bounds
    variables = np.clip(fit.variables + shift * slope, lowest, highest)
    variables[number] = fit.variables[number] + shift
    polish = Polish(fit.polish.unknowns, fit.polish.shooting.copy(), held=number)
    return polish.run(variables, report, _STEPS).cost - fit.optimum.cost


def _value(unknowns: Unknowns, fit: Fit, number: int, variable: float) -> float:
    """Return the parameter that a variable stands for [SI]."""
    variables = fit.variables.copy()
    variables[number] = variable
    return unknowns.guess(variables).value(unknowns.names[number])
