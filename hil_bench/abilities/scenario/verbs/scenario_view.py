"""Scenarios as those see them who watch: which one runs, and the verdicts so far."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from hil_bench.abilities.common.work import ShownWork, WorkItem, WorkMargin, WorkState, WorkView
from hil_bench.abilities.faults.fault import FaultConfig
from hil_bench.abilities.scenario.dimensions import UNITS
from hil_bench.abilities.scenario.judgement import RequirementOutcome
from hil_bench.abilities.scenario.live_margins import LiveMargins
from hil_bench.abilities.scenario.recorded import Finding
from hil_bench.abilities.scenario.records import FirmwareStep, NmtStep, SyncStep
from hil_bench.abilities.scenario.resolve import Action, PreparedScenario, SetAction
from hil_bench.abilities.scenario.results import ScenarioResult, reason_of
from hil_bench.abilities.scenario.stage import Stage
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
