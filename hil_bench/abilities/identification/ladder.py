"""The ladder of models: each starts from the plateaus, and is judged by strokes left out."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.errors import StrokeError, measure_errors
from hil_bench.abilities.identification.fit import Bench, Fit, Folds, Problem, Stopped, search
from hil_bench.abilities.identification.machine import (
    DELAY,
    DROOP,
    GAS,
    LAG,
    OVERLAPS,
    PUMP,
    SLEW,
    STICTION,
    Template,
    Unknown,
    read_values,
)
from hil_bench.abilities.identification.steady import fit_plateaus
from hil_bench.abilities.identification.strokes import Stroke
from hil_bench.plants.hydraulic_cylinder.keys import Supply
from hil_bench.units import BAR, LITRE

Values = npt.NDArray[np.float64]

_FOLDS = 3  # of the strokes by amplitude, or at random
_ALIKE = 2  # strokes of a recording, an opening and a direction that the ladder looks at
_SIZES = (1e-3, 0.015, 0.015, 10e-3)  # [m], of the speed, of P_S, [s]: what errors count by
_WORST = 10.0  # times that: a stroke that is farther off is lost anyway
_GOOD = 0.15  # of these sizes: a model that predicts so well is as good as a better one

_PUMPS = ((0.25, 1.5), (0.25, 4.0), (0.5, 1.5), (0.5, 4.0))
"""Flow of a pump, of the valve's largest, and gas of its accumulator, of the swept volume."""
_CLEARLY = 0.9  # of the cost with a plain supply: an accumulator
_RISE = 0.06  # of the supply pressure, where the relief valve takes all that the pump gives

_ROUNDS = 12  # of a search at most
_AS_WELL = 1.1  # times the least score, or cost where none is judged: about as good

MASS, LOAD = "moving_mass_kg", "load_mass_kg"

PAPER = (
    "orifice_width_mm",
    "spool_overlap_mm",
    "bulk_modulus_mpa",
    "coulomb_friction_n",
    "viscous_friction_n_s_m",
    MASS,
    "spool_natural_frequency_rad_s",
    "internal_leakage_l_min_bar",
)
"""Unknowns that every machine has."""

STEADY = (
    "orifice_width_mm",
    "flow_saturation",
    "land_gain_at",
    "land_gain_pb",
    "land_gain_bt",
    *OVERLAPS,
    "coulomb_friction_n",
    "viscous_friction_n_s_m",
    "load_n",
    "supply_pressure_bar",
    "tank_pressure_bar",
    "piston_area_cm2",
    "rod_side_area_cm2",
)
"""Unknowns that the plateaus of strokes show."""

SWIFT = (
    "bulk_modulus_mpa",
    MASS,
    "spool_natural_frequency_rad_s",
    "spool_damping_ratio",
    SLEW,
    "internal_leakage_l_min_bar",
    "null_opening_um",
    "entrained_air_percent",
    "dead_a",
    "dead_b",
    STICTION,
    "stribeck_velocity_mm_s",
    DELAY,
    LAG,
)
"""Unknowns that the rest of the strokes shows besides."""

PLATEAUS, THE_PAPERS = "plateaus alone", "the paper's model"
WHOLE, SUPPLY = "whole strokes", "and a supply that yields"

_AREAS = "masses, forces and flows hold for the areas given, which no pressure or motion shows"

ALIASES = {
    "piston_side_volume_cm3": "dead_a",
    "rod_side_volume_cm3": "dead_b",
    "static_friction_n": STICTION,
}
"""The unknown behind a name that a user may fix or free."""


def _logs(*ratios: float) -> tuple[float, ...]:
    return tuple(map(math.log, ratios))


_GRIDS: Mapping[str, Sequence[float]] = {
    "dead_a": _logs(3.0, 10.0, 30.0),
    "dead_b": _logs(3.0, 10.0, 30.0),
    "bulk_modulus_mpa": _logs(1.4, 0.7, 0.5, 0.35, 0.2),
    MASS: _logs(0.7, 0.85, 1.2, 1.5, 2.0),
    LOAD: _logs(0.7, 0.85, 1.2, 1.5, 2.0),
    "spool_natural_frequency_rad_s": _logs(1.5, 0.7, 0.5, 0.35),
    SLEW: _logs(1.0, 0.5, 0.3, 0.2),
    DELAY: (0.0, 1.0, 2.0, 3.0, 5.0),
    LAG: (0.0, 1.0, 2.0, 5.0),
    "null_opening_um": (0.0, 0.2, 0.5, 1.0),
    "internal_leakage_l_min_bar": (0.0, 1.0, 3.0, 10.0),
    DROOP: (0.0, 1.0, 2.0, 4.0),
}
"""Variables that are tried before the search."""


