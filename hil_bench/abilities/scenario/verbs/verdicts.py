"""Verdicts line by line, and their exit code, for the verbs that judge."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields

from hil_bench.abilities.scenario.judgement import RequirementOutcome
from hil_bench.abilities.scenario.recorded import Finding
from hil_bench.abilities.scenario.results import ScenarioResult, reason_of
from hil_bench.cli.exit_codes import ExitCode, verdict_code


def exit_code_for(outcomes: Iterable[RequirementOutcome]) -> ExitCode:
    """Return the exit code for the outcomes of all requirements: that of the worst."""
    found = set(outcomes)
    return verdict_code(
        fails=RequirementOutcome.FAILED in found, passes=found == {RequirementOutcome.PASSED}
    )


def result_lines(results: Sequence[ScenarioResult]) -> Iterator[str]:
    """Yield what came of scenarios, a line a requirement."""
    for result in results:
        yield f"{result.path}: {result.title}"
        if result.problem:
            yield f"  {result.problem}"
        if result.ending:
            yield f"  {result.ending}"
        yield from finding_lines(result.findings)


def finding_lines(findings: Sequence[Finding]) -> Iterator[str]:
    """Yield judgements, a line each."""
    width = max((len(each.requirement.id) for each in findings), default=0)
    for each in findings:
        judgement = each.judgement
        why = reason_of(judgement)
        yield f"  {each.requirement.id:{width}}  {judgement.outcome:13}  {why}".rstrip()


def result_content(result: ScenarioResult) -> dict[str, object]:
    """Return a result for a program; the keys of a requirement are those of ``judge``."""
    names = [each.name for each in fields(result) if each.compare]
    whole: dict[str, object] = {name: getattr(result, name) for name in names}
    whole["findings"] = finding_content(result.findings)
    return whole


def finding_content(findings: Iterable[Finding]) -> list[dict[str, object]]:
    """Return judgements for a program."""
    return [
        {
            "id": each.requirement.id,
            "that": each.requirement.that,
            "judgement": each.judgement,
            "text": reason_of(each.judgement),
        }
        for each in findings
    ]
