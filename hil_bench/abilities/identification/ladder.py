"""The ladder of models: groups that are freed together, judged by strokes that were left out."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.errors import StrokeError, measure_errors
from hil_bench.abilities.identification.fit import Bench, Fit, search
from hil_bench.abilities.identification.machine import (
    DELAY,
    DROOP,
    FLOW,
    LAG,
    OVERLAPS,
    STICTION,
    Unknown,
)
from hil_bench.plants.hydraulic_cylinder.keys import Supply

Values = npt.NDArray[np.float64]

_FOLDS = 3  # of the strokes at random, and by amplitude
_LITTLE = 0.97  # of the cost: a model that fits hardly better does not predict better
_MOST = 400.0  # squared scales: a stroke that is farther off is lost anyway

PAPER = (
    "orifice_width_mm",
    "spool_overlap_mm",
    "bulk_modulus_mpa",
    "coulomb_friction_n",
    "viscous_friction_n_s_m",
    "moving_mass_kg",
    "spool_natural_frequency_rad_s",
    "internal_leakage_l_min_bar",
)
"""What every machine has."""

ROUGH = "flow and friction alone"
"""The model of the first answer."""

_ROUGH = (
    "orifice_width_mm",
    "spool_overlap_mm",
    "coulomb_friction_n",
    "viscous_friction_n_s_m",
)

GAINS = ("land_gain_at", "land_gain_pb", "land_gain_bt")

GROUPS: Mapping[str, tuple[str, ...]] = {
    "flow saturation": ("flow_saturation",),
    "land gains, air": ("flow_saturation", *GAINS, "entrained_air_percent"),
    "four overlaps, null opening": (*OVERLAPS, "null_opening_um", "spool_damping_ratio"),
    "dead volumes": ("dead_a", "dead_b"),
    "supply and tank pressure": ("supply_pressure_bar", "tank_pressure_bar"),
    "friction each way, stiction": ("load_n", STICTION, "stribeck_velocity_mm_s"),
    "late sensors": (DELAY, LAG),
    "supply that droops": (DROOP,),
    "piston areas": ("piston_area_cm2", "rod_side_area_cm2"),
    "flow of each recording": (FLOW,),
}
"""Groups of unknowns, in the order in which they are tried."""

ALIASES = {
    "piston_side_volume_cm3": "dead_a",
    "rod_side_volume_cm3": "dead_b",
    "static_friction_n": STICTION,
    "position_delay_ms": DELAY,
    "pressure_lag_ms": LAG,
    "supply_droop_bar_min_l": DROOP,
    "session_flow": FLOW,
}
"""The unknown behind a name that a user may fix or free."""

_UNIT = ("pump_flow_l_min", "relief_pressure_bar", "accumulator_volume_l")
_BEGIN = {
    "flow_saturation": 0.3,
    "entrained_air_percent": 0.5,
    "null_opening_um": 0.2,
    "internal_leakage_l_min_bar": 0.3,
    "external_leakage_a_l_min_bar": 0.3,
    "external_leakage_b_l_min_bar": 0.3,
    STICTION: 0.5,
    DROOP: 0.3,
    DELAY: 0.5,
    LAG: 0.5,
}
"""Variables from which the search goes on where an unknown is at its bound of zero."""


@dataclass(frozen=True, slots=True)
class Rung:
    """A model of the ladder.

    Attributes:
        title: the groups that it frees beside the paper's.
        fit: to all strokes.
        scores: of each stroke when it was left out: mean square in the scales of the ladder.
        errors: of each stroke when it was left out; empty where there was no time.
        is_kept: whether the models after it build on it.
    """

    title: str
    fit: Fit
    scores: Values
    errors: tuple[StrokeError, ...]
    is_kept: bool

    @property
    def score(self) -> float:
        """Root of the mean of the scores; infinite where it was not judged."""
        return math.sqrt(float(self.scores.mean())) if len(self.scores) else math.inf


class Ladder(NamedTuple):
    """The models that were tried.

    Attributes:
        rungs: in the order of trial.
        chosen: place of the one that is taken.
        is_whole: whether the time sufficed for all.
        notes: on how they were judged.
    """

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


def climb(bench: Bench, wish: Wish, say: Callable[[str], None]) -> Ladder:
    """Try the models of the ladder, and choose.

    Args:
        bench: plant and record, coarse.
        wish: of the user.
        say: takes what is being done.
    """
    say(ROUGH)
    rough = _rough(bench, wish)
    title, first = ROUGH, rough
    if rough.is_moved:
        say(f"first answer: {_describe(bench, rough)}; the paper's model")
        bench = bench.rescaled(rough.values)
        paper = _paper(bench, wish, rough)
        if paper.is_moved:
            bench = bench.rescaled(paper.values)
            title, first = "the paper's model", search(bench, paper.unknowns, paper.variables, 8)
            first = first._replace(is_moved=True)
    folds, notes = choose_folds(bench)
    rungs = [_judge(bench, title, first, folds, is_kept=True)]
    is_whole = True
    for title, group in _groups(bench, wish).items():
        if bench.clock.is_over:
            is_whole = False
            break
        current = next(rung for rung in reversed(rungs) if rung.is_kept)
        say(f"with {title}; so far {_describe(bench, current.fit)}")
        names = [one.name for one in current.fit.unknowns]
        fit = search_more(bench, names, current.fit.values, group, 10)
        if fit.cost > _LITTLE * current.fit.cost:
            rungs.append(Rung(title, fit, np.array([]), (), is_kept=False))
            continue
        rung = _judge(bench, title, fit, folds, is_kept=True)
        is_better = rung.score < current.score if folds else fit.cost < 0.9 * current.fit.cost
        rungs.append(replace(rung, is_kept=is_better))
    return Ladder(tuple(rungs), choose_rung(rungs), is_whole and not bench.clock.is_over, notes)


def choose_rung(rungs: Sequence[Rung]) -> int:
    """Return the place of the simplest model within one standard error of the best."""
    kept = [place for place, rung in enumerate(rungs) if rung.is_kept]
    judged = [place for place in kept if len(rungs[place].scores)]
    if not judged:
        return kept[-1]
    best = rungs[min(judged, key=lambda place: rungs[place].score)]
    for place in judged:
        more = rungs[place].scores - best.scores
        if more.mean() <= more.std(ddof=1) / math.sqrt(len(more)):
            return place
    return judged[-1]


def choose_folds(bench: Bench) -> tuple[list[list[int]], tuple[str, ...]]:
    """Return the strokes that are left out together, by amplitude and at random, and notes."""
    strokes = bench.course.strokes
    if len(strokes) < 2:
        return [], ("one stroke only: nothing can be left out, so no error of prediction is known",)
    if len(strokes) < 6:
        few = f"{len(strokes)} strokes, each left out once; record four each way at three openings"
        return [[place] for place in range(len(strokes))], (few,)
    openings = np.array([one.opening for one in strokes])
    folds = [part.tolist() for part in _by_amplitude(openings)]
    notes: tuple[str, ...] = ()
    if len(folds) < 2:
        folds, notes = [], ("all strokes have one opening: no other amplitude was predicted",)
    order = np.random.default_rng(5).permutation(len(strokes))
    return [*folds, *(sorted(order[k::_FOLDS].tolist()) for k in range(_FOLDS))], notes


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


def begin_of(bench: Bench, name: str, values: Mapping[str, float]) -> tuple[Unknown, float]:
    """Return an unknown and the variable from which its search goes on."""
    unknown = bench.template.unknown(name)
    if name not in values:
        variable = unknown.start
    elif unknown.is_log:
        variable = math.log(max(values[name], 1e-300) / unknown.scale)
    else:
        variable = values[name] / unknown.scale
    if name in _BEGIN and variable <= 0.0:
        variable = _BEGIN[name]
    return unknown, variable


def search_more(
    bench: Bench,
    names: Sequence[str],
    values: Mapping[str, float],
    more: Sequence[str],
    rounds: int,
) -> Fit:
    """Seek the variables of a model that frees more, from those of the model before."""
    values = dict(values)
    if OVERLAPS[0] in more:
        names = [name for name in names if name != "spool_overlap_mm"]
        overlap = values.get("spool_overlap_mm", bench.template.start("spool_overlap_mm"))
        values |= {name: values.get(name, overlap) for name in OVERLAPS if name in more}
    every = [*names, *(name for name in more if name not in names)]
    pairs = [begin_of(bench, name, values) for name in every]
    return search(bench, [one for one, _ in pairs], np.array([each for _, each in pairs]), rounds)


def _free(names: Sequence[str], wish: Wish) -> list[str]:
    """Return the names that the user does not hold."""
    return [
        name for name in names if name not in wish.fix and name.partition(":")[0] not in wish.fix
    ]


def _few(bench: Bench, count: int) -> Bench:
    strokes = len(bench.course.strokes)
    return bench.some(np.unique(np.linspace(0, strokes - 1, count).astype(int)).tolist())


def _rough(bench: Bench, wish: Wish) -> Fit:
    """Return a first answer: flow and friction on some of the strokes, the rest as configured.

    Where the time was over before any search had moved, it has the configured values.
    """
    few = _few(bench, 6)
    few = replace(few, clock=bench.clock.for_first())
    begin = {"orifice_width_mm": _width(few) * bench.template.start("orifice_width_mm")}
    pairs = [begin_of(bench, name, begin) for name in _free(_ROUGH, wish)]
    unknowns, variables = [one for one, _ in pairs], np.array([each for _, each in pairs])
    found = search(few, unknowns, variables, 6) if pairs else Fit((), variables, 0.0, True)
    return found if found.is_moved else found._replace(variables=_starts(found.unknowns))


def _starts(unknowns: Sequence[Unknown]) -> Values:
    return np.array([one.start for one in unknowns])


def _paper(bench: Bench, wish: Wish, rough: Fit) -> Fit:
    """Return the paper's model by several starts, each tried roughly on some of the strokes."""
    sessions = range(bench.template.sessions)
    has = [session.has for session in bench.course.record.sessions]
    offsets = [
        f"offset_{side}:{session}"
        for session in sessions
        for place, side in enumerate("ab", start=1)
        if has[session][place]
    ]
    wanted = [*PAPER, *(name for name in wish.free if name not in PAPER), *offsets]
    few = _few(bench, 8)
    fits = []
    for stiff in (1.0, 5.0, 0.3):
        begin = {"bulk_modulus_mpa": stiff * bench.template.start("bulk_modulus_mpa")}
        pairs = [begin_of(bench, name, begin | rough.values) for name in _free(wanted, wish)]
        unknowns = [one for one, _ in pairs]
        fits.append(search(few, unknowns, np.array([each for _, each in pairs]), 6))
        if bench.clock.is_over:
            break
    best = min(fits, key=lambda fit: fit.cost)
    found = search(bench, best.unknowns, best.variables, 8)
    return found._replace(is_moved=found.is_moved or best.is_moved)