@dataclass(frozen=True, slots=True)
class Rung:
    """A model of the ladder.

    Attributes:
        title: of it.
        fit: to the strokes.
        scores: of each stroke when it was left out: mean square of its errors, each over its size.
        errors: of each stroke when it was left out; empty where there was no time.
    """

    title: str
    fit: Fit
    scores: Values
    errors: tuple[StrokeError, ...]

    @property
    def score(self) -> float:
        """Root of the mean of the scores; infinite where it was not judged."""
        return math.sqrt(float(self.scores.mean())) if len(self.scores) else math.inf

    @property
    def is_good(self) -> bool:
        """Return True if it predicts so well that no other model needs to be tried."""
        return self.score < _GOOD

    @property
    def gains_by_rows(self) -> bool:
        """Return True if finer rows show more: other models bend to what they lack."""
        return self.is_good and self.title == THE_PAPERS


class Ladder(NamedTuple):
    """The models that were tried.

    Attributes:
        bench: plant and strokes that they were tried on.
        rungs: in the order of trial.
        chosen: place of the one that is taken.
        is_whole: whether the time sufficed for all.
        notes: on how they were judged.
    """

    bench: Bench
    rungs: tuple[Rung, ...]
    chosen: int
    is_whole: bool
    notes: tuple[str, ...]

    @property
    def best(self) -> Rung:
        """The model that is taken."""
        return self.rungs[self.chosen]


class Wish(NamedTuple):
    """The wishes of a user.

    Attributes:
        fix: names that are held.
        free: names that are free in every model.
    """

    fix: frozenset[str] = frozenset()
    free: tuple[str, ...] = ()


def climb(
    bench: Bench, wish: Wish, say: Callable[[str], None], *, is_judged: bool = True
) -> Ladder:
    """Try the models of the ladder, and choose.

    Args:
        bench: plant and record, coarse.
        wish: of the user.
        say: takes what is being done.
        is_judged: whether strokes are left out to judge each; otherwise the fit decides.
    """
    say(PLATEAUS)
    few = bench.some(_alike(bench))
    folds, notes = choose_folds(few) if is_judged else ([], ())
    every = [*wish.free, *_offsets(few), *_stops(few)]
    steady = find_free(few, [*STEADY, *_offsets(few)], wish)
    overlaps = dict.fromkeys(OVERLAPS, few.template.start("spool_overlap_mm"))
    unknowns, variables = few.template.begin(steady, overlaps)
    variables, stiff = fit_plateaus(few, unknowns, variables)
    few = few.rescaled(read_values(unknowns, variables))
    first = search(few, unknowns, variables, 0)
    rungs = [judge(few, PLATEAUS, first, folds)]
    for title in (THE_PAPERS, WHOLE, SUPPLY):
        best = rungs[choose_rung(rungs)]
        if few.clock.is_over or (len(rungs) > 1 and best.is_good):
            break
        say(f"{title}; so far {_describe(few, best.fit)}")
        own, known, more = few.template, {}, [*PAPER, *every]
        if title == WHOLE:
            known, more = first.values, [*SWIFT, *every]
        elif title == SUPPLY:
            known, more = best.fit.values, list(_supply(few))
            is_open = PUMP in more and DROOP not in wish.fix
            if is_open and (drained := find_accumulator(few, steady, overlaps, stiff)):
                own, known = drained[0], rungs[-1].fit.values | drained[1]
                more = [*SWIFT, *every, *more]
        names = find_free(few, [*known, *more], wish)
        unknowns, variables = own.begin(names, known)
        if own is not few.template or not known:
            variables, _ = fit_plateaus(few, unknowns, variables)
        fit = search(few, unknowns, _scan(few, unknowns, variables, more), _ROUNDS)
        if math.isfinite(fit.cost):
            rungs.append(judge(few, title, fit, folds))
    return Ladder(few, tuple(rungs), choose_rung(rungs), not few.clock.is_over, (*notes, _AREAS))


