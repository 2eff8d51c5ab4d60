"""What a run of the suite found, for people and for programs."""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from html import escape
from itertools import groupby

from hil_bench.machine.conformance.check import Impact
from hil_bench.machine.conformance.suite import Outcome, Result

_MARKUP = re.compile(r"[\\`\[\]]")
_MARKS = {Outcome.PASSED: "ok", Outcome.FAILED: "**FAILED**", Outcome.NOT_APPLICABLE: "–"}

_ALLOWED = {
    Impact.READ: "reading only",
    Impact.WRITE: "reading and writing",
    Impact.STORE: "reading, writing and storing",
}


def line(result: Result) -> str:
    """Return one result as a line of text."""
    detail = f": {result.detail}" if result.detail else ""
    return f"{result.outcome.value:14}  {result.check.clause:11}  {result.check.text}{detail}"


def summary(results: Sequence[Result]) -> str:
    """Return how many checks came out how."""
    counts = Counter(result.outcome for result in results)
    return ", ".join(f"{counts[outcome]} {outcome.value}" for outcome in Outcome)


def failures(results: Sequence[Result]) -> list[Result]:
    """Return what the device does not do as it should."""
    return [result for result in results if result.outcome is Outcome.FAILED]


def markdown(
    results: Sequence[Result], *, device: str, allowed: Impact, command: str | None = None
) -> str:
    """Return a report.

    Args:
        results: of one run.
        device: what was tested, in a line.
        allowed: the most that a check was allowed to do to it.
        command: what makes this report again, where it is worth telling.
    """
    return "\n".join(_report(results, device, allowed, command)) + "\n"


def as_json(results: Sequence[Result]) -> list[dict[str, str]]:
    """Return the results as what `json` can write."""
    return [
        {
            "chapter": result.chapter,
            "clause": result.check.clause,
            "check": result.check.text,
            "impact": result.check.impact.name.lower(),
            "outcome": result.outcome.value,
            "detail": result.detail,
        }
        for result in results
    ]


def _report(
    results: Sequence[Result], device: str, allowed: Impact, command: str | None
) -> Iterator[str]:
    yield "# CANopen conformance report"
    yield ""
    tested = f"{_plain(device)}; {_ALLOWED[allowed]}"
    yield f"{tested}. Clauses without a document are those of CiA 301 (4.2.0)."
    yield ""
    yield f"**{summary(results)}**"
    if command:
        yield from ("", "```sh", command, "```")
    failed = failures(results)
    if failed:
        yield from ("", "## What fails", "")
        yield from (f"- {r.check.clause}: {r.check.text}. {_cell(r.detail)}" for r in failed)
    for chapter, group in groupby(results, key=lambda result: result.chapter):
        yield from (
            "",
            f"## {chapter}",
            "",
            "| clause | what is right | | found |",
            "|---|---|---|---|",
        )
        for result in group:
            cells = result.check.clause, result.check.text, _MARKS[result.outcome], result.detail
            yield f"| {' | '.join(map(_cell, cells))} |"


def _cell(text: str) -> str:
    """Return text that can stand in a table."""
    return _plain(text).replace("|", "\\|")


def _plain(text: str) -> str:
    """Return text as Markdown that shows it as it is: what a device says is no HTML and no link."""
    return _MARKUP.sub(r"\\\g<0>", escape(" ".join(text.split()), quote=False))
