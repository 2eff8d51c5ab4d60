"""The fit: from rough and quick to fine, so that it finds its way from far off."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from hil_bench.errors import ConfigError
from hil_bench.identification.record import AxisRecord
from hil_bench.identification.shooting import Pieces, Shooting, cut_pieces
from hil_bench.identification.stages import FINE, LONGER, ROUGH, Stage
from hil_bench.identification.uncertainty import find_covariance, leave_out_wild
from hil_bench.identification.unknowns import Unknowns
from hil_bench.plant import PlantOptions

Values = npt.NDArray[np.float64]
Report = Callable[[str], None]
"""Takes a few words on what has just been done."""

_FEWEST_PIECES = 8
_ITERATIONS = 6  # of the solver between two times that the pieces' starts are settled anew
_REFINED = 3  # of the candidates
_STRANGE = 1.3  # times the median residual: a piece that the model does not explain
_LEAST_RESIDUAL = 0.5  # of the noise: no record is believed to be better than that
_MOSTLY = 0.8  # of the pieces must be explained, or the model itself is wrong


@dataclass(frozen=True, slots=True)
class Fit:
    """Where a fit has ended.

    Attributes:
        variables: the free variables.
        covariance: of them, as `find_covariance` says.
        cost: as `scipy.optimize.least_squares` counts it.
        residual: rms of the residuals, as a multiple of the noise.
    """

    variables: Values
    covariance: Values
    cost: float
    residual: float


@dataclass(frozen=True, slots=True)
class Fitter:
    """Fits unknowns to the part of a record that is for the fit.

    Attributes:
        record: the measurement.
        options: of the plant.
        step: of the plant's solver [s].
        report: takes what has been done.
    """

    record: AxisRecord
    options: PlantOptions
    step: float
    report: Report = field(default=lambda _: None)
    _settled: dict[int, Values] = field(default_factory=dict)  # starts of the finest pieces

    def pieces(self, stage: Stage, stroke_end: float) -> Pieces:
        """Return the pieces of a stage.

        Raises:
            ConfigError: there are too few clear of the end stops.
        """
        pieces = cut_pieces(
            self.record, self.record.fitted, self.record.rows_in(stage.length), stroke_end
        )
        if len(pieces.rows) < _FEWEST_PIECES:
            raise ConfigError(
                f"the recording has {len(pieces.rows)} pieces of {stage.length:g} s clear of the "
                f"end stops to fit to; {_FEWEST_PIECES} or more are right"
            )
        return pieces.share(stage.share)

    def shooting(self, stage: Stage, pieces: Pieces) -> Shooting:
        """Return pieces beside the model, as finely as a stage wants."""
        shooting = Shooting(
            self.record,
            self.options,
            pieces,
            max(1, round(self.record.interval / self.step / stage.coarse)),
            self.record.noise * stage.blur,
        )
        if stage.name == FINE.name:
            shooting.resume(self._settled)
        return shooting

    def search(self, unknowns: Unknowns, starts: int, seed: int) -> list[Values]:
        """Return the best two of some random candidates, refined at the shortest pieces.

        One was refined for a short while, the other for a longer one.

        Args:
            unknowns: what is sought.
            starts: how many candidates; what is configured is the first.
            seed: of the random generator.
        """
        pieces = self.pieces(ROUGH, unknowns.known.h)
        shooting = self.shooting(ROUGH, pieces)
        candidates = list(draw_candidates(unknowns, starts, np.random.default_rng(seed)))
        costs = []
        for candidate in candidates:
            guess = unknowns.guess(candidate)
            shooting.restart()
            shooting.settle(guess, ROUGH.enough, ROUGH.settlings)
            costs.append(float(_soft(shooting.residuals([guess], [shooting.states])).sum()))
            self.report("search")
        best = [candidates[number] for number in np.argsort(costs)[:_REFINED]]
        ways = []
        for stage in (ROUGH, LONGER):
            fits = [self.fit(unknowns, candidate, stage, pieces) for candidate in best]
            ways.append(min(fits, key=lambda fit: fit.cost).variables)
        return ways

    def explained(self, unknowns: Unknowns, variables: Values, pieces: Pieces) -> Pieces:
        """Return the pieces less those few in which something happens that the model lacks."""
        guess, shooting = unknowns.guess(variables), self.shooting(FINE, pieces)
        shooting.settle(guess)
        self._settled.update(shooting.starts)
        misfits = shooting.misfits(guess)
        is_fair = misfits <= _STRANGE * np.median(misfits)
        return pieces.chosen(is_fair) if is_fair.mean() >= _MOSTLY else pieces

    def fit(self, unknowns: Unknowns, variables: Values, stage: Stage, pieces: Pieces) -> Fit:
        """Return the fit that starts at `variables`."""
        from scipy.optimize import least_squares  # noqa: PLC0415 - an extra

        problem = _Problem(unknowns, self.shooting(stage, pieces), stage)
        cost = np.inf
        for _ in range(stage.rounds):
            problem.begin(variables)
            solution = least_squares(
                problem.residuals,
                variables,
                jac=problem.slopes,
                bounds=unknowns.bounds,
                loss="soft_l1",
                x_scale="jac",
                max_nfev=_ITERATIONS,
                ftol=stage.enough / 10.0,
            )
            self.report(stage.name)
            variables = solution.x
            problem.end(variables)
            is_done, cost = solution.cost > (1.0 - stage.enough) * cost, solution.cost
            if is_done:
                break
        problem.begin(variables)
        if stage.name == FINE.name:
            self._settled.update(problem.shooting.starts)
        return problem.result(variables, cost)


@dataclass(slots=True)
class _Problem:
    """The residuals of one stage, as `scipy.optimize.least_squares` takes them.

    The starts of the pieces follow the variables to first order, from where they were settled.
    """

    unknowns: Unknowns
    shooting: Shooting
    stage: Stage
    _center: Values = field(init=False)
    _follow: Values = field(init=False)

    def begin(self, variables: Values) -> None:
        """Settle the starts at these variables, and find how they follow."""
        self._center, guess = variables, self.unknowns.guess(variables)
        self.shooting.settle(guess, self.stage.enough, self.stage.settlings)
        self._follow = np.zeros((len(variables), *self.shooting.states.shape))
        if not self.stage.follows:
            return
        steps = self._steps(variables)
        near = [self.unknowns.guess(variables + step) for step in np.diag(steps)]
        self._follow = self.shooting.follow(guess, near) / steps[:, np.newaxis, np.newaxis]

    def end(self, variables: Values) -> None:
        """Leave the starts where they follow to."""
        self.shooting.states = self._states(variables)

    def residuals(self, variables: Values) -> Values:
        return np.asarray(self._of([variables])[0])

    def slopes(self, variables: Values) -> Values:
        steps = self._steps(variables)
        found = self._of([variables, *(variables + step for step in np.diag(steps))])
        slopes = np.asarray(((found[1:] - found[0]) / steps[:, np.newaxis]).T)
        return leave_out_wild(slopes, len(self.shooting.states)) if self.stage.follows else slopes

    def result(self, variables: Values, cost: float) -> Fit:
        """Return the fit, and how uncertain it is."""
        residuals, slopes = self.residuals(variables), self.slopes(variables)
        freedom = len(residuals) - 8 * len(self.shooting.states) - 2 * len(variables)
        rms = float(np.sqrt(np.square(residuals).sum() / freedom))
        covariance = find_covariance(slopes, residuals, len(self.shooting.states), freedom)
        doubt = max(1.0, _LEAST_RESIDUAL / max(rms, 1e-12)) ** 2
        return Fit(variables, doubt * covariance, float(cost), rms)

    def _of(self, trials: Sequence[Values]) -> Values:
        guesses = [self.unknowns.guess(trial) for trial in trials]
        signals = self.shooting.residuals(guesses, [self._states(trial) for trial in trials])
        expected = (np.array(trials) - self.unknowns.start) / self.unknowns.spreads
        return np.hstack([signals, expected])

    def _states(self, variables: Values) -> Values:
        shift = np.tensordot(variables - self._center, self._follow, axes=1)
        return np.asarray(self.shooting.states + shift)

    def _steps(self, variables: Values) -> Values:
        steps = self.unknowns.steps * self.stage.precision
        return np.where(variables + steps > self.unknowns.bounds[1], -steps, steps)


def draw_candidates(
    unknowns: Unknowns, count: int, source: np.random.Generator
) -> Iterator[Values]:
    """Yield starts: what is configured, then random ones about it.

    The bulk modulus is the one parameter that may be off by a factor of ten and more, for want of
    a data sheet of the air in the oil; the others are drawn within some 30 %.
    """
    start = unknowns.start
    yield start
    lowest, highest = unknowns.bounds
    for _ in range(count - 1):
        reach = np.minimum(unknowns.spreads, 3.0) * np.where(unknowns.spreads > 1.0, 1.0, 0.3)
        yield np.clip(start + reach * source.uniform(-1.0, 1.0, len(start)), lowest, highest)


def _soft(residuals: Values) -> Values:
    """Return the cost of residuals under the loss soft_l1."""
    return np.asarray(np.sqrt(1.0 + residuals**2) - 1.0)
