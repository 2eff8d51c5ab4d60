"""The content of a pack: its statements traced to requirements, its texts, its page."""

import hashlib
import json
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from hil_bench.abilities.common.page import render_page
from hil_bench.abilities.evidence.pack import sha256_of
from hil_bench.config.values import quote
from hil_bench.errors import ConfigError, about_file

# The content of a pack in a form for JSON; the page shows the same.

WORST_FIRST = ("failed", "inconclusive", "not exercised", "passed")


def summarise(pack: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return a line a section that has a verdict.

    Args:
        pack: with `plant`, `conformance`, `determinism` and `traceability`.
    """
    plant, devices = pack["plant"], pack["conformance"]
    runs = pack["determinism"]["runs"]
    requirements = pack["traceability"]["requirements"]
    digests = sorted({run["digest"] for run in runs})
    shown = f"{len(digests)} digests" if len(digests) > 1 else f"one digest, {digests[0][:12]}"
    return [
        _line("plant", _worst(plant), f"{_counts(plant, 'verdict')} of {len(plant)} checks"),
        _line("conformance", _worst(devices), _device_counts(devices)),
        _line("determinism", pack["determinism"]["verdict"], f"{len(runs)} runs, {shown}"),
        _line(
            "traceability",
            pack["traceability"]["verdict"],
            f"{_counts(requirements, 'outcome')} of {len(requirements)} requirements"
            if requirements
            else "no requirement in the results"
            if pack["traceability"]["files"]
            else "no results were given",
        ),
    ]


def _line(section: str, verdict: str, text: str) -> dict[str, str]:
    return {"section": section, "verdict": verdict, "text": text}


def _worst(items: Sequence[Mapping[str, Any]]) -> str:
    """Return the verdict on all; without any that applies, there is none."""
    verdicts = {item["verdict"] for item in items}
    return next((verdict for verdict in WORST_FIRST if verdict in verdicts), "not applicable")


def _counts(items: Sequence[Mapping[str, Any]], key: str) -> str:
    found = [item[key] for item in items]
    return ", ".join(f"{found.count(verdict)} {verdict}" for verdict in dict.fromkeys(found))


def _device_counts(devices: Sequence[Mapping[str, Any]]) -> str:
    totals: dict[str, int] = {}
    for device in devices:
        for outcome, count in device.get("counts", {}).items():
            totals[outcome] = totals.get(outcome, 0) + count
    always = "passed", "failed", "not applicable"
    shown = {name: count for name, count in totals.items() if count or name in always}
    counts = ", ".join(f"{count} {outcome}" for outcome, count in shown.items())
    what = "device" if len(devices) == 1 else "devices"
    return f"{len(devices)} {what}" + (f": {counts}" if counts else "")


# The pack's texts about the tool itself: known defects, notes on classification.

_PACKAGE = "hil_bench.abilities.evidence"


def known_defects() -> list[dict[str, str]]:
    """List the known defects: id, subject, text, consequence."""
    defects: list[dict[str, str]] = _load("known_defects.toml")["defect"]
    return defects


def classification() -> dict[str, object]:
    """Return the template of the notes on tool classification."""
    return _load("classification.toml")


def _load(name: str) -> dict[str, Any]:
    return tomllib.loads(files(_PACKAGE).joinpath(name).read_text("utf-8"))


# The page of a pack: HTML that opens offline, made of the same content as the JSON.


def page_html(content: Mapping[str, object]) -> str:
    """Return a pack's content as HTML."""
    return render_page(__package__, "page.html.j2", {"pack": content}, _shown)


def _shown(value: object) -> object:
    return f"{value:.6g}" if isinstance(value, float) else "–" if value is None else value


# From requirement to test to result: the files that test runs left behind.

MOST_BYTES = 64_000_000
"""Size of the largest file of results that is read."""

_RIGHT = "give the output of 'hil-bench test --json', or a JUnit XML file"


class ResultsFile(NamedTuple):
    """A file of results.

    Attributes:
        path: where it is.
        content: its bytes, read once.
    """

    path: Path
    content: bytes


class Row(NamedTuple):
    """One result.

    Attributes:
        requirement: its id; empty for a test that names none.
        expectation: what is required, in the language of expectations or in words.
        test: the scenario or the test case.
        outcome: what became of it.
        reason: why.
        file: the file that says so.
    """

    requirement: str
    expectation: str
    test: str
    outcome: str
    reason: str
    file: str


def read_results(paths: Sequence[Path]) -> list[ResultsFile]:
    """Return the files.

    Raises:
        ConfigError: one cannot be read, or is too large.
    """
    files = []
    for path in paths:
        with about_file(f"--results {path}", what="cannot be read"):
            if path.is_file() and path.stat().st_size > MOST_BYTES:
                raise ConfigError(f"--results {path}: larger than {MOST_BYTES // 10**6} MB")
            files.append(ResultsFile(path, path.read_bytes()))
    return files


def trace(files: Sequence[ResultsFile]) -> dict[str, object]:
    """Return each requirement with the tests that look at it and what they found.

    A file that is neither JSON of `hil-bench test` nor JUnit XML is refused.
    """
    rows = [row for file in files for row in _rows(file)]
    with_id = [row for row in rows if row.requirement]
    requirements = [
        {
            "requirement": requirement,
            "outcome": _worst_outcome(
                [row.outcome for row in with_id if row.requirement == requirement]
            ),
            "tests": [row._asdict() for row in with_id if row.requirement == requirement],
        }
        for requirement in dict.fromkeys(row.requirement for row in with_id)
    ]
    return {
        "verdict": _verdict(rows) if files else "not applicable",
        "files": [
            {"file": str(file.path), "sha256": hashlib.sha256(file.content).hexdigest()}
            for file in files
        ],
        "scenarios": _scenarios(row.test for row in rows),
        "requirements": requirements,
        "without_requirement": [row._asdict() for row in rows if not row.requirement],
    }


def _worst_outcome(outcomes: Sequence[str]) -> str:
    return next(outcome for outcome in WORST_FIRST if outcome in outcomes)


def _verdict(rows: Sequence[Row]) -> str:
    """Return the worst result; results that name no requirement trace nothing."""
    traced = [] if any(row.requirement for row in rows) else ["not exercised"]
    return _worst_outcome([*(row.outcome for row in rows), *traced])


def _rows(file: ResultsFile) -> Iterator[Row]:
    """Yield the results of a file.

    Raises:
        ConfigError: it holds none.
    """
    if file.content.lstrip()[:1] == b"<":
        yield from _junit_rows(file)
        return
    try:
        content = json.loads(file.content)
        rows = [row for name, run in content.items() for row in _run_rows(name, run, file)]
    except (ValueError, RecursionError, TypeError, KeyError, AttributeError):
        raise ConfigError(f"--results {file.path}: is neither; {_RIGHT}") from None
    yield from rows


def _run_rows(name: str, run: dict[str, Any], file: ResultsFile) -> Iterator[Row]:
    """Yield the results of a scenario as `hil-bench test --json` writes them."""
    findings, declared = list(run["findings"]), list(run["requirement_ids"])
    problem = str(run["problem"])
    found = set()
    for finding in findings:
        judgement = finding["judgement"]
        found.add(str(finding["id"]))
        yield Row(
            str(finding["id"]),
            str(finding["that"]),
            name,
            _known(str(judgement["outcome"])),
            str(finding.get("text", "")),
            str(file.path),
        )
    for requirement in declared:
        if str(requirement) not in found:
            outcome = "failed" if problem else "not exercised"
            why = problem or "the scenario names it and judged nothing for it"
            yield Row(str(requirement), "", name, outcome, why, str(file.path))
    if problem and (found or not declared):
        yield Row("", "", name, "failed", problem, str(file.path))


def _known(outcome: str) -> str:
    """Return an outcome; one that nobody knows is a failure."""
    return outcome if outcome in WORST_FIRST else "failed"


class _NoDoctype(ET.TreeBuilder):
    """Builds a tree, and refuses what could make a small file large: entities of its own."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        """Refuse a document type.

        Raises:
            ValueError: always.
        """
        raise ValueError(name, pubid, system)


def _junit_rows(file: ResultsFile) -> Iterator[Row]:
    """Yield the test cases of a JUnit file.

    Raises:
        ConfigError: it is no such file.
    """
    try:
        parser = ET.XMLParser(target=_NoDoctype())  # noqa: S314 - entities are refused
        parser.feed(file.content)
        root = parser.close()
    except (ET.ParseError, ValueError, LookupError):
        raise ConfigError(f"--results {file.path}: is no JUnit XML; {_RIGHT}") from None
    if root.tag not in {"testsuites", "testsuite"}:
        raise ConfigError(f"--results {file.path}: begins with <{root.tag}>; {_RIGHT}")
    _check_counts(root, file.path)
    for case in root.iter("testcase"):
        pairs = [(each.get("name", ""), each.get("value", "")) for each in case.iter("property")]
        properties = dict(pairs)
        named = [value for name, value in pairs if name == _ID and value]
        outcome, reason = _junit_outcome(case)
        for requirement in dict.fromkeys(named or [""]):
            yield Row(
                requirement,
                properties.get("expectation", ""),
                f"{case.get('classname', '')}::{case.get('name', '')}",
                _worst_outcome([outcome, _known(properties.get("outcome", outcome))]),
                reason or properties.get("deciding", ""),
                str(file.path),
            )


_ID = "requirement_id"
"""The property of a test case that names a requirement; a case may have several."""

_COUNTED = {"tests": "testcase", "failures": "failure", "errors": "error", "skipped": "skipped"}
_MOST_DIGITS = 10


def _check_counts(root: ET.Element, path: Path) -> None:
    """Refuse a file whose suites count more than their cases: some are not there.

    Raises:
        ConfigError: a suite does, or counts with what is no number.
    """
    for suite in (root, *root.iter("testsuite")):
        for name, tag in _COUNTED.items():
            count = suite.get(name, "0")
            cases = sum(next(each.iter(tag), None) is not None for each in suite.iter("testcase"))
            if not (count.isdecimal() and len(count) < _MOST_DIGITS and int(count) <= cases):
                wrong = f"a suite says {name}={quote(count)}, and {cases} of its cases say so"
                raise ConfigError(f"--results {path}: {wrong}; give the whole file")


def _junit_outcome(case: ET.Element) -> tuple[str, str]:
    for tag, outcome in (("error", "failed"), ("failure", "failed"), ("skipped", "not exercised")):
        for found in case.iter(tag):
            kind = found.get("type", "")
            reason = found.get("message", "") or (found.text or "")
            return (kind if kind in WORST_FIRST else outcome), reason
    return "passed", ""


def _scenarios(tests: Iterator[str]) -> list[dict[str, str]]:
    """Return the scenario files that results name, with their digests as they are now."""
    names = dict.fromkeys(test.partition("::")[0] for test in tests)
    scenarios = []
    for name in names:
        if not name.endswith(".scenario.toml"):
            continue
        path = Path(name)
        digest = "not found from the current folder"
        try:
            if path.is_file():
                digest = sha256_of(path)
        except OSError as error:
            digest = f"cannot be read: {error.strerror}"
        scenarios.append({"file": name, "sha256": digest})
    return scenarios
