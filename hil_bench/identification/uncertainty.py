"""How far a fit would move if the record were another one: the jackknife over its pieces."""

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float64]

_WILD = 1e3  # times what all other groups tell of a variable


def find_covariance(slopes: Values, residuals: Values, groups: int, freedom: int) -> Values:
    """Return the covariance of the variables that a fit under the loss soft_l1 has found.

    The larger of two, variable by variable. One takes the residuals as independent. The other
    leaves out one group at a time and takes how far the fit would move, to first order: it holds
    whatever the residuals of one group have in common, and however they differ in size from group
    to group (the jackknife over clusters, CV3 of MacKinnon, Nielsen and Webb 2023, J. Appl.
    Econometrics 38, 671-694). Correlations are those of the first.

    Args:
        slopes: of the residuals, shape (residuals, variables).
        residuals: group by group, all of the same size; then those of expected values, one for each
            variable, that belong to no group.
        groups: how many.
        freedom: residuals less all that was fitted, the groups' own unknowns among it.
    """
    variance = np.square(residuals).sum() / freedom
    independent = variance * np.linalg.pinv(slopes.T @ slopes, hermitian=True)
    ratios = np.diag(leave_out(slopes, residuals, groups)) / np.diag(independent)
    growth = np.sqrt(np.maximum(1.0, ratios))
    return np.asarray(independent * np.outer(growth, growth))


def leave_out(slopes: Values, residuals: Values, groups: int) -> Values:
    """Return the covariance by leaving out each group once; arguments as `find_covariance`."""
    variables = slopes.shape[1]
    weights = 1.0 / np.sqrt(1.0 + residuals**2)
    bent = slopes * weights[:, np.newaxis] ** 3  # the second derivative of the loss
    information = slopes.T @ bent
    size = (len(residuals) - variables) // groups
    grouped = slopes[: groups * size].reshape(groups, size, variables)
    own = grouped.transpose(0, 2, 1) @ bent[: groups * size].reshape(grouped.shape)
    errors = (residuals * weights)[: groups * size].reshape(groups, size)
    pulls = np.einsum("gvk,gv->gk", grouped, errors)
    moves = np.linalg.solve(information - own, pulls[..., np.newaxis])[..., 0]
    return np.asarray((groups - 1) / groups * moves.T @ moves)


def leave_out_wild(slopes: Values, groups: int) -> Values:
    """Return slopes with zeros for groups that claim to tell far more than all others together.

    Where the motion turns on a hair, as that of a piston which is about to slip, differences are no
    slopes: one piece would hold the fit where it is, and be trusted above all others.

    Args:
        slopes: as for `find_covariance`.
        groups: how many.
    """
    variables = slopes.shape[1]
    size = (len(slopes) - variables) // groups
    tamed = slopes.copy()
    grouped = tamed[: groups * size].reshape(groups, size, variables)
    while True:
        told = np.square(grouped).sum(axis=1)
        others = told.sum(axis=0) - told
        claims = np.divide(told, others, out=np.zeros_like(told), where=others > 0.0).max(axis=1)
        worst = int(np.argmax(claims))
        if claims[worst] <= _WILD:
            return tamed
        grouped[worst] = 0.0
