"""The judgement on a requirement: four outcomes, with margin, time and place."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from hil_bench.scenario.examination import Examination
from hil_bench.scenario.explain import Cause
from hil_bench.scenario.nodes import Comparison, Condition
from hil_bench.scenario.sliding import Floats
from hil_bench.scenario.values import Block, build_values
from hil_bench.scenario.wording import show_atom, show_margin, show_number, unit_of


class RequirementOutcome(StrEnum):
    """What became of a requirement."""

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


@dataclass(frozen=True, slots=True)
class Deciding:
    """The comparison that decides, at the tick where it is closest or worst.

    Attributes:
        time: [s], from the first tick of the run.
        condition: in the words of the language.
        reading: the value of its left side, with a unit; empty where it compares nothing.
        margin: in the same unit; empty where it has no size.
    """

    time: float
    condition: str
    reading: str
    margin: str


@dataclass(frozen=True, slots=True)
class Judgement:
    """What a run says of a requirement.

    Attributes:
        outcome: one of four.
        margin: how far the outcome is from another, as a share of the tolerance; positive where
            the requirement holds; None where it is unknown or has no size.
        deciding: the comparison that decides; None for an inconclusive outcome.
        first: when it is violated first [s]; None where it is not.
        duration: for how long it is violated in all [s]; 0 where it does not speak of each tick.
        triggered: how often the triggers of its implications became true; None without any.
        reason: why it is not decided; empty where it is.
    """

    outcome: RequirementOutcome
    margin: float | None
    deciding: Deciding | None = None
    first: float | None = None
    duration: float = 0.0
    triggered: int | None = None
    reason: str = ""


def judge(
    requirement: Condition, columns: Mapping[str, Floats], *, ticks: int, tick_ns: int
) -> Judgement:
    """Return what a whole run says of a requirement.

    Args:
        requirement: the condition.
        columns: the values of each signal that it names, shape (ticks,); NaN where unknown.
        ticks: how many; 0 leaves every requirement undecided.
        tick_ns: time between two [ns].
    """
    examination = Examination(requirement, columns, ticks, tick_ns)
    monitor = examination.monitor
    times = [exercise.times for exercise in monitor.exercises]
    triggered = sum(times) if times else None
    if not (monitor.is_failed or monitor.is_met):
        reason = _why_open(columns, ticks)
        return Judgement(RequirementOutcome.INCONCLUSIVE, None, triggered=triggered, reason=reason)
    low, high = monitor.margin
    margin = high if monitor.is_failed else low
    cause = examination.find_cause()
    deciding = _describe(cause, margin, columns, ticks, tick_ns)
    size = margin if math.isfinite(margin) else None
    if monitor.is_met:
        outcome = RequirementOutcome.NOT_EXERCISED if 0 in times else RequirementOutcome.PASSED
        reason = "its trigger never became true" if 0 in times else ""
        return Judgement(outcome, size, deciding, triggered=triggered, reason=reason)
    found = monitor.violation
    first, count = (found.first, found.ticks) if found else (cause.tick, 0)
    begin, duration = first * tick_ns / 1e9, count * tick_ns / 1e9
    return Judgement(RequirementOutcome.FAILED, size, deciding, begin, duration, triggered)


def _describe(
    cause: Cause, margin: float, columns: Mapping[str, Floats], ticks: int, tick_ns: int
) -> Deciding:
    time = cause.tick * tick_ns / 1e9
    if not isinstance(cause.node, Comparison):
        return Deciding(time, show_atom(cause.node), "", "")
    node = cause.node
    values = build_values(node.left, tick_ns)(Block(columns, ticks))
    reading = show_number(float(values[cause.tick]), unit_of(node.dimension, node.symbol))
    return Deciding(time, show_atom(node), reading, show_margin(margin, node))


def _why_open(columns: Mapping[str, Floats], ticks: int) -> str:
    holes = [name for name, column in columns.items() if bool(np.isnan(column[:ticks]).any())]
    if not ticks:
        return "there is no tick to judge"
    if holes:
        return f"values are missing of {', '.join(sorted(holes))}, or the run is too short"
    return "the run ends before it is decided"