def _width(bench: Bench) -> float:
    """Return the factor by which the piston goes farther than the configured plant does."""
    shown = bench.run(bench.machine({}), bench.cuts())
    ways = [
        (np.abs(np.diff(record[:, 0])).sum(), np.abs(np.diff(model[:, 0])).sum())
        for record, model in zip(map(bench.measured, bench.course.strokes), shown, strict=True)
    ]
    record, model = np.array(ways).sum(axis=0)
    return float(np.clip(record / max(model, 1e-9), 0.05, 20.0))


def _judge(
    bench: Bench, title: str, fit: Fit, folds: Sequence[Sequence[int]], *, is_kept: bool
) -> Rung:
    """Return a model with the errors of strokes that were left out of its fit."""
    count = len(bench.course.strokes)
    scores: list[list[float]] = [[] for _ in range(count)]
    errors: list[list[StrokeError]] = [[] for _ in range(count)]
    for fold in folds:
        if bench.clock.is_over:
            return Rung(title, fit, np.array([]), (), is_kept)
        rest = bench.some([place for place in range(count) if place not in set(fold)])
        again = search(rest, fit.unknowns, fit.variables, 4)
        left = bench.some(list(fold))
        shown = left.run(left.machine(again.values), left.cuts())
        for place, stroke, model in zip(fold, left.course.strokes, shown, strict=True):
            record = np.where(left.counts(stroke), left.measured(stroke), np.nan)
            squares = np.square((model - record) / bench.scale)
            scores[place].append(min(float(np.nanmean(squares)), _MOST))
            errors[place].append(measure_errors(model, record, bench.course.record.interval))
    if not folds:
        return Rung(title, fit, np.array([]), (), is_kept)
    means = np.array([float(np.mean(each)) for each in scores])
    # The first prediction of a stroke is that of another amplitude, which is the harder one.
    return Rung(title, fit, means, tuple(each[0] for each in errors), is_kept)


