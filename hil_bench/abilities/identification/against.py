"""Two records of one machine: what has changed between them, in an engineer's words."""

import math
from collections.abc import Sequence
from dataclasses import replace
from time import monotonic
from typing import Any, NamedTuple

import numpy as np

from hil_bench.abilities.identification.fit import Bench, Clock, search
from hil_bench.abilities.identification.identify import Options
from hil_bench.abilities.identification.ladder import PAPER, begin_of
from hil_bench.abilities.identification.machine import Template
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.strokes import make_course
from hil_bench.config.settings import Settings
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig

_ROWS, _STEP, _BLUR = 4e-3, 1e-3, 0.03  # [s]
_EXACT = 1e-6  # share of the cost by which the last step of a search has lowered it
_WORSE = 1.5  # times the residual before: less is no change
_MOST = 0.5  # share of what differs that one cause must explain
_NEAR = 0.85  # of the best: as likely


class Cause(NamedTuple):
    """A cause that may have changed.

    Attributes:
        name: of the unknown.
        up: said where it has grown.
        down: said where it has shrunk.
        least: change below which nothing is said, in the unit of the unknown.
        share: the same, as a share of the value before.
    """

    name: str
    up: str
    down: str
    least: float = 0.0
    share: float = 0.0


CAUSES = (
    Cause("internal_leakage_l_min_bar", "leakage across the piston", "less leakage", 1e-4),
    Cause("external_leakage_a_l_min_bar", "leakage from A to the tank", "less leakage", 1e-4),
    Cause("external_leakage_b_l_min_bar", "leakage from B to the tank", "less leakage", 1e-4),
    Cause("null_opening_um", "worn edges of the spool", "sharper edges", 2.0),
    Cause("entrained_air_percent", "air trapped in the oil", "less air", 0.3),
    Cause("coulomb_friction_n", "more friction", "less friction", 0.0, 0.08),
    Cause("supply_pressure_bar", "higher supply pressure", "lower supply pressure", 0.0, 0.01),
    Cause("orifice_width_mm", "the valve passes more", "the valve passes less", 0.0, 0.02),
    Cause("offset_a", "the sensor of P_A reads more", "the sensor of P_A reads less", 0.3),
    Cause("offset_b", "the sensor of P_B reads more", "the sensor of P_B reads less", 0.3),
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
        is_changed: whether the second record differs.
    """

    worse: float
    changes: tuple[Change, ...]
    is_changed: bool


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
        options: how; `ConfigError` where its time was over before all causes were tried.
    """
    clock = Clock(monotonic() + options.seconds, options.tick)
    options.say("the machine before")
    first = _bench(before, axis, settings, options, clock)
    adapted = _adapt(first, options)
    _require_time(clock)
    first = replace(first, template=replace(first.template, held=adapted)).rescaled({})
    second = _bench(after, axis, settings, options, clock)
    held = _shared(adapted, len(after.sessions))
    second = replace(second, scale=first.scale, template=replace(second.template, held=held))
    base, now = _misfit(first, {}), _misfit(second, {})
    worse = math.sqrt(now / base)
    if worse < _WORSE:
        return Comparison(worse, (), is_changed=False)
    changes = []
    for cause in _possible(second, options):
        options.say(cause.up)
        names = _names(second, cause.name)
        pairs = [begin_of(second, name, dict(held)) for name in names]
        begin = np.array([each for _, each in pairs])
        found = search(second, [one for one, _ in pairs], begin, 20, _EXACT).values
        explains = (now - _misfit(second, found)) / max(now - base, 1e-300)
        value = float(np.mean([found[name] for name in names]))
        start = second.template.start(names[0])
        if abs(value - start) < max(cause.least, cause.share * abs(start)) or explains < _MOST:
            continue
        words = cause.up if value > start else cause.down
        changes.append(Change(words, cause.name, start, value, min(explains, 1.0)))
    _require_time(clock)
    changes.sort(key=lambda one: -one.explains)
    likely = [one for one in changes if one.explains > _NEAR * changes[0].explains]
    return Comparison(worse, tuple(likely), is_changed=True)


def _require_time(clock: Clock) -> None:
    """Refuse a comparison that did not come to its end.

    Raises:
        ConfigError: it did not.
    """
    if clock.is_over:
        raise ConfigError("the time was over before the comparison; give a longer --time-limit")


def _bench(
    record: AxisRecord, axis: CylinderConfig, settings: Settings, options: Options, clock: Clock
) -> Bench:
    template = Template(axis, settings, len(record.sessions))
    course = make_course(record, _ROWS)
    return Bench(template, course, _STEP, jobs=options.jobs, clock=clock, blur=_BLUR)


def _adapt(bench: Bench, options: Options) -> dict[str, float]:
    """Return the values of the machine that fit the first record best, from where they are."""
    names = [*PAPER, "supply_pressure_bar", *_names(bench, "offset_a"), *_names(bench, "offset_b")]
    names = [name for name in names if name not in options.wish.fix]
    bench = bench.rescaled({})
    pairs = [begin_of(bench, name, {}) for name in names]
    begin = np.array([each for _, each in pairs])
    return search(bench, [one for one, _ in pairs], begin, 20, _EXACT).values


def _names(bench: Bench, name: str) -> list[str]:
    """Return the unknowns of a cause: of a sensor, its offset in each recording that has it."""
    if not name.startswith("offset_"):
        return [name]
    place = 1 + "ab".index(name[-1])
    sessions = enumerate(bench.course.record.sessions)
    return [f"{name}:{number}" for number, session in sessions if session.has[place]]


def _shared(held: dict[str, float], sessions: int) -> dict[str, float]:
    """Return values for other recordings: a sensor has the mean of its offsets in each of them."""
    shared = {name: value for name, value in held.items() if not name.startswith("offset_")}
    for side in ("offset_a", "offset_b"):
        found = [value for name, value in held.items() if name.startswith(side)]
        if found:
            shared |= {f"{side}:{number}": float(np.mean(found)) for number in range(sessions)}
    return shared


def _misfit(bench: Bench, values: dict[str, float]) -> float:
    """Return the mean square of the residuals over their scales, averaged over `_BLUR`."""
    from scipy.ndimage import uniform_filter1d  # noqa: PLC0415 - an extra

    rows = max(1, round(_BLUR / bench.course.record.interval))
    parts = []
    for off in bench.deviations(values):
        means = uniform_filter1d(np.nan_to_num(off) / bench.scale, rows, axis=0)
        parts.append(np.square(means)[np.isfinite(off)])
    return float(np.concatenate(parts).mean())


def _possible(bench: Bench, options: Options) -> Sequence[Cause]:
    """Return the causes that this machine and record can have."""
    lacking = {one.name for one in CAUSES if not _names(bench, one.name)}
    if bench.template.axis.options.supply is not None:
        lacking.add("supply_pressure_bar")
    return [one for one in CAUSES if one.name not in lacking | options.wish.fix]


def describe(found: Comparison) -> list[str]:
    """Return a comparison as people read it."""
    if not found.is_changed:
        return [f"nothing has changed: the machine fits as before ({found.worse:.2f} times)"]
    lines = [f"the machine has changed: it fits {found.worse:.2f} times worse than before"]
    lines += [
        f"  {one.words}: {one.name} from {one.before:.4g} to {one.after:.4g}, "
        f"explains {one.explains:.0%} of the difference"
        for one in found.changes
    ]
    if not found.changes:
        lines.append("  no single cause that is known explains it")
    return lines


def to_json(found: Comparison) -> dict[str, Any]:
    """Return a comparison for programs."""
    return {
        "is_changed": found.is_changed,
        "times_worse": found.worse,
        "changes": [one._asdict() for one in found.changes],
    }
