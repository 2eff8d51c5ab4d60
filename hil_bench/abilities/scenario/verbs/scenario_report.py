"""`--report`: the HTML file of `hil-bench test` and `judge`, and the same as JSON beside it."""

import argparse
import json
import platform
import shlex
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, fields
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import hil_bench
from hil_bench.abilities.common.files import check_place, whole_file
from hil_bench.abilities.common.identifiers import function_of
from hil_bench.abilities.eyes.frame_words import meaning_of
from hil_bench.abilities.recording.formats import FRAME_SUFFIXES
from hil_bench.abilities.recording.frames import read_frames
from hil_bench.abilities.scenario import report as reports
from hil_bench.abilities.scenario.judgement import Evidence, RequirementOutcome
from hil_bench.abilities.scenario.recorded import Finding, Judged
from hil_bench.abilities.scenario.records import RequirementsFile
from hil_bench.abilities.scenario.resolve import PreparedScenario
from hil_bench.abilities.scenario.results import UNJUDGED, ScenarioResult, reason_of
from hil_bench.bench.configuration import BenchConfig
from hil_bench.canopen_device.frame import Frame
from hil_bench.cli.exit_codes import ExitCode, verdict_code, worst
from hil_bench.cli.results import json_text
from hil_bench.config.settings import Origin
from hil_bench.errors import ConfigError, about_file
from hil_bench.outside.recording.channels import TIME, LoggedFrame, Recording
from hil_bench.units import ONE

_SUFFIX = ".html"
_MOST_TEXT = 200  # characters of a setting


class PlainReader:
    """Reads the frames of a recording, of whose bench nothing is known."""

    def name(self, frame: Frame) -> str:
        """Return the function of its identifier and its node, in the predefined set of CiA 301."""
        name, node_id = function_of(frame.can_id)
        return name if node_id is None else f"node {node_id} {name}"

    def meaning(self, frame: Frame) -> str:
        """Return the meaning of the frame, as far as its identifier reveals it."""
        return meaning_of(frame.can_id, frame.data)

    def news(self, frames: Sequence[LoggedFrame]) -> Iterable[LoggedFrame]:
        """Return all frames."""
        return frames

    def latest(self, _frames: Sequence[LoggedFrame]) -> Iterator[LoggedFrame]:
        """Return none."""
        return iter(())


def add_report_argument(parser: argparse.ArgumentParser) -> None:
    """Add --report."""
    parser.add_argument(
        "--report",
        type=Path,
        metavar="FILE",
        help="write a report that opens offline in any browser (.html), and the same as .json",
    )


def check_report_argument(args: argparse.Namespace) -> None:
    """Refuse, before anything runs, a report that could not be written.

    Raises:
        ConfigError: its name, its folder or a library is wrong.
    """
    if args.report is None:
        return
    if args.report.suffix.lower() != _SUFFIX:
        raise ConfigError(f"--report {args.report}: give the name of an {_SUFFIX} file")
    for path in (args.report, args.report.with_suffix(".json")):
        check_place("--report", path)
    if find_spec("jinja2") is None:
        raise ConfigError("--report needs Jinja2: pip install 'hil-bench[report]'")


def write_report(args: argparse.Namespace, title: str, chapters: Sequence[reports.Chapter]) -> None:
    """Write the report as HTML, and as JSON beside it."""
    versions = {"hil-bench": hil_bench.__version__, "Python": platform.python_version()}
    facts = (*versions.items(), *((name, version(name)) for name in ("numpy", "canopen")))
    report = reports.Report(title, facts, tuple(chapters))
    texts = {
        args.report: reports.report_html(report),
        args.report.with_suffix(".json"): json_text(_content(report)),
    }
    for path, text in texts.items():
        with about_file(path), whole_file(path) as file:
            file.write_text(text, encoding="utf-8", errors="backslashreplace")


def run_chapter(
    prepared: PreparedScenario, result: ScenarioResult, given: Sequence[str]
) -> reports.Chapter:
    """Return the chapter of a report on a scenario that was played.

    Args:
        prepared: the scenario.
        result: what came of it, with its evidence.
        given: parameters of the command line.
    """
    config, evidence = prepared.config, result.evidence
    words = ["hil-bench", "test", result.path, "--seed", str(result.seed)]
    words += [word for text in given for word in ("--set", text)]
    return reports.Chapter(
        result.path,
        result.title,
        result.requirement_ids,
        (
            ("Bench", str(config.path or "built-in bench")),
            ("Seed", str(result.seed)),
            ("Length", f"{result.duration:g} s, a tick of {config.tick_ns * 1e-6:g} ms"),
            *(("Parameter", text) for text in _parameters(prepared)),
            *((("Controller", result.ending),) if result.ending else ()),
        ),
        tuple(_settings(config)),
        shlex.join(words),
        (result.problem,) if result.problem else (),
        tuple(_proof(finding, evidence) for finding in result.findings),
    )


