"""The cost about a point to second order, with the starts of the pieces eliminated."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.loss import bend_of, pull_of
from hil_bench.abilities.identification.shooting import ROUNDING
from hil_bench.abilities.identification.tangent import Tangent

Values = npt.NDArray[np.float64]
Marks = npt.NDArray[np.bool_]

_NEAR = 0.03  # deviations


class Quadratic(NamedTuple):
    """The normal equations of the variables and of the starts.

    Attributes:
        pull: gradient by the variables, shape (variables,).
        information: second derivatives, shape (variables, variables).
        own_pull: gradient by each start, shape (pieces, 4).
        own: second derivatives, shape (pieces, 4, 4).
        mixed: by start and variables, shape (pieces, 4, variables).
    """

    pull: Values
    information: Values
    own_pull: Values
    own: Values
    mixed: Values

    @classmethod
    def of(cls, tangent: Tangent, expected: Values, spreads: Values) -> "Quadratic":
        """Return the normal equations of a tangent.

        Args:
            tangent: at the point.
            expected: residuals of the variables from their expected values, shape (variables,).
            spreads: expected standard deviations of the variables, shape (variables,).
        """
        raw, own, slopes = tangent
        # The second derivative of the loss fades far off, and steps by it go astray; the weight of
        # the gradient bounds it from above, so that they do not.
        weights = pull_of(raw)
        bent, pulls = own * weights[..., np.newaxis], raw * weights
        flat = slopes.reshape(-1, slopes.shape[-1])
        return cls(
            flat.T @ pulls.reshape(-1) + expected / spreads,
            flat.T @ (flat * weights.reshape(-1, 1)) + np.diag(spreads**-2.0),
            np.einsum("pvk,pv->pk", own, pulls),
            own.transpose(0, 2, 1) @ bent,
            bent.transpose(0, 2, 1) @ slopes,
        )

    def reduce(self, damping: Values) -> tuple[Values, Values]:
        """Return gradient and information of the variables with the starts at their best.

        Args:
            damping: of each piece's start, shape (pieces,).
        """
        alone, across = self._solve(damping)
        return (
            self.pull - np.einsum("pkv,pk->v", self.mixed, alone),
            self.information - np.einsum("pkv,pkw->vw", self.mixed, across),
        )

    def follow(self, step: Values, damping: Values) -> Values:
        """Return the starts' best step for a step of the variables, shape (pieces, 4)."""
        alone, across = self._solve(damping)
        return np.asarray(-alone - across @ step)

    def swing(self, step: Values) -> Values:
        """Return the shift of the starts' best places with the variables, shape (pieces, 4)."""
        _, across = self._solve(np.zeros(len(self.own)))
        return np.asarray(-across @ step)

    def vaguest(self) -> tuple[Values, Values]:
        """Return the direction of each start of which least is known, and how far to look there.

        Returns:
            Unit vectors, shape (pieces, 4), and how far the start's best step goes along them, or
            a small part of a deviation, whichever is further, shape (pieces,).
        """
        values, vectors = np.linalg.eigh(self.own)
        direction = vectors[:, :, 0]
        alone, _ = self._solve(np.zeros(len(self.own)))
        size = np.abs(np.einsum("pk,pk->p", alone, direction))
        return direction, np.maximum(size, _NEAR / np.sqrt(np.maximum(values[:, 0], 1e-300)))

    def bent(self, direction: Values, bend: Values) -> "Quadratic":
        """Return the same with second derivatives of at least `bend` along each direction."""
        seen = np.einsum("pk,pkl,pl->p", direction, self.own, direction)
        more = np.maximum(bend - seen, 0.0)
        return self._replace(own=self.own + np.einsum("p,pk,pl->pkl", more, direction, direction))

    def own_gains(self) -> Values:
        """Return by how much the cost of each piece would fall by its start alone."""
        alone, _ = self._solve(np.zeros(len(self.own)))
        return np.asarray(0.5 * np.einsum("pk,pk->p", self.own_pull, alone))

    def _solve(self, damping: Values) -> tuple[Values, Values]:
        scale = np.einsum("pkk->pk", self.own)[:, :, np.newaxis] * np.eye(4)
        damping = np.maximum(damping, ROUNDING)
        damped = self.own + damping[:, np.newaxis, np.newaxis] * scale
        return (
            np.linalg.solve(damped, self.own_pull[..., np.newaxis])[..., 0],
            np.linalg.solve(damped, self.mixed),
        )


def project(tangent: Tangent) -> Values:
    """Return the slopes by the variables less what the pieces' own starts could explain."""
    raw, own, slopes = tangent
    bent = (own * bend_of(raw)[..., np.newaxis]).transpose(0, 2, 1)
    return np.asarray(slopes - own @ np.linalg.solve(bent @ own, bent @ slopes))


def find_deviations(information: Values) -> Values:
    """Return uncorrelated steps of the variables of one standard deviation each, row by row."""
    scale = 1.0 / np.sqrt(np.diag(information))
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    sizes = 1.0 / np.sqrt(np.maximum(values, ROUNDING))
    return np.asarray(sizes[:, np.newaxis] * vectors.T * scale)


def step_down(pull: Values, information: Values, free: Marks, damping: float) -> Values:
    """Return the step to the minimum of a quadratic in the free variables, by Marquardt."""
    step = np.zeros(len(pull))
    scale = 1.0 / np.sqrt(np.diag(information)[free])
    scaled = information[np.ix_(free, free)] * np.outer(scale, scale)
    damped = scaled + damping * np.eye(len(scale))
    step[free] = -scale * np.linalg.solve(damped, scale * pull[free])
    return step
