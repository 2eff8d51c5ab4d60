"""The report on a run of the suite, for people and for programs."""

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Final

from hil_bench.abilities.common.page import cell, plain
from hil_bench.abilities.conformance.check import Degree, Impact
from hil_bench.abilities.conformance.suite import Outcome, Result
from hil_bench.canopen_device.eds_document import EdsFinding

# Clauses that careful readers understand in more than one way, and how the checks read them.

_TEXT: Final = """\
7.2.4.3.1: no clause says what a server does with a request that is a byte short: silence, an abort,
and the answer, where index and sub-index are there, all pass.

7.2.4.3.3: a server may take an expedited download without a size, or abort it: both pass.

7.2.4.3.10, 7.2.4.3.14: no clause names the abort code for a segment number that does not fit, in
an upload or in a download: 0504 0003h (invalid sequence number) and 0504 0001h (command specifier
not valid) both pass.

7.2.4.3.11: no clause names the abort code for a block download that ends with fewer bytes than
announced: 0607 001xh and 0504 0001h pass.

7.2.4.3.14: no clause says what a server does where the client confirms more segments than were
sent: it may take that as all that were sent, and go on.

7.2.4.3.17: a server may leave a segment out whose toggle bit is wrong, as one that it has already;
it must not take it.

7.2.4.3.17: no clause says how long a server waits for its client: a server that waits longer than
the check does is not judged; one that gives up says 0504 0000h.

7.2.7.1: no clause says when a communication error is over: a device may keep it until a reset. Then
1001h shows it as long, and there is no EMCY 0000h.

7.2.8.3.2.1: no clause says whether node guarding is answered while 100Ch and 100Dh are 0: where it
is not, it is asked for with both set.

7.3.2.2.3: a device may leave OPERATIONAL by an error of its own (1029h). One check fails all the
same and names the cause, for nothing that needs OPERATIONAL can be seen then; the checks of that
are not run, and not passed.

7.5.2.4: beyond the number of errors, 0609 0011h of older editions passes as well as 0800 0024h.

7.5.2.35: a device may use the event timer of an RPDO to watch it: EMCY 8250h is recommended.

CiA 305, identify remote slave: a slave that is selected by its address and says nothing to this
does not have the service: not applicable. So it is with configure bit timing.
"""

DISPUTES: Final = tuple(" ".join(entry.split()) for entry in _TEXT.split("\n\n"))
"""A clause and its reading each, in the order of the clauses; other documents come last."""


_MARKS = {
    Outcome.PASSED: "ok",
    Outcome.FAILED: "**FAILED**",
    Outcome.NOT_FOLLOWED: "not followed",
    Outcome.NOT_RUN: "not run",
    Outcome.NOT_APPLICABLE: "–",
}

_SECTIONS = {
    "SDO and PDO": (
        "SDO upload",
        "SDO download",
        "SDO block transfer",
        "TPDO",
        "RPDO",
        "PDO parameters",
        "PDO mapping",
    ),
    "Object dictionary": ("Object dictionary",),
    "SYNC, emergency and error control": ("SYNC and TIME", "EMCY", "Error control"),
    "NMT state machine": ("NMT",),
    "Store and restore": ("Store and restore",),
    "Node-ID and bit rate": ("LSS",),
}
"""Chapters in the order in which CiA lists the major tests of its conformance test tool [1]_.

The EDS comes before these. The last one stands there as an advice, not as a test.

.. [1] https://can-cia.org/services/canopen-device-conformance-testing
"""

_NO_CERTIFICATE = (
    "In the order of CiA's conformance test, to prepare a device for it. This is no certificate: "
    "the checks are this project's reading of the standards."
)

_ALLOWED = {
    Impact.READ: "reading only",
    Impact.WRITE: "reading and writing",
    Impact.STORE: "reading, writing and storing",
}


def line(result: Result) -> str:
    """Return one result as a line of text."""
    detail = f": {result.detail}" if result.detail else ""
    check = result.check
    begin = f"{result.outcome.value:14}  {check.degree.value:11}  {check.clause:11}"
    return f"{begin}  {check.text}{detail}"


def summary(results: Sequence[Result]) -> str:
    """Return the number of checks by outcome, and of those that failed by degree."""
    counts = Counter(result.outcome for result in results)
    always = Outcome.PASSED, Outcome.FAILED, Outcome.NOT_APPLICABLE
    words = {o: f"{counts[o]} {o.value}" for o in Outcome if counts[o] or o in always}
    degrees = Counter(result.check.degree for result in failures(results))
    if degrees:
        by_degree = ", ".join(f"{degrees[d]} {d.value}" for d in Degree if degrees[d])
        words[Outcome.FAILED] += f" ({by_degree})"
    return ", ".join(words.values())


