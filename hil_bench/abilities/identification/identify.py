"""Identification: from a record to the machine that predicts it, with the errors of prediction."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from time import monotonic
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.fit import Bench, Clock, Fit, Problem, search
from hil_bench.abilities.identification.ladder import Ladder, Wish, choose_folds, climb, judge
from hil_bench.abilities.identification.machine import Template, Unknown
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.strokes import make_course
from hil_bench.config.settings import Settings
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig
from hil_bench.plants.hydraulic_cylinder.model.courses import states_without_start

Values = npt.NDArray[np.float64]

_COARSE, _COARSE_STEP, _BLUR = 4e-3, 1e-3, 0.03  # [s]: rows, step and mean of the ladder
_FINE, _FINE_STEP = 1e-3, 1e-4  # [s]: of the last fit
_ROUNDS, _EXACT = 15, 1e-7  # of a fine search at most; change of the cost that ends it
_AGAIN, _STAYS = 4, 0.02  # fine searches after the first; change of the scales that ends them
_TOLD = 0.5  # of what was expected: a parameter known less well is not told by the record
_TOLD_AT_MOST = 0.5  # of a free variable, such as 50 % of a positive parameter


class Estimate(NamedTuple):
    """A value that was found.

    Attributes:
        name: key of `bench.toml`, or one of `machine.UNITS`.
        value: in its unit.
        deviation: standard deviation, widened by the misfit.
        interval: of 95 %.
        start: where the search began.
        is_told: whether the record says it.
    """

    name: str
    value: float
    deviation: float
    interval: tuple[float, float]
    start: float
    is_told: bool


class Options(NamedTuple):
    """The ways of an identification.

    Attributes:
        wish: what is free and what is held.
        jobs: runs at a time.
        seconds: after which the search ends with the best so far; infinite for no limit.
        tick: is called often.
        say: takes what is being done.
    """

    wish: Wish = Wish()
    jobs: int = 1
    seconds: float = math.inf
    tick: Callable[[], None] = lambda: None
    say: Callable[[str], None] = lambda _: None


@dataclass(frozen=True, slots=True, kw_only=True)
class Identification:
    """The machine that was found.

    Attributes:
        bench: plant and record of the last fit.
        ladder: the models that were tried.
        fit: the last one, of the model that was chosen.
        estimates: one an unknown, offsets of the sensors among them.
        is_refined: whether the search came to its end.
    """

    bench: Bench
    ladder: Ladder
    fit: Fit
    estimates: tuple[Estimate, ...]
    is_refined: bool

    @property
    def record(self) -> AxisRecord:
        """The record, with a row each that was fitted."""
        return self.bench.course.record

    @property
    def largest_opening(self) -> float:
        """The largest opening of its strokes, as a share of full opening."""
        return max(one.opening for one in self.bench.course.strokes)

    @property
    def keys(self) -> dict[str, float | str]:
        """The keys of `bench.toml` that were found, in their units."""
        return self.bench.template.keys(self.fit.values)


def identify(
    record: AxisRecord,
    axis: CylinderConfig,
    settings: Settings,
    *,
    step: float,
    options: Options | None = None,
) -> Identification:
    """Find the machine that predicts a record best.

    Args:
        record: of the machine, one or more recordings.
        axis: the machine as it is configured, where the search starts.
        settings: of the axis.
        step: of the bench's solver [s].
        options: how; None for the usual ones.
    """
    chosen = Options() if options is None else options
    clock = Clock(monotonic() + chosen.seconds, chosen.tick)
    coarse = make_coarse(record, axis, settings, chosen.jobs, clock)
    ladder = climb(coarse, chosen.wish, chosen.say)
    best = ladder.best
    fit, bench = best.fit, ladder.bench.rescaled(best.fit.values)
    if best.gains_by_rows:
        chosen.say(f"{best.title}: refined")
        course, step = make_course(record, _FINE), max(step, _FINE_STEP)
        fine = replace(bench, course=course, step=step, blur=0.0, has_middles=False)
        # First averaged, as swings have many valleys, then as it is.
        averaged = replace(fine, blur=_BLUR).rescaled(fit.values)
        near = search(averaged, fit.unknowns, fit.variables, _ROUNDS)
        near, fine = _refine(fine.rescaled(near.values), near)
        again = judge(fine, best.title, near, choose_folds(fine)[0])
        if again.is_good:
            fit, bench = near, fine
            rungs = tuple(again if rung is best else rung for rung in ladder.rungs)
            ladder = ladder._replace(rungs=rungs)
    is_refined = fit.is_whole and not clock.is_over
    chosen.say("intervals")
    covariance = _covariance(replace(bench, clock=replace(clock, end=math.inf)), fit)
    estimates = _estimates(fit, covariance, len(bench.course.strokes))
    return Identification(
        bench=bench, ladder=ladder, fit=fit, estimates=estimates, is_refined=is_refined
    )


def make_coarse(
    record: AxisRecord, axis: CylinderConfig, settings: Settings, jobs: int, clock: Clock
) -> Bench:
    """Return the plant beside a record, coarse, for the ladder; arguments as of `identify`.

    Raises:
        ConfigError: a start at rest does not determine all states of the machine, or its piston
            leaves the configured stroke by more than a tenth.
    """
    if hidden := states_without_start(axis.options):
        what = " and ".join(hidden)
        raise ConfigError(f"identification cannot carry {what} of this axis; switch that off")
    course = make_course(record, _COARSE)
    h, worst = axis.parameters.h, float(np.abs(course.record.measured[:, 0]).max())
    if worst > 1.1 * h:
        raise ConfigError(
            f"the position reaches {1e3 * worst:.4g} mm from mid-stroke, and stroke_mm allows "
            f"{1e3 * h:g} mm; check its unit and offset (mid-stroke is 0), or stroke_mm"
        )
    template = Template(axis, settings, len(record.sessions))
    return Bench(
        template, course, _COARSE_STEP, jobs=jobs, clock=clock, blur=_BLUR, has_middles=True
    )


def _refine(bench: Bench, found: Fit) -> tuple[Fit, Bench]:
    """Return a fit on fine rows, where that is better, and the bench of it.

    The scales follow the residuals until both stay: intervals are those of an end, not of a halt.
    """
    fit = search(bench, found.unknowns, found.variables, _ROUNDS, _EXACT)
    for _ in range(_AGAIN):
        if not fit.is_whole:
            break
        next_bench = bench.rescaled(fit.values)
        stays = np.abs(next_bench.scale / bench.scale - 1.0).max() < _STAYS
        bench = next_bench
        fit = search(bench, fit.unknowns, fit.variables, _ROUNDS, _EXACT)
        if stays:
            break
    return fit, bench


def _covariance(bench: Bench, fit: Fit) -> Values:
    """Return the covariance of the variables: by strokes left out, or that of noise if larger.

    A stroke's residuals count as one observation, so whatever they have in common counts. Each
    stroke is left out by one step of Newton: unlike a sandwich over few strokes, that shows what
    only one of them determines. What the search had still to go counts, too.
    """
    problem = Problem(bench, fit.unknowns)
    residuals = problem.residuals(fit.variables)
    slopes = problem.slopes(fit.variables)
    hessian = slopes.T @ slopes
    edges = np.cumsum([0, *problem.lengths]).tolist()
    moved = []
    for part in itertools.starmap(slice, itertools.pairwise(edges)):
        rest = np.linalg.pinv(hessian - slopes[part].T @ slopes[part], rcond=1e-12)
        moved.append(rest @ (slopes[part].T @ residuals[part]))
    size = max(1.0, float(np.mean(np.square(residuals[: edges[-1]]))))
    plain = size * np.linalg.pinv(hessian, rcond=1e-12)
    to_go = plain / size @ (slopes.T @ residuals)
    jackknife = np.square(moved).sum(axis=0) * (1.0 - 1.0 / len(moved))
    left_out = jackknife + np.square(to_go)
    larger = np.sqrt(np.maximum(left_out / np.maximum(np.diag(plain), 1e-300), 1.0))
    return np.asarray(plain * np.outer(larger, larger))


def _estimates(fit: Fit, covariance: Values, strokes: int) -> tuple[Estimate, ...]:
    """Return the estimates, their intervals by Student's t: few strokes tell a spread badly."""
    from scipy.stats import t  # noqa: PLC0415 - an extra

    times = float(t.ppf(0.975, max(strokes - 1, 1)))
    expected = np.array([one.spread for one in fit.unknowns])  # no record makes that wider
    owns = np.minimum(np.sqrt(np.diag(covariance)), expected)

    def estimate(unknown: Unknown, variable: float, own: float) -> Estimate:
        ends = max(variable - times * own, unknown.low), min(variable + times * own, unknown.high)
        return Estimate(
            unknown.name,
            unknown.value(variable),
            own * abs(unknown.slope(variable)),
            (unknown.value(ends[0]), unknown.value(ends[1])),
            unknown.value(unknown.start),
            own < min(_TOLD * unknown.spread, _TOLD_AT_MOST),
        )

    return tuple(map(estimate, fit.unknowns, fit.variables.tolist(), owns.tolist()))