def choose_rung(rungs: Sequence[Rung]) -> int:
    """Return the place of the model that predicts best, or that fits best where none is judged.

    Of several that are good, or about as good, the one with the fewest unknowns counts as best.
    """
    scores, good = [rung.score for rung in rungs], _GOOD
    if not math.isfinite(min(scores)):
        scores, good = [rung.fit.cost for rung in rungs], 0.0
    enough = max(good, _AS_WELL * min(scores))
    alike = [place for place, score in enumerate(scores) if score <= enough]
    return min(alike, key=lambda place: len(rungs[place].fit.unknowns))


def choose_folds(bench: Bench) -> tuple[list[list[int]], tuple[str, ...]]:
    """Return the strokes that are left out together, by amplitude and at random, and notes."""
    strokes = bench.course.strokes
    if len(strokes) < 2:
        return [], ("one stroke only: nothing can be left out, so no error of prediction is known",)
    if len(strokes) < 6:
        few = f"{len(strokes)} strokes, each left out once; record four each way at three openings"
        return [[place] for place in range(len(strokes))], (few,)
    # What only the smallest opening shows, the overlap, no other one predicts.
    _, *larger = _by_amplitude(np.array([one.opening for one in strokes]))
    if larger:
        return [part.tolist() for part in larger], ()
    order = np.random.default_rng(5).permutation(len(strokes))
    folds = [sorted(order[k::_FOLDS].tolist()) for k in range(_FOLDS)]
    return folds, ("all strokes have one opening: no other amplitude was predicted",)


def _by_amplitude(openings: Values) -> list[npt.NDArray[np.int64]]:
    """Return the strokes in up to three groups of like openings, apart by a tenth."""
    order = np.argsort(openings, kind="stable")
    jumps = np.diff(openings[order])
    cuts = [
        place + 1
        for place in np.argsort(-jumps, kind="stable")[: _FOLDS - 1].tolist()
        if jumps[place] > 0.05 * openings.max()
    ]
    return [np.sort(part) for part in np.split(order, sorted(cuts))]


def find_free(bench: Bench, names: Sequence[str], wish: Wish) -> list[str]:
    """Return the names, each once, that the user does not hold and the machine has.

    Of a machine with a load it is the load's mass that is free: it is most of what moves.
    """
    if bench.template.start(LOAD) > 0.0:
        names = [LOAD if name == MASS else name for name in names]
    lacking = {"supply_pressure_bar"} if bench.template.axis.options.supply is not None else set()
    if bench.template.axis.options.bristles is not None:
        lacking.add("stribeck_velocity_mm_s")
    held = wish.fix | lacking
    return [one for one in dict.fromkeys(names) if not {one, one.partition(":")[0]} & held]


def _alike(bench: Bench) -> list[int]:
    """Return the places of strokes, few of those that are alike."""
    kinds = [(one.session, round(50.0 * one.opening), one.is_forth) for one in bench.course.strokes]
    return [place for place, kind in enumerate(kinds) if kinds[:place].count(kind) < _ALIKE]


def _offsets(bench: Bench) -> list[str]:
    """Return the unknowns of the pressure sensors."""
    return [
        f"offset_{side}:{number}"
        for number, session in enumerate(bench.course.record.sessions)
        for place, side in enumerate("ab", start=1)
        if session.has[place]
    ]


def _stops(bench: Bench) -> list[str]:
    """Return the unknowns of a record whose strokes end at a stop."""
    offsets = [f"offset_x:{number}" for number in range(bench.template.sessions)]
    return ["stroke_mm", *offsets] if bench.ends_at_stop else []


def _scan(
    bench: Bench, unknowns: Sequence[Unknown], variables: Values, more: Sequence[str]
) -> Values:
    """Return variables of which some are put where, the others as they are, they fit best.

    Slopes lead nowhere where a swing is out of phase, so what sets its pace and its decay is tried
    out, coarsely, before the search.

    Args:
        bench: plant and record.
        unknowns: of the model.
        variables: before.
        more: names of the unknowns that may move.
    """
    problem = Problem(replace(bench, blur=0.0), unknowns)
    names = [one.name for one in unknowns]
    tried = [name for name in _GRIDS if name in names and name in more]
    try:
        problem.residuals(variables)
        for name in [*tried, *tried]:
            for value in _GRIDS[name]:
                there, place = problem.best[1].copy(), names.index(name)
                there[place] = min(max(value, unknowns[place].low), unknowns[place].high)
                problem.residuals(there)
    except Stopped:
        pass
    return problem.best[1] if math.isfinite(problem.best[0]) else variables


