"""Output error over whole strokes: the plant beside the record, and the search for its unknowns."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from time import monotonic
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.descent import damped_step, descend
from hil_bench.abilities.identification.logger import sense
from hil_bench.abilities.identification.machine import Running, Template, Unknown, read_values
from hil_bench.abilities.identification.record import FLOORS
from hil_bench.abilities.identification.strokes import Course, Stroke
from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model.courses import CourseCuts, open_cuts, run_course
from hil_bench.plants.hydraulic_cylinder.model.extensions import ATMOSPHERE

Values = npt.NDArray[np.float64]
Cuts = list[CourseCuts]
Before = tuple[float, float]
Folds = Sequence[Sequence[int]]

_AWFUL = 1e3  # scales: what a run that fails counts as
_BURNT = 0.02  # [s] at the start of a stroke that count for nothing if the piston moves then
_SEEN = [0, 2, 3]  # x, P_A, P_B among what a course shows
_MIDDLE, _FEW_ROWS, _LEAST_TRAVEL = (0.35, 0.65), 4, 2e-3  # of the travel, where speed stands; [m]
_MIDDLE_SCALES = np.array([2e-3, 2e4, 2e4])  # a share of the speed, [Pa]
_OF_ROWS = 1.5  # a middle's speed or pressure weighs the root of its stroke's rows by this
_INDEPENDENT = 30.0  # values of a stroke
_HARDLY, _LOST = 1e-9, 4.0  # damping of a step of Newton; times the cost, where it leads nowhere
_SHARES = (1.0, 0.5, 0.25, 0.1, 0.01)  # of it, beside none
_SUNK = 1e-3  # [m] by which a piston may press into its stop


class Stopped(Exception):  # noqa: N818 - no error: the search ends with the best so far
    """The time is over."""


@dataclass(frozen=True, slots=True)
class Clock:
    """The end of the time for a search.

    Attributes:
        end: on the machine's monotonic clock [s]; infinite for none.
        tick: is called often.
    """

    end: float = math.inf
    tick: Callable[[], None] = lambda: None

    @property
    def is_over(self) -> bool:
        """Return True if the time is over."""
        return monotonic() > self.end


class Fit(NamedTuple):
    """The outcome of a search.

    Attributes:
        unknowns: that were sought.
        variables: that were found.
        cost: at these.
        is_whole: whether the search has come to its end.
    """

    unknowns: tuple[Unknown, ...]
    variables: Values
    cost: float
    is_whole: bool

    @property
    def values(self) -> dict[str, float]:
        """The values of the unknowns in their units, by name."""
        return read_values(self.unknowns, self.variables)


@dataclass(frozen=True, slots=True)
class Bench:
    """The plant beside the strokes of a record.

    Attributes:
        template: of the machine.
        course: the strokes.
        step: of the solver at most [s].
        scale: of each signal's residual, shape (3,) [m], [Pa].
        jobs: runs at a time.
        clock: the time that is left.
        blur: over which residuals are averaged, so that no phase of a swing counts [s].
        has_middles: whether speed and mean pressures in the middles of strokes count apart.
    """

    template: Template
    course: Course
    step: float
    scale: Values = field(default_factory=lambda: np.array([1e-3, 1e5, 1e5]))
    jobs: int = 1
    clock: Clock = field(default_factory=Clock)
    blur: float = 0.0
    has_middles: bool = False

    @property
    def ends_at_stop(self) -> bool:
        """Return True if a stroke ends near an end of its way, the valve still open."""
        h, record = self.template.axis.parameters.h, self.course.record
        for stroke in self.course.strokes:
            x, u = self.measured(stroke)[:, 0], self.setpoints_of(stroke) / record.full_opening
            stands = np.abs(np.diff(x, append=x[-1])) < 1e-5
            near = np.abs(x) > 0.97 * h
            if (stands & near & (np.sign(u) == np.sign(x)) & (np.abs(u) > 0.1)).mean() > 0.02:
                return True
        return False

    @property
    def every(self) -> int:
        """Steps of the solver between two rows."""
        return max(1, math.ceil(self.course.record.interval / self.step - 1e-6))

    @property
    def dt(self) -> float:
        """Step of the solver [s]."""
        return self.course.record.interval / self.every

    def machine(self, values: Mapping[str, float]) -> Running:
        """Return the machine that unknowns make; `ParameterError` where none does."""
        return self.template.run(values, self.dt)

    def setpoints_of(self, stroke: Stroke) -> Values:
        """Return the set-point of each row of a stroke [m]."""
        return self.course.record.setpoints[stroke.rows.start + 1 : stroke.rows.stop]

    def cuts(self) -> Cuts:
        """Return cuts of all strokes, still to be found."""
        return [open_cuts(self.every * (len(one.rows) - 1)) for one in self.course.strokes]

    def run(self, machine: Running, cuts: Cuts) -> list[Values]:
        """Return the sensors' position, P_A and P_B in each stroke, shape (rows - 1, 3).

        From a stroke to the next one of a recording a supply unit goes on, and the force on the
        piston that its stop or friction holds.
        """
        shown, before, last = [], (machine.supply, 0.0), (-1, 0)
        for stroke, cut in zip(self.course.strokes, cuts, strict=True):
            if (stroke.session, stroke.number - 1) != last:
                before = machine.supply, 0.0
            seen, before = self._run_stroke(machine, stroke, cut, before)
            shown.append(seen)
            last = stroke.session, stroke.number
        return shown

    def _run_stroke(
        self, machine: Running, stroke: Stroke, cuts: CourseCuts, before: Before
    ) -> tuple[Values, Before]:
        setpoints, p = self.course.commands_of(stroke, self.every), machine.parameters
        start = _start(machine, stroke, self.course.record.setpoints[stroke.rows.start], before)
        every, supply = run_course(machine.constants, start, setpoints, every=self.every, cuts=cuts)
        seen = every[:, _SEEN]
        held = float(seen[-1, 1:] @ (p.A_A, -p.A_B)) - machine.options.load_at(float(seen[-1, 0]))
        if machine.delay or machine.lag:
            whole = np.concatenate([start[np.newaxis, _SEEN], seen])
            interval = self.course.record.interval
            seen = sense(whole, machine.delay / interval, machine.lag / interval)
        seen = np.clip(np.nan_to_num(seen, nan=1e9), -1e9, 1e9)
        return seen + machine.offsets[stroke.session], (supply, held)

    def counts(self, stroke: Stroke) -> npt.NDArray[np.bool_]:
        """Mark the values of a stroke that count, shape (rows - 1, 3)."""
        rows = slice(stroke.rows.start + 1, stroke.rows.stop)
        record = self.course.record
        counts = np.isfinite(record.measured[rows]) & ~record.clipped[rows]
        if stroke.start[1] != 0.0:
            counts[: round(_BURNT / record.interval)] = False
        return np.asarray(counts)

    def measured(self, stroke: Stroke) -> Values:
        """Return the record of a stroke, shape (rows - 1, 3)."""
        return self.course.record.measured[stroke.rows.start + 1 : stroke.rows.stop]

    def deviations(self, values: Mapping[str, float]) -> list[Values]:
        """Return model less record in each stroke, shape (rows - 1, 3); NaN for what is missing."""
        shown = self.run(self.machine(values), self.cuts())
        return [
            np.where(self.counts(one), model - self.measured(one), np.nan)
            for one, model in zip(self.course.strokes, shown, strict=True)
        ]

    def misses(self, values: Mapping[str, float]) -> list[float]:
        """Return the rms of model less record of each signal, NaN for one that is missing [SI]."""
        every = np.concatenate(self.deviations(values)).T
        there = [one[np.isfinite(one)] for one in every]
        return [math.sqrt(np.square(one).mean()) if len(one) else math.nan for one in there]

    def rescaled(self, values: Mapping[str, float]) -> "Bench":
        """Return the same with the residuals of a machine as their scale, never below the noise."""
        every = np.concatenate(self.deviations(values))
        sizes = np.array([_robust_size(every[:, signal]) for signal in range(3)])
        noise = np.where(np.isfinite(self.course.record.noise), self.course.record.noise, 0.0)
        return replace(self, scale=np.maximum(np.maximum(sizes, noise), FLOORS))

    def some(self, chosen: list[int]) -> "Bench":
        """Return the same with some of the strokes."""
        return replace(self, course=self.course.some(chosen))


class Problem:
    """Residuals and slopes of a bench.

    Args:
        bench: plant and record.
        unknowns: that are sought.
    """

    def __init__(self, bench: Bench, unknowns: Sequence[Unknown]) -> None:
        self.bench, self.unknowns = bench, tuple(unknowns)
        rows = [(one.start, one.spread, one.low, one.high) for one in unknowns]
        self.start, self.spread, low, high = np.array(rows).reshape(-1, 4).T
        self.bounds = low, high
        self._counts = [bench.counts(one) for one in bench.course.strokes]
        self._measured = [bench.measured(one) for one in bench.course.strokes]
        self._middles = [
            find_middle(measured, bench.setpoints_of(one), bench.course.record.full_opening)
            if bench.has_middles
            else None
            for measured, one in zip(self._measured, bench.course.strokes, strict=True)
        ]
        self._cuts, self._here = bench.cuts(), np.array([])
        self._residuals = np.array([])
        self.best: tuple[float, Values] = (math.inf, self.start)
        values = _INDEPENDENT * len(bench.course.strokes)
        self.doubt = math.sqrt(max(1.0, sum(self.lengths) / values))

    @property
    def lengths(self) -> list[int]:
        """Values of each stroke among the residuals."""
        pairs = zip(self._counts, self._middles, strict=True)
        return [int(counts.sum()) + (3 if middle else 0) for counts, middle in pairs]

    def residuals(self, variables: Values) -> Values:
        """Return the residuals of all strokes in their scales, then those of the expectations.

        Raises:
            Stopped: the time is over.
        """
        if self.bench.clock.is_over:
            raise Stopped
        self.bench.clock.tick()
        self._cuts = self.bench.cuts()
        self._here = variables.copy()
        self._residuals = self._at(variables, self._cuts)
        cost = 0.5 * float(np.square(self._residuals).sum())
        if cost < self.best[0]:
            self.best = (cost, variables.copy())
        return self._residuals

    def slopes(self, variables: Values) -> Values:
        """Return the slopes of the residuals by the variables, shape (residuals, variables)."""
        if not np.array_equal(variables, self._here):
            self.residuals(variables)
        here, cuts = self._residuals, self._cuts
        steps = [
            one.step if variable + one.step <= one.high else -one.step
            for one, variable in zip(self.unknowns, variables.tolist(), strict=True)
        ]
        places = variables + np.diag(steps)

        def slope(place: int) -> Values:
            if self.bench.clock.is_over:
                raise Stopped
            self.bench.clock.tick()
            return np.asarray((self._at(places[place], cuts) - here) / steps[place])

        with ThreadPoolExecutor(self.bench.jobs) as pool:
            return np.stack(list(pool.map(slope, range(len(steps)))), axis=1)

    def without(self, variables: Values, folds: Folds, wide: int) -> Iterator[Values]:
        """Yield the variables of a fit without some of its strokes each, by one step of Newton.

        A search from where these strokes count, too, would keep what only they show. The step of
        the first folds goes as far as the other strokes are not lost, beyond which slopes do not
        hold; that of the others ends where the other strokes are fitted best.
        """
        slopes, residuals = self.slopes(variables), self._residuals
        lengths = [*self.lengths, len(variables)]  # the last are expectations, which stay
        owner = np.repeat(np.arange(len(lengths)), lengths)
        for number, fold in enumerate(folds):
            kept = ~np.isin(owner, fold)
            part, off = slopes[kept], residuals[kept]
            step = damped_step(variables, part.T @ part, part.T @ off, _HARDLY, self.bounds)
            here, places = float(off @ off), (variables + share * step for share in _SHARES)
            tries = ((self._cost(place, kept), place) for place in places)
            if number < wide:
                yield next((place for cost, place in tries if cost <= _LOST * here), variables)
            else:
                yield min([(here, variables), *tries], key=lambda one: one[0])[1]

    def _cost(self, variables: Values, kept: npt.NDArray[np.bool_]) -> float:
        off = self._at(variables, self.bench.cuts())[kept]
        return float(off @ off)

    def _at(self, variables: Values, cuts: Cuts) -> Values:
        # Neighbouring rows are alike: expectations count as so many independent values do.
        expected = self.doubt * (variables - self.start) / self.spread
        try:
            machine = self.bench.machine(read_values(self.unknowns, variables))
        except ParameterError:
            return np.concatenate([np.full(sum(self.lengths), _AWFUL), expected])
        parts = []
        for place, model in enumerate(self.bench.run(machine, cuts)):
            off, counts = model - self._measured[place], self._counts[place]
            near = np.clip(off / self.bench.scale, -_AWFUL, _AWFUL)
            parts.append(_robust(self._blurred(near, counts)))
            if middle := self._middles[place]:
                weight = math.sqrt(len(off)) / _OF_ROWS
                parts.append(weight * _robust(_off_middle(off, self._measured[place], middle)))
        return np.concatenate([*parts, expected])

    def _blurred(self, residuals: Values, counts: npt.NDArray[np.bool_]) -> Values:
        """Return the residuals that count, each the mean of those about it."""
        rows = round(self.bench.blur / self.bench.course.record.interval)
        if rows > 1:
            from scipy.ndimage import uniform_filter1d  # noqa: PLC0415 - an extra

            there = uniform_filter1d(counts.astype(np.float64), rows, axis=0)
            residuals = uniform_filter1d(np.where(counts, residuals, 0.0), rows, axis=0)
            residuals = residuals / np.maximum(there, 1e-9)
        return np.asarray(residuals[counts])


def search(
    bench: Bench, unknowns: Sequence[Unknown], begin: Values, rounds: int, exact: float = 1e-3
) -> Fit:
    """Seek the variables that fit best.

    Args:
        bench: plant and record.
        unknowns: that are sought.
        begin: variables at the start of the search.
        rounds: steps at most.
        exact: as `descend` has it.

    Returns:
        The best that was found, also where the time was over: then perhaps where it began, with
        an infinite cost if nothing was run.
    """
    problem = Problem(bench, unknowns)
    begin = np.clip(begin, *problem.bounds)
    problem.best = (math.inf, begin)
    is_whole = True
    try:
        descend(problem.residuals, problem.slopes, begin, problem.bounds, rounds, exact)
    except Stopped:
        is_whole = False
    cost, variables = problem.best
    return Fit(tuple(unknowns), variables, cost, is_whole)


def find_middle(measured: Values, setpoints: Values, full_opening: float) -> range | None:
    """Return the rows in which a stroke is half its way and its set-point stands; None for none."""
    travel = measured[-1, 0] - measured[0, 0]
    if not abs(travel) > _LEAST_TRAVEL:
        return None
    way = (measured[:, 0] - measured[0, 0]) / travel
    inside = np.flatnonzero((way > _MIDDLE[0]) & (way < _MIDDLE[1]))
    if len(inside) < _FEW_ROWS or inside[-1] - inside[0] > 1.1 * len(inside):
        return None
    rows = range(int(inside[0]), int(inside[-1]) + 1)
    u = setpoints[rows.start : rows.stop]
    is_steady = np.ptp(u) < 0.02 * full_opening < abs(float(u.mean()))
    return rows if is_steady else None


def _off_middle(off: Values, measured: Values, rows: range) -> Values:
    """Return by how much speed and mean pressures are off in the middle of a stroke, scaled."""
    part, slope = off[rows.start : rows.stop], np.arange(len(rows)) - 0.5 * (len(rows) - 1)
    speed = slope @ part[:, 0] / (slope @ measured[rows.start : rows.stop, 0])
    missed = np.nan_to_num(part[:, 1:].mean(axis=0))
    scaled = np.array([speed, *missed]) / _MIDDLE_SCALES
    return np.asarray(np.clip(scaled, -_AWFUL, _AWFUL))


def _robust(residuals: Values) -> Values:
    """Return residuals whose halved squares are sqrt(1 + r²) - 1: far off, they count linearly."""
    sizes = np.sqrt(2.0 * (np.sqrt(1.0 + np.square(residuals)) - 1.0))
    return np.asarray(np.copysign(sizes, residuals))


def _start(machine: Running, stroke: Stroke, setpoint: float, before: Before) -> Values:
    """Return the state at the start of a stroke.

    Args:
        machine: that runs.
        stroke: it.
        setpoint: at its start [m].
        before: supply pressure [Pa], and the force that stop or friction held at the end of the
            stroke before [N]: a pressure that is missing leaves it as it was.
    """
    p, options = machine.parameters, machine.options
    offset, *offsets = machine.offsets[stroke.session]
    x = float(np.clip(stroke.start[0] - offset, -p.h - _SUNK, p.h + _SUNK))
    pressures = stroke.start[2:] - offsets
    load = options.load_at(x) + before[1]
    if math.isnan(pressures[0]):
        pressures[0] = (pressures[1] * p.A_B + load) / p.A_A
    elif math.isnan(pressures[1]):
        pressures[1] = (pressures[0] * p.A_A - load) / p.A_B
    pressures = np.clip(pressures, -0.9 * ATMOSPHERE, 10.0 * p.P_S)
    return np.array([x, stroke.start[1], *pressures, setpoint, *[0.0] * 3, before[0], *[0.0] * 3])


def _robust_size(values: Values) -> float:
    """Return the rms of values that are there, of which some may be far off."""
    there = values[np.isfinite(values)]
    if not len(there):
        return 0.0
    most = 4.0 * float(np.quantile(np.abs(there), 0.8))
    return float(np.sqrt(np.square(np.clip(there, -most, most)).mean()))
