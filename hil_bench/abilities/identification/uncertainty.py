"""Uncertainty of a fit: by its residuals where they are white, else by leaving out pieces."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.loss import bend_of, pull_of

Values = npt.NDArray[np.float64]
Marks = npt.NDArray[np.bool_]

_WILD = 1e2  # times what all other groups say of a variable
_LAGS = 10  # rows
_LEAST = 1e-13  # of the largest: an eigenvalue below is not known to be above 0


class Evidence(NamedTuple):
    """The residuals and slopes of a fit, group by group, all of the same size.

    Attributes:
        residuals: shape (groups, values).
        slopes: of the residuals by the variables, less what the groups' own unknowns could explain,
            shape (groups, values, variables).
        spreads: expected standard deviations of the variables, shape (variables,).
        freedom: residuals less all that was fitted, the groups' own unknowns among it.
        is_there: which residuals there are, of their shape; the others are 0. None for all.
    """

    residuals: Values
    slopes: Values
    spreads: Values
    freedom: int
    is_there: Marks | None = None


def find_covariance(evidence: Evidence, *, is_white: bool) -> Values:
    """Return the covariance of the variables that a fit has found.

    White residuals count as independent. If they are not white, the covariance is the larger of
    two, variable by variable: that one, and the one that leaves out one group at a time and takes
    how far the fit would move, to first order. The latter holds whatever the residuals of a group
    have in common, and however they differ in size from group to group (the jackknife over
    clusters, CV3 of MacKinnon, Nielsen and Webb 2023, J. Appl. Econometrics 38, 671-694).
    Correlations are those of the first.

    Args:
        evidence: what the fit leaves.
        is_white: whether the residuals are.
    """
    residuals = evidence.residuals
    pulls = residuals * pull_of(residuals)
    is_there = np.True_ if evidence.is_there is None else evidence.is_there
    bend = bend_of(residuals).mean(where=is_there)
    variance = np.square(pulls).sum() / evidence.freedom / bend
    independent = np.asarray(variance * invert(find_information(evidence)))
    if is_white:
        return independent
    ratios = np.diag(leave_out(evidence)) / np.diag(independent)
    growth = np.sqrt(np.maximum(1.0, ratios))
    return np.asarray(independent * np.outer(growth, growth))


def leave_out(evidence: Evidence) -> Values:
    """Return the covariance by leaving out each group once."""
    residuals, slopes = evidence.residuals, evidence.slopes
    bent = slopes * bend_of(residuals)[..., np.newaxis]
    own = slopes.transpose(0, 2, 1) @ bent
    pulls = np.einsum("gvk,gv->gk", slopes, residuals * pull_of(residuals))
    others = find_information(evidence) - own
    moves = np.array([invert(one) @ pull for one, pull in zip(others, pulls, strict=True)])
    return np.asarray((len(moves) - 1) / len(moves) * moves.T @ moves)


def invert(information: Values) -> Values:
    """Return the inverse of a positive semidefinite matrix, whatever its variables count in.

    A direction of which nothing is known gets a huge variance; a pseudo-inverse would call it
    exactly known.
    """
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(np.float64).tiny))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    kept = np.maximum(values, _LEAST * values.max())
    return np.asarray((vectors / kept) @ vectors.T / np.outer(scale, scale))


def find_colour(residuals: Values) -> tuple[float, float]:
    """Return the largest autocorrelation of residuals at 1 to 10 rows, and what white ones have.

    The limit is four standard deviations of what chance gives, and room for the start of each piece
    that was fitted to it.

    Args:
        residuals: shape (pieces, rows, signals).
    """
    pieces, rows, _ = residuals.shape
    power = np.square(residuals).sum(axis=(0, 1))
    lags = range(1, min(_LAGS, rows - 1) + 1)
    products = [(residuals[:, lag:] * residuals[:, :-lag]).sum(axis=(0, 1)) for lag in lags]
    largest = float(np.abs(np.array(products) / np.maximum(power, 1e-300)).max())
    return largest, 4.0 / math.sqrt(pieces * rows) + 4.0 / rows


def leave_out_wild(slopes: Values) -> Marks:
    """Mark the groups that do not claim far more information than all others together.

    Where the motion turns on a hair, as that of a piston which is about to slip, differences are no
    slopes: one piece would hold the fit where it is, and be trusted above all others.

    Args:
        slopes: of each group, shape (groups, residuals, variables).
    """
    said = np.square(slopes).sum(axis=1)
    is_tame = np.ones(len(said), dtype=np.bool_)
    while True:
        others = said.sum(axis=0) - said
        claims = np.divide(said, others, out=np.zeros_like(said), where=others > 0.0).max(axis=1)
        worst = int(np.argmax(claims))
        if claims[worst] <= _WILD:
            return is_tame
        is_tame[worst], said[worst] = False, 0.0


def find_information(evidence: Evidence) -> Values:
    """Return the second derivatives of the cost by the variables."""
    slopes = evidence.slopes.reshape(-1, evidence.slopes.shape[-1])
    bent = slopes * bend_of(evidence.residuals).reshape(-1, 1)
    return np.asarray(slopes.T @ bent + np.diag(evidence.spreads**-2.0))
