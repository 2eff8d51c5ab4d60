"""Two records of one machine: what has changed between them, in an engineer's words.

The machine of the first record is identified. What it misses there in like strokes it misses in the
second record, too, so that is taken off before both are held beside each other: what remains is a
change, of what differs from day to day or of more.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from time import monotonic
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.fit import Bench, Clock, Fit, Problem, search
from hil_bench.abilities.identification.identify import Options, make_coarse
from hil_bench.abilities.identification.ladder import climb
from hil_bench.abilities.identification.machine import Unknown
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.strokes import Stroke
from hil_bench.config.settings import Settings
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig

Values = npt.NDArray[np.float64]

_BLUR = 0.012  # [s]
_ROUNDS, _EXACT = 10, 3e-4  # of a search at most; share of the cost that its last step lowers
_LIKE, _STEADY = 0.03, 0.01  # of the full opening: among like strokes, of a set-point at rest
_LOOKED_AT = 5  # causes that fit best, roughly
_NEAR, _MOSTLY = 0.85, 0.5  # of the best: as likely; of the difference, which a cause explains
_DAILY = 0.25  # of the least change that is named: standard deviation from day to day
_SEEN = 12.0  # by which a cause lowers twice the negative log likelihood, or it is chance
_OPEN, _WORSE = 1.5, 3.0  # times the residual before: undecided, a change, although none is found


class Cause(NamedTuple):
    """Something that may change.

    Attributes:
        name: of the unknown.
        least: change that is named, in the unit of the unknown.
        share: the same, as a share of the value before.
        up: said where it has grown; empty where it cannot.
        down: said where it has shrunk.
        is_daily: whether it differs from day to day, by a quarter of the least (one deviation).
    """

    name: str
    least: float
    share: float
    up: str
    down: str
    is_daily: bool = False


_LESS, _MORE = "less leakage", "leakage from"
_SENSOR_A, _SENSOR_B = "the sensor of P_A reads", "the sensor of P_B reads"
_HIGHER, _LOWER = "higher supply pressure", "lower supply pressure"
CAUSES = (
    Cause("internal_leakage_l_min_bar", 1e-3, 0.4, "leakage across the piston", _LESS, True),
    Cause("external_leakage_a_l_min_bar", 1e-3, 0.4, f"{_MORE} A to the tank", _LESS),
    Cause("external_leakage_b_l_min_bar", 1e-3, 0.4, f"{_MORE} B to the tank", _LESS),
    Cause("null_opening_um", 4.0, 0.0, "worn edges of the spool", "sharper edges"),
    Cause("land_overlap_pa_mm", 4e-3, 0.0, "", "worn edge P-A of the spool"),
    Cause("land_overlap_at_mm", 4e-3, 0.0, "", "worn edge A-T of the spool"),
    Cause("land_overlap_pb_mm", 4e-3, 0.0, "", "worn edge P-B of the spool"),
    Cause("land_overlap_bt_mm", 4e-3, 0.0, "", "worn edge B-T of the spool"),
    Cause("entrained_air_percent", 0.4, 0.0, "air trapped in the oil", "less air", True),
    Cause("coulomb_friction_n", 0.0, 0.2, "more friction", "less friction", True),
    Cause("viscous_friction_n_s_m", 0.0, 0.4, "more friction", "less friction", True),
    Cause("supply_pressure_bar", 0.0, 0.02, _HIGHER, _LOWER, True),
    Cause("relief_pressure_bar", 0.0, 0.02, _HIGHER, _LOWER, True),
    Cause("orifice_width_mm", 0.0, 0.02, "the valve passes more", "the valve passes less", True),
    Cause("offset_a", 0.4, 0.0, f"{_SENSOR_A} more", f"{_SENSOR_A} less", True),
    Cause("offset_b", 0.4, 0.0, f"{_SENSOR_B} more", f"{_SENSOR_B} less", True),
)


class Change(NamedTuple):
    """A cause that explains what differs.

    Attributes:
        words: in an engineer's words.
        name: of the unknown.
        before: its value, in its unit.
        after: likewise.
        explains: share of what differs.
    """

    words: str
    name: str
    before: float
    after: float
    explains: float


class Comparison(NamedTuple):
    """Two records beside each other.

    Attributes:
        worse: residual of the machine of the first record on the second, times that on the first.
        changes: the causes, the likeliest first; empty where nothing has changed or is explained.
        tried: what each of the likeliest causes alone would have to have changed.
        seen: how many of the later strokes were compared, in words; empty for all.
    """

    worse: float
    changes: tuple[Change, ...]
    tried: tuple[Change, ...]
    seen: str = ""

    @property
    def is_changed(self) -> bool | None:
        """True if the second record differs; None where that is open."""
        return bool(self.changes) or self.worse > _WORSE or (None if self.worse > _OPEN else False)


def compare(
    before: AxisRecord,
    after: AxisRecord,
    axis: CylinderConfig,
    settings: Settings,
    options: Options,
) -> Comparison:
    """Compare two records of a machine by the causes that would explain the difference.

    Args:
        before: the record that the machine is taken from.
        after: the other one.
        axis: the machine, as identified from the first or a like one.
        settings: of the axis.
        options: how.

    Raises:
        ConfigError: the time was over before all causes were tried, or no strokes are alike.
    """
    clock = Clock(monotonic() + options.seconds, options.tick)
    first, second = (
        make_coarse(record, axis, settings, options.jobs, clock) for record in (before, after)
    )
    options.say("the machine before")
    ladder = climb(first, options.wish, options.say, is_judged=False)
    held = ladder.best.fit.values
    _require_time(clock)
    first = _with(first, held)
    second = _with(second, _shared(held, len(after.sessions)))
    missed = first.deviations({})
    alike = find_alike(second, first)
    if not any(alike):
        raise ConfigError("no stroke of the later recordings is like one of the earlier ones")
    others = [
        [each for each in like if each != place]
        for place, like in enumerate(find_alike(first, first))
    ]
    second = _corrected(second, first, missed, alike)
    if any(others):  # or else a model's misfit is as sharp as it can be looked at
        first = _corrected(first, first, missed, others)
    first = first.rescaled({})
    second = replace(second, scale=first.scale)
    found = _explain(first, second, options)
    _require_time(clock)
    seen = "" if all(alike) else f", in {sum(map(bool, alike))} of {len(alike)} strokes"
    return found._replace(seen=seen)


def _with(bench: Bench, values: Mapping[str, float]) -> Bench:
    template = replace(bench.template, held=values)
    return replace(bench, template=template, blur=_BLUR)


def _explain(first: Bench, second: Bench, options: Options) -> Comparison:
    """Name the causes that explain what differs between two corrected records."""
    causes = _possible(second, options)
    daily = [one for each in causes if each.is_daily for one in _unknowns(second, each, _DAILY)]
    rough = second.rescaled({})  # as large as the difference is: far off, slopes are poor

    def seek(wide: Sequence[Unknown], near: Mapping[str, float]) -> Fit:
        names = {one.name for one in wide}
        unknowns = [*wide, *(one for one in daily if one.name not in names)]
        begin = np.array([near.get(one.name, one.start) for one in unknowns])
        return search(rough, unknowns, begin, _ROUNDS)

    options.say("from day to day")
    usual = seek((), {})
    usual = search(second, usual.unknowns, usual.variables, _ROUNDS, _EXACT)
    there = {one.name: value for one, value in zip(usual.unknowns, usual.variables, strict=True)}
    alone = []
    for cause in causes:
        options.say(cause.up or cause.down)  # a large change of what differs daily is there already
        alone.append((cause, seek(_unknowns(second, cause), there if cause.is_daily else {})))
    problems = Problem(first, ()), Problem(second, ())
    rows = [sum(each.lengths) for each in problems]
    base = 0.5 * float(np.square(problems[0].residuals(np.array([]))).sum()) * rows[1] / rows[0]
    excess = usual.cost - base
    tried, named = [], []
    for cause, fit in sorted(alone, key=lambda one: one[1].cost)[:_LOOKED_AT]:
        found = search(second, fit.unknowns, fit.variables, _ROUNDS, _EXACT)
        names = _names(second, cause.name)
        start = second.template.start(names[0])
        value = float(np.mean([found.values[name] for name in names]))
        lowered = usual.cost - found.cost
        explains = max(lowered, 0.0) / max(excess, lowered, 1e-300)
        words = cause.up if value > start else cause.down
        tried.append(Change(words, cause.name, start, value, explains))
        is_seen = 2.0 * lowered > _SEEN * problems[1].doubt ** 2
        if is_seen and abs(value - start) > _least(cause, start):
            named.append((lowered, tried[-1]))
    likely = find_likely(named, excess)
    return Comparison(math.sqrt(usual.cost / base), likely, tuple(tried))


def find_likely(named: Sequence[tuple[float, Change]], excess: float) -> tuple[Change, ...]:
    """Return the changes that lower the cost about as much as the best one does, the best first.

    Their share of the difference ends at all of it, and so does not say which of two is likelier.

    Args:
        named: changes, each with the cost that it lowers.
        excess: cost beyond what like strokes of the first record have; without any no change is
            likely, as there is nothing to explain.
    """
    ranked = sorted(named, key=lambda one: -one[0]) if excess > 0.0 else []
    return tuple(change for lowered, change in ranked if lowered > _NEAR * ranked[0][0])


def _require_time(clock: Clock) -> None:
    """Refuse a comparison that did not come to its end.

    Raises:
        ConfigError: it did not.
    """
    if clock.is_over:
        raise ConfigError("the time was over before the comparison; give a longer --time-limit")


def _names(bench: Bench, name: str) -> list[str]:
    """Return the unknowns of a cause: of a sensor, its offset in each recording that has it."""
    if not name.startswith("offset_"):
        return [name]
    place = 1 + "ab".index(name[-1])
    sessions = enumerate(bench.course.record.sessions)
    return [f"{name}:{number}" for number, session in sessions if session.has[place]]


def _unknowns(bench: Bench, cause: Cause, share: float = 0.0) -> list[Unknown]:
    """Return the unknowns of a cause, expected to differ by a share of its least, or by any."""
    unknowns = [bench.template.unknown(name) for name in _names(bench, cause.name)]
    if not cause.up:
        unknowns = [one._replace(high=one.start) for one in unknowns]
    if not share:
        return unknowns
    spreads = [
        share * _least(cause, one.value(one.start)) / abs(one.slope(one.start)) for one in unknowns
    ]
    return [
        one._replace(spread=max(each, 1e-4)) for one, each in zip(unknowns, spreads, strict=True)
    ]


def _least(cause: Cause, value: float) -> float:
    return max(cause.least, cause.share * abs(value)) or 1e-9


def _shared(held: Mapping[str, float], sessions: int) -> dict[str, float]:
    """Return values for other recordings: a sensor has the mean of its offsets in each of them."""
    shared = {name: value for name, value in held.items() if not name.startswith("offset_")}
    for side in ("offset_x", "offset_a", "offset_b"):
        if found := [value for name, value in held.items() if name.startswith(side)]:
            shared |= {f"{side}:{number}": float(np.mean(found)) for number in range(sessions)}
    return shared


def find_alike(bench: Bench, other: Bench) -> list[list[int]]:
    """Return the places of the strokes of another bench that are like each of a bench."""
    kinds, others = (
        [(one.is_forth, one.opening, len(find_changes(each, one))) for one in each.course.strokes]
        for each in (bench, other)
    )
    return [
        [
            place
            for place, (is_forth, opening, count) in enumerate(others)
            if (is_forth, count) == (kind[0], kind[2]) and abs(opening - kind[1]) < _LIKE
        ]
        for kind in kinds
    ]


def find_changes(bench: Bench, stroke: Stroke) -> list[float]:
    """Return the times at which the set-point of a stroke changes, in rows, that before it first.

    A row has the mean set-point since the one before, which shows when in between a step was.
    """
    record = bench.course.record
    u = record.setpoints[stroke.rows.start : stroke.rows.stop] / record.full_opening
    moves = np.abs(np.diff(u, prepend=u[0])) > _STEADY
    times = [-2.0]
    for row in (np.flatnonzero(moves[1:] & ~moves[:-1]) + 1).tolist():
        way = u[min(row + 1, len(u) - 1)] - u[row - 1]
        share = (u[row] - u[row - 1]) / way if way else 1.0
        times.append(row - 1 - min(max(float(share), 0.0), 1.0))
    return times


def _corrected(
    bench: Bench, other: Bench, missed: Sequence[Values], alike: Sequence[Sequence[int]]
) -> Bench:
    """Return a bench whose record has what a model misses in like strokes added.

    Args:
        bench: plant and record; strokes with no like one are left out.
        other: the bench of what is missed.
        missed: model less record in each stroke of it.
        alike: places of these strokes that are like each of the bench.
    """
    measured = bench.course.record.measured.copy()
    for stroke, like in zip(bench.course.strokes, alike, strict=True):
        to, rows = find_changes(bench, stroke), len(stroke.rows) - 1
        parts = [
            _moved(missed[place], find_changes(other, other.course.strokes[place]), to, rows)
            for place in like
        ]
        if parts:
            measured[stroke.rows.start + 1 : stroke.rows.stop] += np.mean(parts, axis=0)
    record = replace(bench.course.record, measured=measured)
    bench = replace(bench, course=replace(bench.course, record=record))
    return bench.some([place for place, like in enumerate(alike) if like])


def _moved(values: Values, at: Sequence[float], to: Sequence[float], rows: int) -> Values:
    """Return rows of a stroke in the times since the set-point last changed of another one."""
    place = np.arange(rows)
    part = np.searchsorted(to, place, side="right") - 1
    last = np.floor([*at[1:], len(values) - 1.0])
    source = np.minimum(np.array(at)[part] + place - np.array(to)[part], last[part])
    there = np.nan_to_num(values)
    return np.stack([np.interp(source, np.arange(len(there)), one) for one in there.T], axis=1)


def _possible(bench: Bench, options: Options) -> list[Cause]:
    """Return the causes that this machine and record can have."""
    template = bench.template
    lacking = {one.name for one in CAUSES if not _names(bench, one.name)} | options.wish.fix
    is_stiff = template.axis.options.supply is None
    lacking.add("relief_pressure_bar" if is_stiff else "supply_pressure_bar")
    return [one for one in CAUSES if one.name not in lacking]


def describe(found: Comparison) -> list[str]:
    """Return a comparison as people read it."""
    if found.is_changed is None:
        return [f"undecided: it fits {found.worse:.2f} times worse, and no known cause explains it"]
    if not found.is_changed:
        return [f"nothing has changed: it fits as before ({found.worse:.2f} times){found.seen}"]
    lines = [f"the machine has changed: it fits {found.worse:.2f} times worse than before"]
    lines += [
        f"  {one.words}: {one.name} from {one.before:.4g} to {one.after:.4g}, "
        f"explains {one.explains:.0%} of the difference"
        for one in found.changes
    ]
    if not found.changes:
        lines.append("  no single cause that is known explains it")
    elif max(one.explains for one in found.changes) < _MOSTLY:
        lines.append("  most of it stays: more has changed than that, or the machine is another")
    return lines


def to_json(found: Comparison) -> dict[str, Any]:
    """Return a comparison for programs."""
    return {
        "is_changed": found.is_changed,
        "times_worse": found.worse,
        "changes": [one._asdict() for one in found.changes],
        "tried": [one._asdict() for one in found.tried],
        "seen": found.seen.removeprefix(", "),
    }
