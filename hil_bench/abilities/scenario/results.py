"""The result of a scenario, in words and as a JUnit file."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from hil_bench.abilities.common.files import whole_file
from hil_bench.abilities.scenario.judgement import (
    EQUAL,
    Evidence,
    Judgement,
    RequirementOutcome,
    show_share,
)
from hil_bench.abilities.scenario.recorded import Finding
from hil_bench.abilities.scenario.records import Scenario, unjudged_ids
from hil_bench.abilities.scenario.resolve import PreparedScenario
from hil_bench.abilities.scenario.run import PLAIN, PlayOptions, play
from hil_bench.errors import ControllerFileError, HilBenchError, about_file

UNJUDGED: Final = "requirement_ids names it, and no expectation has this id"
"""Why a requirement is not judged."""


@dataclass(frozen=True, slots=True)
class ScenarioResult:
    """The result of a scenario.

    Attributes:
        path: its file.
        title: in words.
        requirement_ids: the requirements that it is about.
        seed: of all that is random.
        parameters: their values in SI.
        duration: how long the run was [s].
        ending: how the controller ended before the run did; empty where it did not.
        problem: why there was no whole run; empty where there was.
        findings: the judgement on each requirement; empty where there is a problem.
        evidence: for a report; None where none was asked for.
        is_interrupted: whether somebody pressed Ctrl-C.
        is_misuse: whether the problem is a file that is no controller.
    """

    path: str
    title: str
    requirement_ids: tuple[str, ...]
    seed: int
    parameters: dict[str, float]
    duration: float = 0.0
    ending: str = ""
    problem: str = ""
    findings: tuple[Finding, ...] = ()
    evidence: Evidence | None = field(default=None, compare=False)
    is_interrupted: bool = field(default=False, compare=False)
    is_misuse: bool = field(default=False, compare=False)

    @property
    def unjudged(self) -> list[str]:
        """The requirements that it is about and does not judge; none where it has a problem."""
        judged = (each.requirement.id for each in self.findings)
        return [] if self.problem else unjudged_ids(self.requirement_ids, judged)


def blank_result(
    scenario: Scenario, seed: int, parameters: Mapping[str, float], problem: str = ""
) -> ScenarioResult:
    """Return the result of a scenario before it was played, or that it was not, with the reason."""
    about = str(scenario.path), scenario.title, scenario.requirement_ids, seed
    return ScenarioResult(*about, dict(parameters), problem=problem)


def play_for_result(prepared: PreparedScenario, options: PlayOptions = PLAIN) -> ScenarioResult:
    """Play a scenario; a firmware that fails, or a step that cannot act, is a result too."""
    blank = blank_result(prepared.scenario, prepared.config.seed, prepared.parameters)
    try:
        run = play(prepared, options)
    except HilBenchError as error:
        is_misuse = isinstance(error, ControllerFileError)
        return replace(blank, problem=str(error), is_misuse=is_misuse)
    return replace(
        blank,
        duration=run.duration,
        ending=run.ending,
        findings=run.findings,
        evidence=run.evidence,
    )


def reason_of(judgement: Judgement) -> str:
    """Return why a requirement has its outcome, and how much of its time was seen, in a line."""
    parts = [judgement.reason] if judgement.reason else []
    if judgement.first is not None:
        lasting = f", for {judgement.duration:.9g} s in all" if judgement.duration else ""
        parts.append(f"first violated at {judgement.first:.9g} s{lasting}")
    deciding = judgement.deciding
    if deciding is not None:
        when = f"{deciding.rank} at {deciding.time:.9g} s".lstrip()
        parts.append(f"{when}: {deciding.fact}{_share(judgement.margin)}")
    return "; ".join([*parts, str(judgement.coverage)])


def _share(margin: float | None) -> str:
    """Return a margin in words; nothing for one without a size, or where both sides are equal."""
    if margin is None or abs(margin) < EQUAL:
        return ""
    return f" ({show_share(margin)} of the tolerance)"


def write_junit(results: Iterable[ScenarioResult], path: Path) -> None:
    """Write a JUnit file: a suite a scenario, a case a requirement.

    The first case of a suite has the time of the run on the bench's clock, as pytest plays at the
    first requirement of a file; the other cases take none.

    One that cannot be written is a `ConfigError`.
    """
    root = ET.Element("testsuites")
    for result in results:
        _add_suite(root, result)
    for element in root.iter():
        element.attrib = {key: _xml_text(value) for key, value in element.items()}
    ET.indent(root)
    with about_file(path), whole_file(path) as file:
        ET.ElementTree(root).write(file, encoding="utf-8", xml_declaration=True)


def junit_properties(result: ScenarioResult, finding: Finding) -> list[tuple[str, str]]:
    """List a requirement's properties for a JUnit file, beside its outcome."""
    judgement = finding.judgement
    margin = "" if judgement.margin is None else f"{judgement.margin:.6g}"
    share = judgement.coverage.share
    return [
        ("requirement_id", finding.requirement.id),
        ("expectation", finding.requirement.that),
        ("outcome", judgement.outcome.value),
        ("margin", margin),
        ("deciding", reason_of(judgement)),
        ("seen", f"{share if share == 1.0 else min(share, 0.999999):.6g}"),
        ("seed", str(result.seed)),
    ]


def _add_suite(root: ET.Element, result: ScenarioResult) -> None:
    suite = ET.SubElement(root, "testsuite", name=result.title)
    if result.problem:
        named = [("requirement_id", requirement) for requirement in result.requirement_ids]
        case = _add_case(suite, result, "run", named)
        ET.SubElement(case, "error", message=result.problem)
    for finding in result.findings:
        case = _add_case(suite, result, finding.requirement.id, junit_properties(result, finding))
        outcome = finding.judgement.outcome
        if outcome is not RequirementOutcome.PASSED:
            message = f"{outcome}: {reason_of(finding.judgement)}"
            ET.SubElement(case, "failure", type=outcome.value, message=message)
    for requirement in result.unjudged:
        case = _add_case(suite, result, requirement, [("requirement_id", requirement)])
        kind = RequirementOutcome.NOT_EXERCISED.value
        ET.SubElement(case, "failure", type=kind, message=f"not judged: {UNJUDGED}")
    for number, case in enumerate(suite):
        case.set("time", f"{0.0 if number else result.duration:.3f}")
    suite.set("tests", str(len(suite)))
    suite.set("time", f"{result.duration:.3f}")
    for kind, tag in (("failures", "failure"), ("errors", "error")):
        suite.set(kind, str(len(suite.findall(f"testcase/{tag}"))))
    suite.set("skipped", "0")


def _add_case(
    suite: ET.Element, result: ScenarioResult, name: str, about: Iterable[tuple[str, str]]
) -> ET.Element:
    """Add a test case to its suite, with properties where it has some."""
    case = ET.SubElement(suite, "testcase", classname=result.path, name=name)
    pairs = list(about)
    if pairs:
        properties = ET.SubElement(case, "properties")
        for key, value in pairs:
            ET.SubElement(properties, "property", name=key, value=value)
    return case


def _xml_text(text: str) -> str:
    """Return a text without the characters that XML 1.0 cannot hold."""
    return "".join(c if c in "\t\n" or c.isprintable() else "�" for c in text)