def recording_chapter(
    requirements: RequirementsFile,
    path: Path,
    signals: Recording,
    judged: Judged,
    doubts: Sequence[str],
    options: Sequence[str],
) -> reports.Chapter:
    """Return the chapter of a report on a recording that was judged.

    Args:
        requirements: those of a file.
        path: of the recording.
        signals: what it holds.
        judged: what it says.
        doubts: in it.
        options: of the command line, by which it says so.
    """
    findings, trace = judged
    times, start = signals[TIME.name], trace.start
    shifted = signals.copy()
    shifted[TIME.name] -= start
    evidence = Evidence(
        shifted,
        trace.columns,
        trace.ticks,
        trace.tick_ns,
        frames=tuple(_frames_near(path, findings, round(start * 1e9))),
        reader=PlainReader(),
        planned=trace.planned,
    )
    length = f"{times[-1] - times[0]:g} s from {times[0]:g} s, a row a {trace.tick_ns * 1e-6:g} ms"
    words = ["hil-bench", "judge", str(requirements.path), str(path), *options]
    return reports.Chapter(
        str(path),
        path.name,
        requirements.requirement_ids,
        (
            ("Requirements", str(requirements.path)),
            ("Length", length),
            *((("Judged", trace.note),) if trace.note else ()),
            *(("In doubt", doubt) for doubt in doubts),
        ),
        (),
        shlex.join(words),
        (),
        tuple(_proof(finding, evidence) for finding in findings),
    )


def unread_chapter(
    requirements: Path, path: Path, problem: str, options: Sequence[str]
) -> reports.Chapter:
    """Return the chapter of a report on a recording that could not be judged.

    Args:
        requirements: their file.
        path: of the recording.
        problem: why not.
        options: of the command line.
    """
    words = ["hil-bench", "judge", str(requirements), str(path), *options]
    facts = (("Requirements", str(requirements)),)
    parts = str(path), path.name, (), facts, (), shlex.join(words), (problem,), ()
    return reports.Chapter(*parts, RequirementOutcome.INCONCLUSIVE)


def _proof(finding: Finding, evidence: Evidence | None) -> reports.Proof:
    (name, that, _), judgement = finding
    is_passed = judgement.outcome is RequirementOutcome.PASSED
    exhibit = None if is_passed or evidence is None else reports.make_exhibit(finding, evidence)
    return reports.Proof(name, that, judgement, reason_of(judgement), exhibit)


def _frames_near(path: Path, findings: Sequence[Finding], start: int) -> Iterator[LoggedFrame]:
    """Yield the frames of a recording that its exhibits can show, its first row at 0."""
    wrong = [f.judgement for f in findings if f.judgement.outcome is RequirementOutcome.FAILED]
    moments = [moment for judgement in wrong for moment in reports.moments_of(judgement).values()]
    if not moments or path.suffix.lower() not in FRAME_SUFFIXES:
        return
    for logged in read_frames(path):
        if reports.is_near(logged.now - start, moments):
            yield logged._replace(now=logged.now - start)


def _parameters(prepared: PreparedScenario) -> Iterator[str]:
    for each in prepared.scenario.parameters:
        symbol = "" if each.unit is ONE else f" {each.unit.symbol}"
        yield f"{each.name} = {each.unit.from_si(prepared.parameters[each.name]):g}{symbol}"


def _settings(config: BenchConfig) -> Iterator[str]:
    for setting in config.settings:
        if setting.origin is not Origin.DEFAULT:
            value = json.dumps(setting.value, ensure_ascii=False, default=str)[:_MOST_TEXT]
            yield f"{setting.table}.{setting.key.name} = {value}  ({setting.origin})"


def _content(report: reports.Report) -> dict[str, Any]:
    """Return a report for a program: without pictures."""
    content = asdict(report)
    for chapter in content["chapters"]:
        for proof in chapter["proofs"]:
            if proof["exhibit"] is not None:
                del proof["exhibit"]["picture"]
    return {
        "outcome": report.outcome,
        "requirements": [asdict(row) for row in report.rows],
        **content,
    }


# Verdicts line by line, and their exit code, for the verbs that judge.


def exit_code_for(findings: Sequence[Finding], unjudged: Sequence[str]) -> ExitCode:
    """Return the exit code of a judgement: that of the worst outcome.

    Args:
        findings: on each requirement.
        unjudged: requirements that it is about and that have no verdict; they are undecided.
    """
    found = {each.judgement.outcome for each in findings}
    is_whole = found == {RequirementOutcome.PASSED} and not unjudged
    return verdict_code(fails=RequirementOutcome.FAILED in found, passes=is_whole)


def exit_code_of_results(results: Sequence[ScenarioResult]) -> ExitCode:
    """Return the exit code of scenarios; an interrupted one says nothing of its requirements."""
    return worst(*map(_exit_code_of_result, results)) if results else ExitCode.INCONCLUSIVE


def _exit_code_of_result(result: ScenarioResult) -> ExitCode:
    if result.is_interrupted:
        return ExitCode.INTERRUPTED
    if result.is_misuse:
        return ExitCode.USAGE
    if result.problem:
        return ExitCode.CHECK_FAILED
    return exit_code_for(result.findings, result.unjudged)


def result_lines(results: Sequence[ScenarioResult]) -> Iterator[str]:
    """Yield what came of scenarios, a line a requirement."""
    for result in results:
        yield f"{result.path}: {result.title}"
        if result.problem:
            yield f"  {result.problem}"
        if result.ending:
            yield f"  {result.ending}"
        yield from finding_lines(result.findings, result.unjudged)


def finding_lines(findings: Sequence[Finding], unjudged: Sequence[str]) -> Iterator[str]:
    """Yield judgements, a line each, and what is not judged."""
    names = [*(each.requirement.id for each in findings), *unjudged]
    width = max(map(len, names), default=0)
    for each in findings:
        judgement = each.judgement
        why = reason_of(judgement)
        yield f"  {each.requirement.id:{width}}  {judgement.outcome:13}  {why}".rstrip()
    for name in unjudged:
        yield f"  {name:{width}}  {reports.NOT_JUDGED:13}  {UNJUDGED}"


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
