"""Slopes of all residuals by the starts of the pieces and by the variables.

The solver's motion has tiny jumps where a step crosses a branch, above all where the piston comes
to rest. A difference across a jump is no slope, and grows without limit as the step shrinks. So the
runs of which slopes are taken cut their steps alike (`model.cuts`), which leaves few jumps; and the
pieces with the steepest slopes are looked at from both sides, and the lesser slope counts.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.shooting import SMALL, Shooting
from hil_bench.abilities.identification.unknowns import Unknowns
from hil_bench.plants.hydraulic_cylinder.model.batch import LANES

Values = npt.NDArray[np.float64]

_PRECISION = 1e-3  # of the variables' steps for slopes, at most
_STATES = 4


class Tangent(NamedTuple):
    """Residuals and their slopes, piece by piece.

    Attributes:
        raw: the residuals, shape (pieces, values).
        own: slopes by the piece's start in its spreads, shape (pieces, values, 4).
        slopes: by the variables, shape (pieces, values, variables).
    """

    raw: Values
    own: Values
    slopes: Values


@dataclass(slots=True)
class Tangents:
    """Takes slopes over steps that are small beside the noise in every piece.

    Attributes:
        unknowns: what is sought.
        shooting: the pieces beside the model.
    """

    unknowns: Unknowns
    shooting: Shooting
    _steps: Values = field(init=False)

    def __post_init__(self) -> None:
        self._steps = self.unknowns.steps * _PRECISION

    def at(self, variables: Values) -> Tangent:
        """Return the tangent at the variables and at the starts; the next one has better steps."""
        shooting = self.shooting
        is_high = variables + self._steps > self.unknowns.bounds[1]
        steps = np.where(is_high, -self._steps, self._steps)
        guess = self.unknowns.guess(variables)
        raw = shooting.anchor(guess)
        slopes = self._slopes(shooting, variables, steps, raw)
        steep = _steepest(slopes, LANES)
        behind = shooting.part(steep)
        behind.steps = -shooting.steps[steep]
        others = self._slopes(behind, variables, -steps, behind.anchor(guess))
        is_less = np.linalg.norm(others, axis=1) < np.linalg.norm(slopes[steep], axis=1)
        slopes[steep] = np.where(is_less[:, np.newaxis], others, slopes[steep])
        sizes = np.linalg.norm(slopes, axis=1)
        shooting.shorten(sizes[:, :_STATES])
        largest = np.maximum(sizes[:, _STATES:].max(axis=0), 1e-9)
        self._steps = np.minimum(self.unknowns.steps * _PRECISION, SMALL / largest)
        own = slopes[..., :_STATES] * shooting.spreads[:, np.newaxis]
        return Tangent(raw, own, slopes[..., _STATES:])

    def _slopes(self, shooting: Shooting, variables: Values, steps: Values, raw: Values) -> Values:
        """Return slopes by states and by variables, shape (pieces, values, 4 + variables)."""
        here, states = self.unknowns.guess(variables), shooting.states
        near = [self.unknowns.guess(variables + step) for step in np.diag(steps)]
        moved = [states + shooting.steps * one for one in np.eye(_STATES)]
        seen = shooting.beside([here] * _STATES + near, moved + [states] * len(near))
        whole = np.hstack([shooting.steps, np.tile(steps, (len(states), 1))])
        return np.asarray((seen - raw).transpose(1, 2, 0) / whole[:, np.newaxis])


def _steepest(slopes: Values, count: int) -> npt.NDArray[np.int64]:
    """Return the pieces that hold the largest shares of any slope."""
    squares = np.square(slopes).sum(axis=1)
    shares = (squares / np.maximum(squares.sum(axis=0), 1e-300)).max(axis=1)
    return np.sort(np.argsort(shares)[-count:])
