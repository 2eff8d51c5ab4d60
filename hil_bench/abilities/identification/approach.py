"""From far off to the first fine fit, from several starts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hil_bench.abilities.identification.fit import WAYS, Fit, Fitter, Values
from hil_bench.abilities.identification.pieces import Pieces
from hil_bench.abilities.identification.stages import AGAIN, MIDDLE, Stage
from hil_bench.abilities.identification.unknowns import Unknowns

SIDE_MINIMUM = 1.3
"""Multiple of the noise above which residuals may mean a side minimum."""

_HOPELESS = 4.0  # times the noise, after the first steps
_STEPS, _MORE = 6, 3  # of a first fine fit, and how often it may go on
_APART = 3.0  # deviations
_NEAR = 1.0  # deviations: close enough to compare, and for the last fit to begin


@dataclass(frozen=True, slots=True)
class Rival:
    """The end of a fit from another start, apart from the fit that was taken.

    Attributes:
        residual: rms of its residuals, as a multiple of the noise.
        apart: how far each parameter is from the fit, in the fit's deviations; only those that are
            further than three.
    """

    residual: float
    apart: dict[str, float]


def approach(
    fitter: Fitter, unknowns: Unknowns, every: Pieces, starts: int, seed: int
) -> list[Fit]:
    """Return the first fine fits, the best first.

    Two starts are followed in any case, others as long as the best looks like a side minimum.

    Args:
        fitter: of the record.
        unknowns: what is sought.
        every: the finest pieces.
        starts: how many random candidates the search tries.
        seed: of the random generator.
    """
    fits: list[Fit] = []
    for variables in fitter.search(unknowns, starts, seed):
        fits.append(_follow(fitter, unknowns, variables, (MIDDLE,), every))
        fits.sort(key=lambda fit: fit.whole_residual)
        if len(fits) >= WAYS and fits[0].whole_residual <= SIDE_MINIMUM:
            return fits
    fits.append(_follow(fitter, unknowns, fits[0].variables, AGAIN, every))
    return sorted(fits, key=lambda fit: fit.whole_residual)


def find_rivals(unknowns: Unknowns, fit: Fit, others: Sequence[Fit]) -> list[Rival]:
    """Return the starts that ended elsewhere.

    Args:
        unknowns: of all fits.
        fit: that was taken.
        others: where other starts have ended.
    """
    deviations = np.sqrt(np.diag(fit.covariance))
    rivals = []
    for other in others:
        distances = np.abs(other.variables - fit.variables) / deviations
        apart = {
            name: float(distance)
            for name, distance in zip(unknowns.names, distances, strict=False)
            if distance > _APART
        }
        if apart:
            rivals.append(Rival(other.whole_residual, apart))
    return rivals


def _follow(
    fitter: Fitter,
    unknowns: Unknowns,
    variables: Values,
    stages: Sequence[Stage],
    every: Pieces,
) -> Fit:
    """Return the first fine fit, to which some stages lead."""
    for stage in stages:
        pieces = fitter.pieces(stage, unknowns.known.h)
        variables = fitter.fit(unknowns, variables, stage, pieces).variables
    fitter.forget()
    fit = _advance(fitter, unknowns, variables, every)
    for _ in range(_MORE):
        if fit.optimum.decrement < _NEAR or fit.whole_residual > _HOPELESS:
            break
        fit = _advance(fitter, unknowns, fit.variables, every)
    return fit


def _advance(fitter: Fitter, unknowns: Unknowns, variables: Values, every: Pieces) -> Fit:
    """Return the fine fit some steps further, after lost starts have been found again."""
    fitter.retry()
    pieces = fitter.explained(unknowns, variables, every)
    return fitter.polish(unknowns, variables, pieces, _STEPS, _NEAR)
