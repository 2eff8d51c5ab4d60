"""The margins of requirements while their run goes on, for those who watch."""

import math
from collections.abc import Iterator

from hil_bench.abilities.scenario import nodes
from hil_bench.abilities.scenario.judgement import RequirementOutcome
from hil_bench.abilities.scenario.monitor import Monitor
from hil_bench.abilities.scenario.nodes import Comparison, Condition, Relation
from hil_bench.abilities.scenario.prepared import PreparedScenario
from hil_bench.abilities.scenario.resolve import Requirement
from hil_bench.abilities.scenario.witness import Witness
from hil_bench.abilities.scenario.wording import show_margin
from hil_bench.session.work_feed import Band, WorkMargin

_BLOCK = 64
"""Ticks that are judged together: how exactly the time of a margin is known before the end."""

_UPPER = {Relation.LESS, Relation.LESS_EQUAL}
_LOWER = {Relation.GREATER, Relation.GREATER_EQUAL}


class LiveMargins:
    """The margins so far; a look costs what the ticks since the last one cost.

    Args:
        prepared: the scenario.
        witness: of its run.
    """

    def __init__(self, prepared: PreparedScenario, witness: Witness) -> None:
        tick_ns = prepared.config.tick_ns
        self._witness = witness
        self._margins = [_Margin(each, tick_ns) for each in prepared.requirements]
        self._seen = 0

    def look(self) -> tuple[WorkMargin, ...]:
        """Return the margin of each requirement by the ticks so far."""
        ticks = self._witness.ticks
        columns = self._witness.columns(self._seen)
        for begin in range(0, ticks - self._seen, _BLOCK):
            end = min(begin + _BLOCK, ticks - self._seen)
            block = {name: values[begin:end] for name, values in columns.items()}
            for margin in self._margins:
                margin.monitor.push(block, end - begin)
                margin.note(self._seen + end)
        self._seen = ticks
        return tuple(margin.content() for margin in self._margins)


class _Margin:
    def __init__(self, requirement: Requirement, tick_ns: int) -> None:
        self.monitor = Monitor(requirement.condition, tick_ns)
        self._id = requirement.id
        self._tick = tick_ns * 1e-9
        self._known: float | None = None
        self._at = 0.0
        self._bands = tuple(bands_of(requirement.condition))
        comparisons = list(_comparisons(requirement.condition))
        self._only = comparisons[0] if len(comparisons) == 1 else None

    def note(self, ticks: int) -> None:
        """Take the margin after so many ticks, with its time where it is another."""
        low, high = self.monitor.margin
        known = high if math.isfinite(high) else low if math.isfinite(low) else None
        if known != self._known:
            self._known, self._at = known, ticks * self._tick

    def content(self) -> WorkMargin:
        """Return the margin for people."""
        verdict = ""
        if self.monitor.is_failed:
            verdict = str(RequirementOutcome.FAILED)
        elif self.monitor.is_met:
            verdict = str(RequirementOutcome.PASSED)
        text = ""
        if self._known is not None:
            in_unit = show_margin(self._known, self._only) if self._only is not None else ""
            share = f"{100.0 * self._known:+.3g} % of the tolerance"
            text = f"{in_unit or share}, since {self._at:.2f} s"
        return WorkMargin(self._id, verdict, self._known, text, self._bands)


def bands_of(condition: Condition) -> Iterator[Band]:
    """Yield the range of each channel that a requirement compares with a constant.

    A trigger of an implication wants nothing, and what is negated or one of several ways is left
    out, for its range alone would say too much.

    Yields:
        The bands, one a comparison.
    """
    for node in _comparisons(condition):
        if isinstance(node.right, nodes.Number):
            yield from _band(node.left, node.relation in _UPPER, node.right.value, node)
        elif isinstance(node.left, nodes.Number):
            yield from _band(node.right, node.relation in _LOWER, node.left.value, node)


def _band(side: nodes.Value, is_upper: bool, value: float, node: Comparison) -> Iterator[Band]:
    if node.relation not in _UPPER | _LOWER:
        return
    if isinstance(side, nodes.Reading):
        yield Band(side.name, None if is_upper else value, value if is_upper else None)
        return
    found = _deviation(side)
    if found is not None and is_upper:
        name, centre = found
        yield Band(name, centre - value, centre + value)


def _deviation(side: nodes.Value) -> tuple[str, float] | None:
    """Return the channel and the constant of ``abs(x - c)`` or ``abs(x)``; None for others."""
    if not isinstance(side, nodes.Magnitude):
        return None
    match side.operand:
        case nodes.Reading(name=name):
            return name, 0.0
        case nodes.Arithmetic(
            operation=nodes.Operation.SUBTRACT,
            left=nodes.Reading(name=name),
            right=nodes.Number(value=value),
        ):
            return name, value
        case _:
            return None


def _comparisons(condition: Condition) -> Iterator[Comparison]:
    """Yield the comparisons that must hold, without triggers, negations and choices.

    Yields:
        Each comparison.
    """
    match condition:
        case Comparison():
            yield condition
        case nodes.All(operands=operands):
            for each in operands:
                yield from _comparisons(each)
        case nodes.Implies(response=response):
            yield from _comparisons(response)
        case nodes.Always(operand=operand) | nodes.Eventually(operand=operand):
            yield from _comparisons(operand)
        case _:
            return
