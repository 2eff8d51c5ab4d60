"""The judgement on a requirement: four outcomes, with margin, time and place."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

from hil_bench.abilities.scenario.coverage import Coverage
from hil_bench.abilities.scenario.examination import Examination
from hil_bench.abilities.scenario.explain import Cause
from hil_bench.abilities.scenario.nodes import Comparison, Condition
from hil_bench.abilities.scenario.reach import Asks, asks_for
from hil_bench.abilities.scenario.sliding import Floats
from hil_bench.abilities.scenario.values import build_values
from hil_bench.abilities.scenario.wording import (
    show_atom,
    show_comparison,
    show_fact,
    show_margin,
    show_reading,
    unit_of,
)


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
    requirement: Condition,
    columns: Mapping[str, Floats],
    *,
    ticks: int,
    tick_ns: int,
    planned: int | None = None,
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
        outcome = RequirementOutcome.NOT_EXERCISED if 0 in times else RequirementOutcome.PASSED
        reason = "its trigger never became true" if 0 in times else examination.idle_wait()
        return Judgement(outcome, size, coverage, deciding, triggered=triggered, reason=reason)
    found = monitor.violation
    first = found.first if found else cause.tick
    begin, duration = first * tick_ns / 1e9, examination.violated * tick_ns / 1e9
    outcome = RequirementOutcome.FAILED
    return Judgement(outcome, size, coverage, deciding, begin, duration, triggered)


def _describe(cause: Cause, margin: float, examination: Examination, tick_ns: int) -> Deciding:
    time, node = cause.tick * tick_ns / 1e9, cause.node
    is_right = cause.is_true == examination.monitor.is_met
    condition = show_atom(node) if is_right else f"not {show_atom(node)}"
    if not isinstance(node, Comparison):
        return Deciding(time, condition, "", "", show_fact(node, is_true=cause.is_true))
    left, right = (
        float(build_values(side, tick_ns)(examination.values)[cause.tick])
        for side in (node.left, node.right)
    )
    reading = show_reading(left, left - right, unit_of(node.dimension, node.symbol))
    fact = show_comparison(node, left, right)
    return Deciding(time, condition, reading, show_margin(margin, node), fact)
