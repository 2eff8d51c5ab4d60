"""From requirement to test to result: the files that test runs left behind."""

import hashlib
import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from hil_bench.abilities.evidence.content import WORST_FIRST
from hil_bench.abilities.evidence.versions import sha256_of
from hil_bench.errors import ConfigError, about_file

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
            "outcome": _worst([row.outcome for row in with_id if row.requirement == requirement]),
            "tests": [row._asdict() for row in with_id if row.requirement == requirement],
        }
        for requirement in dict.fromkeys(row.requirement for row in with_id)
    ]
    return {
        "verdict": _verdict(rows),
        "files": [
            {"file": str(file.path), "sha256": hashlib.sha256(file.content).hexdigest()}
            for file in files
        ],
        "scenarios": _scenarios(row.test for row in rows),
        "requirements": requirements,
        "without_requirement": [row._asdict() for row in rows if not row.requirement],
    }


def _worst(outcomes: Sequence[str]) -> str:
    return next(outcome for outcome in WORST_FIRST if outcome in outcomes)


def _verdict(rows: Sequence[Row]) -> str:
    if not rows:
        return "not applicable"
    return _worst([row.outcome for row in rows])


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
    if problem and not declared:
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
    for case in root.iter("testcase"):
        properties = {each.get("name", ""): each.get("value", "") for each in case.iter("property")}
        outcome, reason = _junit_outcome(case)
        yield Row(
            properties.get("requirement_id", ""),
            properties.get("expectation", ""),
            f"{case.get('classname', '')}::{case.get('name', '')}",
            _worst([outcome, _known(properties.get("outcome", outcome))]),
            reason or properties.get("deciding", ""),
            str(file.path),
        )


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