def _groups(bench: Bench, wish: Wish) -> dict[str, tuple[str, ...]]:
    """Return the groups that make sense for this machine and record."""
    groups = dict(GROUPS)
    options = bench.template.axis.options
    if options.supply is not None:
        del groups["supply that droops"], groups["supply and tank pressure"]
        keys = [key for key in _UNIT if bench.template.start(key) > 0.0]
        groups["supply unit"] = (*keys, "tank_pressure_bar")
        if bench.template.settings["supply"].value not in set(Supply):
            del groups["supply unit"]
    if options.bristles is not None:
        groups["friction each way, stiction"] = ("load_n", STICTION)
    sessions = range(1, bench.template.sessions)
    groups["flow of each recording"] = tuple(f"{FLOW}:{number}" for number in sessions)
    kept = {
        title: tuple(
            name
            for name in group
            if name not in wish.fix and name.partition(":")[0] not in wish.fix
        )
        for title, group in groups.items()
    }
    return {title: group for title, group in kept.items() if group}


def _describe(bench: Bench, fit: Fit) -> str:
    every = np.concatenate(bench.deviations(fit.values))
    x, *pressures = np.sqrt(np.nanmean(np.square(every[:, np.isfinite(every).any(axis=0)]), axis=0))
    worst = max(pressures) if pressures else math.nan
    return f"position {1e3 * x:.2g} mm, pressure {1e-5 * worst:.2g} bar rms"
