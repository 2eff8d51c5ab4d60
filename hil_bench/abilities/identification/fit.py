"""The fit: from rough and quick to fine, so that it finds its way from far off."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.loss import KNEE
from hil_bench.abilities.identification.pieces import Pieces, cut_pieces
from hil_bench.abilities.identification.polish import MOST_STEPS, Optimum, Polish
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.shooting import Shooting
from hil_bench.abilities.identification.smoothing import smooth_states
from hil_bench.abilities.identification.stages import FINE, LONGER, ROUGH, Stage
from hil_bench.abilities.identification.uncertainty import (
    Evidence,
    find_colour,
    find_covariance,
    find_information,
    invert,
)
from hil_bench.abilities.identification.unknowns import Unknowns
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions, PlantParameters

Values = npt.NDArray[np.float64]
Report = Callable[[str], None]
"""Takes a few words on what has just been done."""

_FEWEST_PIECES = 8
_ITERATIONS = 6  # of the solver between two times that the pieces' starts are settled anew
WAYS = 2
"""Starts that are followed to the end in any case: do they end at the same place?"""

_REFINED = 3  # of the candidates
_STRANGE = 1.3  # times the median residual: a piece that the model does not explain
_SETTLED = 1e-5  # relative gain of a step of the starts: the polish moves them on
_RELAYS = 2  # of a badly fitting piece's start from the piece before
_LEAST_RESIDUAL = 0.5  # of the noise: no record is believed to be better than that
_MOSTLY = 0.8  # of the pieces must be explained, or the model itself is wrong


class Rough(NamedTuple):
    """The end of a stage before the last.

    Attributes:
        variables: the free variables.
        cost: as `scipy.optimize.least_squares` counts it.
    """

    variables: Values
    cost: float


@dataclass(frozen=True, slots=True)
class Fit:
    """The end of a fit.

    Attributes:
        optimum: of the cost.
        covariance: of the variables, as `find_covariance` says.
        spread: the inverse of the cost's second derivatives, for noise of the expected size.
        residual: rms of the residuals of each signal, as a multiple of its noise, shape (3,); not
            a number where no recording has the signal.
        colour: the largest autocorrelation of the residuals.
        is_white: whether it is as small as that of white noise.
        polish: can go on from there.
    """

    optimum: Optimum
    covariance: Values
    spread: Values
    residual: Values
    colour: float
    is_white: bool
    polish: Polish

    @property
    def variables(self) -> Values:
        """The free variables."""
        return self.optimum.variables

    @property
    def whole_residual(self) -> float:
        """Root mean square of all residuals, as a multiple of the noise."""
        return float(np.sqrt(np.nanmean(np.square(self.residual))))


@dataclass(frozen=True, slots=True)
class Fitter:
    """Fits unknowns to the part of a record that is for the fit.

    Attributes:
        record: the measurement.
        options: of the plant.
        step: of the plant's solver [s].
        report: takes what has been done.
        is_behind: whether the sensors are.
    """

    record: AxisRecord
    options: PlantOptions
    step: float
    report: Report = field(default=lambda _: None)
    is_behind: bool = False
    _settled: dict[int, Values] = field(default_factory=dict)  # starts of the finest pieces
    _stuck: set[int] = field(default_factory=set)  # rows of pieces whose starts do not settle

    def with_record(self, record: AxisRecord) -> "Fitter":
        """Return the same for another noise of the record."""
        return replace(self, record=record)

    def forget(self) -> None:
        """Take all of the finest pieces again, from the smoothed measurements."""
        self._settled.clear()
        self._stuck.clear()

    def begin_at(self, fit: "Fit") -> None:
        """Take all of the finest pieces again, from the starts of a fit where it has some."""
        self.forget()
        self._settled.update(fit.polish.shooting.starts)

    def retry(self) -> None:
        """Take stuck pieces again, from where they have stuck."""
        self._stuck.clear()

    def pieces(self, stage: Stage, stroke_end: float) -> Pieces:
        """Return the pieces of a stage.

        Raises:
            ConfigError: there are too few.
        """
        record, length = self.record, self.record.rows_in(stage.length)
        pieces = cut_pieces(record, record.fitted, length, stroke_end)
        clear = len(pieces.rows)
        # What happens at a stop leads nowhere from far off.
        if stage.name == FINE.name or clear < _FEWEST_PIECES:
            pieces = cut_pieces(record, record.fitted, length, stroke_end, has_stops=True)
        if len(pieces.rows) < _FEWEST_PIECES:
            at_stops = len(pieces.rows) - clear
            raise ConfigError(
                f"the recording has {clear} pieces of {stage.length:g} s clear of the "
                f"end stops to fit to and {at_stops} at a stop; {_FEWEST_PIECES} or more are needed"
            )
        return pieces.share(stage.share, stage.most)

    def shooting(self, stage: Stage, pieces: Pieces, known: PlantParameters) -> Shooting:
        """Return pieces beside the model, as finely as a stage wants.

        Args:
            stage: of the fit.
            pieces: of the record.
            known: parameters from which a pressure follows that was not recorded.
        """
        shooting = Shooting(
            self.record,
            self.options,
            pieces,
            max(1, round(self.record.interval / self.step / stage.coarse)),
            self.record.noise * stage.blur,
            smooth_states(self.record, known, is_behind=self.is_behind, load=self.options.load_at),
            KNEE if stage.name == FINE.name else np.inf,
            self.is_behind,
        )
        if stage.name == FINE.name:
            shooting.resume(self._settled)
        return shooting

    def search(self, unknowns: Unknowns, starts: int, seed: int) -> Iterator[Values]:
        """Yield the best of some random candidates, refined at the shortest pieces.

        First those that were refined for a short while, the best two of them; then the best of
        those that were refined for longer.

        Args:
            unknowns: what is sought.
            starts: how many candidates; what is configured is the first.
            seed: of the random generator.
        """
        pieces = self.pieces(ROUGH, unknowns.known.h)
        shooting = self.shooting(ROUGH, pieces, unknowns.known)
        candidates = list(draw_candidates(unknowns, starts, np.random.default_rng(seed)))
        costs = []
        for candidate in candidates:
            guess = unknowns.guess(candidate)
            shooting.restart()
            shooting.settle(guess, ROUGH.enough, ROUGH.settlings)
            costs.append(float(_soft(shooting.residuals([guess], [shooting.states])).sum()))
            self.report("search")
        best = [candidates[number] for number in np.argsort(costs)[:_REFINED]]
        for stage, count in ((ROUGH, WAYS), (LONGER, 1)):
            fits = [self.fit(unknowns, candidate, stage, pieces) for candidate in best]
            fits.sort(key=lambda fit: fit.cost)
            yield from (fit.variables for fit in fits[:count])

    def explained(self, unknowns: Unknowns, variables: Values, every: Pieces) -> Pieces:
        """Return the pieces less those few in which something happens that the model lacks."""
        guess = unknowns.guess(variables)
        shooting = self.shooting(FINE, every, guess.parameters)
        shooting.settle(guess, _SETTLED)
        for _ in range(_RELAYS):
            shooting.relay(guess)
        self._settled.update(shooting.starts)
        misfits = shooting.misfits(guess)
        is_steady = ~shooting.turns_on_a_hair() & ~np.isin(every.rows, [*self._stuck])
        is_fair = is_steady & (misfits <= _STRANGE * np.median(misfits))
        # The contact of the stop may be another than the machine's: such a piece is not missed.
        touches = every.touching(self.record)
        others = ~touches if not touches.all() else touches
        for marks in (is_fair, is_steady & ~(touches & ~is_fair)):
            if marks[others].mean() >= _MOSTLY:
                return every.chosen(marks)
        return every.chosen(others)

    def polish(
        self,
        unknowns: Unknowns,
        variables: Values,
        pieces: Pieces,
        most: int = MOST_STEPS,
        near: float = 0.0,
    ) -> Fit:
        """Return the fit to the finest pieces that starts at `variables`, in so many steps.

        The starts of the pieces are as `explained` has settled them. It ends as soon as the optimum
        is nearer than `near` deviations.
        """
        polish = Polish(unknowns, self.shooting(FINE, pieces, unknowns.known))
        optimum = polish.run(variables, lambda: self.report(FINE.name), most, near)
        self._settled.update(polish.shooting.starts)
        if not optimum.is_reached:
            self._stuck.update(pieces.rows[optimum.is_stuck].tolist())
        return _judge(polish, optimum)

    def fit(self, unknowns: Unknowns, variables: Values, stage: Stage, pieces: Pieces) -> Rough:
        """Return the fit that starts at `variables`."""
        from scipy.optimize import least_squares  # noqa: PLC0415 - an extra

        problem = _Problem(unknowns, self.shooting(stage, pieces, unknowns.known), stage)
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
            is_done = solution.cost > (1.0 - stage.enough) * cost
            is_done |= solution.cost < stage.near * len(solution.fun)
            cost = solution.cost
            if is_done:
                break
        return Rough(variables, float(cost))


@dataclass(slots=True)
class _Problem:
    """The residuals of a stage before the last, as `scipy.optimize.least_squares` takes them."""

    unknowns: Unknowns
    shooting: Shooting
    stage: Stage

    def begin(self, variables: Values) -> None:
        """Settle the starts at these variables."""
        guess = self.unknowns.guess(variables)
        self.shooting.settle(guess, self.stage.enough, self.stage.settlings)

    def residuals(self, variables: Values) -> Values:
        return np.asarray(self._of([variables])[0])

    def slopes(self, variables: Values) -> Values:
        steps = self.unknowns.steps * self.stage.precision
        steps = np.where(variables + steps > self.unknowns.bounds[1], -steps, steps)
        found = self._of([variables, *(variables + step for step in np.diag(steps))])
        return np.asarray(((found[1:] - found[0]) / steps[:, np.newaxis]).T)

    def _of(self, trials: Sequence[Values]) -> Values:
        guesses = [self.unknowns.guess(trial) for trial in trials]
        signals = self.shooting.residuals(guesses, [self.shooting.states] * len(trials))
        expected = (np.array(trials) - self.unknowns.start) / self.unknowns.spreads
        return np.hstack([signals, expected])


def _judge(polish: Polish, optimum: Optimum) -> Fit:
    """Return a fit with how far it can be trusted."""
    count = len(optimum.residuals)
    signals = optimum.residuals[:, :-4].reshape(count, -1, 3)
    values = polish.shooting.is_there.sum(axis=(0, 1))
    freedom = int(values.sum()) - 4 * count - len(optimum.variables)
    is_there = np.ones(optimum.residuals.shape, dtype=np.bool_)
    is_there[:, :-4] = polish.shooting.is_there.reshape(count, -1)
    evidence = Evidence(
        optimum.residuals, optimum.slopes, polish.unknowns.spreads, freedom, is_there
    )
    # The starts and the variables take their share of each signal's residuals.
    shares = np.where(values > 0, values * freedom / values.sum(), np.nan)
    power = np.square(signals).sum(axis=(0, 1)) / shares
    colour, limit = find_colour(signals)
    doubt = max(1.0, _LEAST_RESIDUAL**2 / max(float(np.nanmean(power)), 1e-24))
    covariance = doubt * find_covariance(evidence, is_white=colour <= limit)
    spread = invert(find_information(evidence))
    return Fit(optimum, covariance, spread, np.sqrt(power), colour, colour <= limit, polish)


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
