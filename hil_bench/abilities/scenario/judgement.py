"""The judgement on a requirement: four outcomes, with margin, time, place, words and evidence."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

from hil_bench.abilities.scenario import nodes
from hil_bench.abilities.scenario.dimensions import UNITS, Dimension, find_unit
from hil_bench.abilities.scenario.examination import Cause, Coverage, Examination
from hil_bench.abilities.scenario.reach import CERTAIN, Asks, asks_for, is_certain
from hil_bench.abilities.scenario.values import Floats, build_values
from hil_bench.bench.virtual_bench import FrameReader
from hil_bench.outside.recording.channels import LoggedFrame, Recording, Span
from hil_bench.units import ONE, Unit

# Values, conditions and their readings as a person reads them.

_TURNED: Final = {
    (nodes.Turn.RISES, True): "rose",
    (nodes.Turn.RISES, False): "did not rise",
    (nodes.Turn.FALLS, True): "fell",
    (nodes.Turn.FALLS, False): "did not fall",
    (nodes.Turn.CHANGES, True): "changed",
    (nodes.Turn.CHANGES, False): "did not change",
}
_MOST_DIGITS = 12
_NOTHING = 1e-300  # equal sides differ by the smallest double, so that the sign is kept
_USUAL = ("bar", "mm", "mm/s", "s", "N", "bar/s", "l/min")


def unit_of(dimension: Dimension, symbol: str) -> Unit:
    """Return the unit in which to show a value: the one that the text gives, or a usual one."""
    found = find_unit(symbol) if symbol else None
    if found is not None and found.dimension == dimension:
        return found.unit
    for usual in _USUAL:
        if UNITS[usual].dimension == dimension:
            return UNITS[usual].unit
    return next((each.unit for each in UNITS.values() if each.dimension == dimension), ONE)


def show_number(value: float, unit: Unit) -> str:
    """Return an SI value in a unit, in six digits."""
    return _with_unit(unit.from_si(value), 6, unit)


def show_reading(value: float, apart: float, unit: Unit) -> str:
    """Return an SI value in a unit: four digits, and more where it is close to something.

    Args:
        value: the value.
        apart: how far it is from what it is close to.
        unit: in which to show it.
    """
    is_close = value and apart and math.isfinite(apart)
    more = math.log10(abs(value)) - math.log10(abs(apart)) if is_close else 0.0
    digits = min(_MOST_DIGITS, 4 + max(0, math.floor(more)))
    return _with_unit(unit.from_si(value), digits, unit)


def show_gap(value: float, unit: Unit) -> str:
    """Return an SI difference in a unit, in four digits; of equal sides a zero with its sign."""
    value = value if abs(value) >= _NOTHING else math.copysign(0.0, value)
    return _with_unit(unit.from_si(value), 4, unit)


def _with_unit(value: float, digits: int, unit: Unit) -> str:
    """Return a number with its unit; without an exponent where that is short."""
    symbol = f" {unit.symbol}" if unit is not ONE else ""
    if not 1e-4 <= abs(value) < 1e9:
        return f"{value:.{digits}g}{symbol}"
    places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    text = f"{value:.{places}f}"
    return f"{text.rstrip('0').rstrip('.') if places else text}{symbol}"


def show_value(node: nodes.Value, unit: Unit = ONE) -> str:
    """Return a value in the words of the language; its constants in a unit."""
    match node:
        case nodes.Number():
            return show_number(node.value, unit)
        case nodes.Reading():
            return node.name
        case nodes.Magnitude():
            return f"abs({_bare(show_value(node.operand, unit))})"
        case nodes.Rate():
            return f"rate({show_value(node.operand)})"
        case nodes.PreviousValue():
            return f"previous({show_value(node.operand, unit)})"
        case nodes.Arithmetic():
            inner = unit if node.operation in "+-" else ONE
            left, right = show_value(node.left, inner), show_value(node.right, inner)
            return f"({left} {node.operation} {right})"


def show_atom(node: nodes.Atom) -> str:
    """Return a condition without parts in the words of the language."""
    match node:
        case nodes.Comparison():
            unit = unit_of(node.dimension, node.symbol)
            left, right = (_bare(show_value(side, unit)) for side in (node.left, node.right))
            return f"{left} {node.relation} {right}"
        case nodes.StateIs():
            return f'{node.name} == "{node.text}"'
        case nodes.Event():
            return node.name
        case nodes.Edge():
            return f"{node.turn}({show_value(node.operand)})"
        case nodes.ConditionEdge():
            return f"{node.turn}(...)"


def show_fact(node: nodes.Atom, *, is_true: bool) -> str:
    """Return in words that a state, an event or an edge is there, or is not."""
    match node:
        case nodes.StateIs():
            return f"{node.name} was {'' if is_true else 'not '}{node.text}"
        case nodes.Edge():
            return f"{show_value(node.operand)} {_TURNED[node.turn, is_true]}"
        case _:
            return f"{show_atom(node)} was {'' if is_true else 'not '}seen"


def show_comparison(node: nodes.Comparison, left: float, right: float) -> str:
    """Return in words how both sides of a comparison stood [SI]."""
    unit = unit_of(node.dimension, node.symbol)
    sides = [(node.left, left), (node.right, right)]
    if isinstance(node.left, nodes.Number):
        sides.reverse()
    (subject, value), (limit, bound) = sides
    apart = value - bound
    name, text = _bare(show_value(subject, unit)), _bare(show_value(limit, unit))
    if not isinstance(limit, nodes.Number):
        text += f" ({show_reading(bound, apart, unit)})"
    if not apart:
        return f"{name} was exactly {text}"
    reading = show_reading(value, apart, unit)
    if not math.isfinite(apart):
        return f"{name} was {reading}"
    where = "below" if apart < 0.0 else "above"
    return f"{name} was {reading}, {show_gap(abs(apart), unit)} {where} {text}"


def _bare(text: str) -> str:
    """Return a sum or a product without the brackets around it."""
    return text[1:-1] if text.startswith("(") else text


def show_margin(margin: float, node: nodes.Atom) -> str:
    """Return a margin in the unit of the comparison that decides; empty where it has no size."""
    if not isinstance(node, nodes.Comparison) or not math.isfinite(margin):
        return ""
    return show_gap(margin * node.scale, unit_of(node.dimension, node.symbol))


EQUAL: Final = 1e-300
"""A margin below is that of equal sides, whose relation has a sign but no size."""


def show_share(margin: float, digits: int = 2) -> str:
    """Return a margin as a share of the tolerance; +0 or -0 where both sides are equal."""
    shown = math.copysign(0.0, margin) if abs(margin) < EQUAL else margin
    return f"{shown:+.{digits}g}"


def show_seen(share: float) -> str:
    """Return the share of a time that was seen in percent; 100 % is all of it and nothing less."""
    return f"{100.0 * share if share == 1.0 else min(100.0 * share, 99.9):.3g} %"


# The judgement on a requirement: four outcomes, with margin, time and place.


class RequirementOutcome(StrEnum):
    """The outcome of a requirement."""

    PASSED = "passed"
    FAILED = "failed"
    INCONCLUSIVE = "inconclusive"
    NOT_EXERCISED = "not exercised"


WORST_FIRST: Final = (
    RequirementOutcome.FAILED,
    RequirementOutcome.INCONCLUSIVE,
    RequirementOutcome.NOT_EXERCISED,
    RequirementOutcome.PASSED,
)


_FIRST: Final = "asks about the first tick alone; always asks about each"

_RANKS: Final = {
    (True, Asks.ALL): "closest",
    (False, Asks.ALL): "worst",
    (True, Asks.ANY): "best",
    (False, Asks.ANY): "closest",
    (True, Asks.NEITHER): "",
    (False, Asks.NEITHER): "",
}


@dataclass(frozen=True, slots=True)
class Deciding:
    """The comparison that decides, at the tick where it is closest or worst.

    Attributes:
        time: [s], from the first tick of the run.
        condition: what had to be true then, in the words of the language.
        reading: the value of its left side, with a unit; empty where it compares nothing.
        margin: in the same unit; empty where it has no size.
        fact: what was true then, in words.
        rank: how it stands among all ticks: "closest" to the other outcome, "worst" of a
            requirement that does not hold, "best" of one that asks for a single tick; else empty.
    """

    time: float
    condition: str
    reading: str
    margin: str
    fact: str
    rank: str = ""


@dataclass(frozen=True, slots=True)
class Judgement:
    """The judgement of a run on a requirement.

    Attributes:
        outcome: one of four.
        margin: how far the outcome is from another, as a share of the tolerance; positive where
            the requirement holds; None where it is unknown or has no size.
        deciding: the comparison that decides; None for an inconclusive outcome.
        first: when it is violated first [s]; None where it is not.
        duration: for how long it was seen violated in all [s]; 0 where its violations are instants.
        triggered: how often the triggers of its implications became true; None without any.
        reason: why it is not decided, or why a passed one says little; else empty.
        coverage: how much of its time was seen.
    """

    outcome: RequirementOutcome
    margin: float | None
    coverage: Coverage
    deciding: Deciding | None = None
    first: float | None = None
    duration: float = 0.0
    triggered: int | None = None
    reason: str = ""


def judge(
    requirement: nodes.Condition,
    columns: Mapping[str, Floats],
    *,
    ticks: int,
    tick_ns: int,
    planned: int | None = None,
    idle: Sequence[str] = (),
    remarks: Sequence[str] = (),
) -> Judgement:
    """Judge a requirement by a run.

    Args:
        requirement: the condition.
        columns: the values of each signal that it names, shape (ticks,); NaN or infinite where
            unknown.
        ticks: how many were seen; 0 leaves every requirement undecided.
        tick_ns: time between two [ns].
        planned: how many the run has; those behind the ones seen are unknown. None for a run that
            ends with what was seen.
        idle: what of the run has done nothing, in words: what holds beside it says nothing.
        remarks: what else belongs beside a pass, in words.
    """
    examination = Examination(requirement, columns, ticks, tick_ns, planned)
    monitor, coverage = examination.monitor, examination.view.coverage
    times = [exercise.times for exercise in monitor.exercises]
    triggered = sum(times) if times else None
    if not (monitor.is_failed or monitor.is_met):
        reason = "; ".join(examination.view.gaps()) or "the run ends before it is decided"
        return Judgement(
            RequirementOutcome.INCONCLUSIVE, None, coverage, triggered=triggered, reason=reason
        )
    low, high = monitor.margin
    margin = high if monitor.is_failed else low
    cause = examination.find_cause()
    deciding = _describe(cause, margin, examination, tick_ns)
    size = margin if math.isfinite(margin) else None
    if size is not None:
        deciding = replace(deciding, rank=_RANKS[monitor.is_met, asks_for(requirement)])
    if monitor.is_met:
        lacks = list(idle)
        where = " where it was seen" if coverage.unknown else ""
        lacks += [f"its trigger never became true{where}"] * (0 in times)
        outcome = RequirementOutcome.NOT_EXERCISED if lacks else RequirementOutcome.PASSED
        doubts = [*remarks, *[CERTAIN] * is_certain(requirement)]
        doubts += [_FIRST] * (coverage.end == 0.0 and ticks > 1)
        doubts = lacks or doubts or [examination.idle_wait() or examination.stillness()]
        reason = "; ".join(doubts)
        return Judgement(outcome, size, coverage, deciding, triggered=triggered, reason=reason)
    found, duration = examination.first_violated, examination.violated_time
    begin = (cause.tick if found is None else found) * tick_ns / 1e9
    outcome = RequirementOutcome.FAILED
    return Judgement(outcome, size, coverage, deciding, begin, duration, triggered)


def _describe(cause: Cause, margin: float, examination: Examination, tick_ns: int) -> Deciding:
    time, node = cause.tick * tick_ns / 1e9, cause.node
    is_right = cause.is_true == examination.monitor.is_met
    condition = show_atom(node) if is_right else f"not {show_atom(node)}"
    if not isinstance(node, nodes.Comparison):
        return Deciding(time, condition, "", "", show_fact(node, is_true=cause.is_true))
    left, right = (
        float(build_values(side, tick_ns)(examination.values)[cause.tick])
        for side in (node.left, node.right)
    )
    reading = show_reading(left, left - right, unit_of(node.dimension, node.symbol))
    fact = show_comparison(node, left, right)
    return Deciding(time, condition, reading, show_margin(margin, node), fact)


# The evidence of a run for its report: signals, faults and frames.

MOST_FRAMES = 500_000
"""Frames that a run keeps for its report; of more, the latest."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """The evidence of a run.

    Attributes:
        signals: a row a tick; without rows where nothing was recorded.
        columns: the values of all that the requirements name, shape (ticks,).
        ticks: how many.
        tick_ns: time between two [ns].
        faults: when which fault was there.
        frames: oldest first.
        reader: puts them in words.
        planned: how many ticks the run has; None for one that ends with these.
    """

    signals: Recording
    columns: Mapping[str, Floats]
    ticks: int
    tick_ns: int
    faults: tuple[Span, ...] = ()
    frames: Sequence[LoggedFrame] = ()
    reader: FrameReader | None = None
    planned: int | None = None