def judge(bench: Bench, title: str, fit: Fit, folds: Folds) -> Rung:
    """Return a model with the errors of strokes that were left out of its fit.

    Openings that were left out say what its errors are. What scores it is each opening one way
    that was left out alone: a wrong model that has not seen an opening at all may be far off there,
    and the best one still.
    """
    kinds = _kinds(bench.course.strokes)
    every = [*folds, *(kinds if len(kinds) > 2 else folds)] if folds else []
    errors: list[StrokeError] = []
    try:
        left = _leave_out(bench, title, fit, every, len(folds))
        for fold, variables in zip(every, left, strict=True):
            shown = bench.run(bench.machine(read_values(fit.unknowns, variables)), bench.cuts())
            for place in fold:
                one = bench.course.strokes[place]
                record = np.where(bench.counts(one), bench.measured(one), np.nan)
                errors.append(measure_errors(shown[place], record, bench.course.record.interval))
    except Stopped:
        errors = []
    if not errors:
        return Rung(title, fit, np.array([]), ())
    count = sum(map(len, folds))
    sizes = np.array(_SIZES) * (1.0, 1.0, bench.template.axis.parameters.P_S, 1.0)
    shares = np.clip(np.array(errors[count:]) / sizes, 0.0, _WORST)
    return Rung(title, fit, np.nanmean(np.square(shares), axis=1), tuple(errors[:count]))


def _kinds(strokes: Sequence[Stroke]) -> list[list[int]]:
    """Return the places of strokes of each opening, each way."""
    kinds = [(round(50.0 * one.opening), one.is_forth) for one in strokes]
    return [
        [place for place, one in enumerate(kinds) if one == kind] for kind in dict.fromkeys(kinds)
    ]


def _leave_out(bench: Bench, title: str, fit: Fit, folds: Folds, wide: int) -> Iterable[Values]:
    """Return the variables of a fit without the strokes of each fold, as `Problem.without` does."""
    if title != PLATEAUS and folds:
        return Problem(bench, fit.unknowns).without(fit.variables, folds, wide)
    places = range(len(bench.course.strokes))
    rests = [[place for place in places if place not in fold] for fold in folds]
    return [fit_plateaus(bench.some(rest), fit.unknowns, fit.variables)[0] for rest in rests]


def _supply(bench: Bench) -> tuple[str, ...]:
    """Return the unknowns of a supply that yields: what is configured, or one that sags."""
    template = bench.template
    if template.axis.options.supply is None:
        return (DROOP, PUMP, GAS)
    if template.settings["supply"].value not in set(Supply):
        return ()
    unit = ("pump_flow_l_min", "relief_pressure_bar", "accumulator_volume_l")
    return (*(key for key in unit if template.start(key) > 0.0), "tank_pressure_bar")


def find_accumulator(
    bench: Bench, names: Sequence[str], start: Mapping[str, float], stiff: float
) -> tuple[Template, dict[str, float]] | None:
    """Return the machine with the accumulator that plateaus show, and the values of both.

    What a stroke has drawn beyond the pump's flow is known from its speed and its way, and so is
    the supply pressure in mid-stroke. None where a supply that holds its pressure, or one that sags
    with the flow, agrees about as well.

    Args:
        bench: plant and record.
        names: of the unknowns that plateaus show.
        start: values of some of them, from which their search goes on.
        stiff: cost of the plateaus with a supply that holds its pressure.
    """
    template = bench.template
    p, most = template.axis.parameters, template.largest_flow
    swept, rise = LITRE.from_si(2.0 * p.h * p.A_A), _RISE * BAR.from_si(p.P_S) / most

    def fed_by(supply: dict[str, float]) -> tuple[float, Template, dict[str, float]]:
        own = replace(template, held=supply)
        unknowns, variables = own.begin(names, start)
        variables, cost = fit_plateaus(replace(bench, template=own), unknowns, variables)
        return cost, own, read_values(unknowns, variables) | supply

    plain = min(stiff, fed_by({DROOP: rise / _PUMPS[-1][0]})[0])
    found = [fed_by({DROOP: rise / pump, PUMP: pump, GAS: gas * swept}) for pump, gas in _PUMPS]
    cost, own, values = min(found, key=lambda one: one[0])
    return (own, values) if cost < _CLEARLY * plain else None


def _describe(bench: Bench, fit: Fit) -> str:
    x, *pressures = bench.misses(fit.values)
    worst = max(pressures, key=np.nan_to_num)
    return f"position {1e3 * x:.2g} mm, pressure {1e-5 * worst:.2g} bar rms"