def not_run(results: Sequence[Result]) -> list[str]:
    """Return a line for each cause by which checks were not run, with their number."""
    causes = Counter(result.detail for result in results if result.outcome is Outcome.NOT_RUN)
    return [f"{n} check{'s' * (n > 1)} not run: {cause}" for cause, n in causes.items()]


def failures(results: Sequence[Result]) -> list[Result]:
    """Return the failed checks."""
    return [result for result in results if result.outcome is Outcome.FAILED]


def markdown(
    results: Sequence[Result],
    *,
    device: str,
    allowed: Impact,
    eds: Sequence[EdsFinding] = (),
    command: str | None = None,
) -> str:
    """Return a report.

    Args:
        results: of one run.
        device: what was tested, in a line.
        allowed: the most that a check was allowed to do to it.
        eds: what is wrong in the device's EDS file.
        command: what makes this report again, where it is worth telling.
    """
    return "\n".join(_report(results, device, allowed, eds, command)) + "\n"


def as_json(results: Sequence[Result]) -> list[dict[str, str]]:
    """Return the results as what `json` can write."""
    return [
        {
            "chapter": result.chapter,
            "clause": result.check.clause,
            "degree": result.check.degree.value,
            "check": result.check.text,
            "impact": result.check.impact.name.lower(),
            "outcome": result.outcome.value,
            "detail": result.detail,
        }
        for result in results
    ]


def _report(
    results: Sequence[Result],
    device: str,
    allowed: Impact,
    eds: Sequence[EdsFinding],
    command: str | None,
) -> Iterator[str]:
    yield "# CANopen conformance report"
    yield ""
    tested = f"{plain(device)}; {_ALLOWED[allowed]}"
    yield f"{tested}. Clauses without a document are those of CiA 301 (4.2.0)."
    yield _NO_CERTIFICATE
    yield ""
    yield f"**{summary(results)}; {_count_findings(eds)}**"
    if command:
        yield from ("", "```sh", command, "```")
    failed = failures(_sorted(results))
    if failed:
        yield from ("", "## What fails", "")
        yield from map(_failure, failed)
        yield from (f"- {cell(line)}" for line in not_run(results))
    yield from ("", "## 1. Electronic data sheet", "")
    yield from _findings(eds)
    chapters = [(title, list(group)) for title, group in groupby(_sorted(results), _chapter)]
    for number, (title, members) in enumerate(_SECTIONS.items(), start=2):
        present = [(chapter, some) for chapter, some in chapters if chapter in members]
        if present:
            yield from ("", f"## {number}. {title}")
        for chapter, some in present:
            if members != (chapter,):
                yield from ("", f"### {chapter}")
            yield from _table(some)
    yield from ("", "## How open clauses are read", "")
    yield from (f"- {reading}" for reading in DISPUTES)


def _failure(result: Result) -> str:
    check = result.check
    return f"- {check.clause} ({check.degree.value}): {check.text}. {cell(result.detail)}"


def _table(results: Sequence[Result]) -> Iterator[str]:
    yield from ("", "| clause | degree | what is right | | found |", "|---|---|---|---|---|")
    for result in results:
        check = result.check
        detail = "" if result.outcome is Outcome.NOT_RUN else result.detail
        cells = check.clause, check.degree.value, check.text, _MARKS[result.outcome], detail
        yield f"| {' | '.join(map(cell, cells))} |"


def _findings(eds: Sequence[EdsFinding]) -> Iterator[str]:
    if not eds:
        yield "`hil-bench check-eds` finds nothing."
        return
    yield from ("| line | | section | found |", "|---|---|---|---|")
    for finding in eds:
        cells = str(finding.line), finding.severity.value, finding.section, finding.text
        yield f"| {' | '.join(map(cell, cells))} |"


def _count_findings(eds: Sequence[EdsFinding]) -> str:
    counts = Counter(finding.severity.value for finding in eds)
    found = ", ".join(
        f"{count} {severity}{'s' * (count > 1)}" for severity, count in sorted(counts.items())
    )
    return f"EDS: {found or 'no findings'}"


def _sorted(results: Sequence[Result]) -> list[Result]:
    """Return results in the order of the report; those of a chapter as they were done."""
    order = [chapter for members in _SECTIONS.values() for chapter in members]
    return sorted(results, key=lambda result: order.index(result.chapter))


def _chapter(result: Result) -> str:
    return result.chapter
