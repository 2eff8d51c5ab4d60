"""Scenarios as those see them who watch: which one runs, and the verdicts so far."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from hil_bench.abilities.common.work import (
    Band,
    ShownWork,
    WorkItem,
    WorkMargin,
    WorkState,
    WorkView,
)
from hil_bench.abilities.faults.fault import FaultConfig
from hil_bench.abilities.scenario import nodes
from hil_bench.abilities.scenario.dimensions import UNITS
from hil_bench.abilities.scenario.judgement import RequirementOutcome, show_margin, show_share
from hil_bench.abilities.scenario.monitor import Monitor
from hil_bench.abilities.scenario.nodes import UNBOUNDED, Comparison, Condition, Relation, Window
from hil_bench.abilities.scenario.recorded import Finding
from hil_bench.abilities.scenario.records import FirmwareStep, NmtStep, SyncStep
from hil_bench.abilities.scenario.resolve import Action, PreparedScenario, Requirement, SetAction
from hil_bench.abilities.scenario.results import ScenarioResult, reason_of
from hil_bench.abilities.scenario.stage import Stage
from hil_bench.abilities.scenario.witness import Witness
from hil_bench.errors import ConfigError


def show_results(
    view: WorkView, results: Sequence[ScenarioResult], total: int, now: str = ""
) -> None:
    """Show those who watch what came of the scenarios so far, what failed first."""
    items = [
        _item(each, f"{Path(result.path).name} ") for result in results for each in result.findings
    ]
    items += [
        WorkItem(Path(result.path).name, "stopped", result.problem)
        for result in results
        if result.problem
    ]
    items.sort(key=lambda item: item.verdict == RequirementOutcome.PASSED)
    counts = Counter(item.verdict for item in items)
    verdict = "" if now else _verdict(items)
    view.show(now=now, done=len(results), total=total, counts=counts, items=items, verdict=verdict)


def shown_stage(prepared: PreparedScenario, stage: Stage) -> ShownWork:
    """Return a scenario on a bench that runs, for those who watch."""
    scenario = prepared.scenario
    tick = prepared.config.tick_ns * 1e-9
    live = LiveMargins(prepared, stage.witness)
    steps = [
        WorkItem(f"{each.tick * tick:.3f} s", "", _action_text(each.action))
        for each in prepared.actions
    ]
    asked = [WorkItem(each.id, "", each.that) for each in prepared.requirements]

    def state() -> WorkState:
        done = stage.director.done
        margins = live.look()
        findings, left = asked, steps[done:]
        is_over = stage.director.is_over or stage.witness.ticks > prepared.last_tick
        if is_over:
            try:
                judged = stage.judge()
                findings = [_item(each) for each in judged]
                margins = tuple(map(_decided, margins, judged))
            except ConfigError as error:
                findings = [WorkItem("step", "stopped", str(error))]
        return WorkState(
            now="" if is_over else scenario.title,
            done=round(stage.witness.ticks * tick, 1),
            total=scenario.duration,
            unit="s",
            margins=margins,
            items=[*findings, *(each._replace(verdict="done") for each in steps[:done]), *left],
            verdict=_verdict(findings) if is_over else "",
        )

    return ShownWork("scenario", str(scenario.path), state)


def _decided(margin: WorkMargin, finding: Finding) -> WorkMargin:
    """Return a margin as the judgement on the whole run has it, with the instant that decides."""
    judgement = finding.judgement
    return margin._replace(
        verdict=str(judgement.outcome), margin=judgement.margin, text=reason_of(judgement)
    )


def _item(finding: Finding, prefix: str = "") -> WorkItem:
    judgement = finding.judgement
    return WorkItem(
        f"{prefix}{finding.requirement.id}", str(judgement.outcome), reason_of(judgement)
    )


def _verdict(items: Sequence[WorkItem]) -> str:
    """Return the verdict on all items: passed, or their other outcomes."""
    bad = {item.verdict for item in items} - {RequirementOutcome.PASSED}
    return ", ".join(sorted(bad)) or str(RequirementOutcome.PASSED)


def _action_text(action: Action) -> str:
    match action:
        case SetAction():
            unit = UNITS.get(action.units[0]) if action.units else None
            if unit is None:
                return f"set {action.target} = {action.value:g}"
            return f"set {action.target} = {unit.unit.from_si(action.value):g} {action.units[0]}"
        case FaultConfig():
            return f"{action.kind} {action.target}"
        case NmtStep():
            return f"NMT {action.command} {action.target}"
        case SyncStep():
            return "SYNC on" if action.is_on else "SYNC off"
        case FirmwareStep():
            return f"{action.target or 'firmware'}: {action.command}"


# The margins of requirements while their run goes on.

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
        comparisons = [node for node, _ in _comparisons(requirement.condition, _Place())]
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
            share = f"{show_share(100.0 * self._known, 3)} % of the tolerance"
            text = f"{in_unit or share}, since {self._at:.2f} s"
        return WorkMargin(self._id, verdict, self._known, text, self._bands)


class _Place(NamedTuple):
    """The time in which a comparison must hold.

    Attributes:
        begin: [s].
        end: [s]; None for the end of the run.
        is_strict: whether it must hold at each tick of it.
    """

    begin: float = 0.0
    end: float | None = None
    is_strict: bool = True

    def within(self, window: Window, *, is_strict: bool) -> "_Place":
        """Return the place of what stands in a window that is seen from each time of this one."""
        if (self.begin, self.end) == (0.0, None) and self.is_strict and window != UNBOUNDED:
            end = None if window.end is None else window.end * 1e-9
            return _Place(window.start * 1e-9, end, is_strict)
        return self._replace(is_strict=self.is_strict and is_strict)


def bands_of(condition: Condition) -> Iterator[Band]:
    """Yield the range of each channel that a requirement compares with a constant.

    A trigger of an implication wants nothing, and what is negated or one of several ways is left
    out, for its range alone would say too much.

    Yields:
        The bands, one a comparison.
    """
    for node, place in _comparisons(condition, _Place()):
        if isinstance(node.right, nodes.Number):
            band = _band(node.left, node.relation in _UPPER, node.right.value, node)
        elif isinstance(node.left, nodes.Number):
            band = _band(node.right, node.relation in _LOWER, node.left.value, node)
        else:
            band = None
        if band is not None:
            yield band._replace(begin=place.begin, end=place.end, is_strict=place.is_strict)


def _band(side: nodes.Value, is_upper: bool, value: float, node: Comparison) -> Band | None:
    if node.relation not in _UPPER | _LOWER:
        return None
    if isinstance(side, nodes.Reading):
        return Band(side.name, None if is_upper else value, value if is_upper else None)
    found = _deviation(side)
    if found is None or not is_upper:
        return None
    name, centre = found
    return Band(name, centre - value, centre + value)


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


def _comparisons(condition: Condition, place: _Place) -> Iterator[tuple[Comparison, _Place]]:
    """Yield the comparisons that must hold, without triggers, negations and choices.

    Yields:
        Each comparison, and when it must hold.
    """
    match condition:
        case Comparison():
            yield condition, place
        case nodes.All(operands=operands):
            for each in operands:
                yield from _comparisons(each, place)
        case nodes.Implies(response=response):
            yield from _comparisons(response, place._replace(is_strict=False))
        case nodes.Always(window=window, operand=operand):
            yield from _comparisons(operand, place.within(window, is_strict=True))
        case nodes.Eventually(window=window, operand=operand):
            yield from _comparisons(operand, place.within(window, is_strict=False))
        case _:
            return
