"""Reports: what fails first, and every result in a table."""

import pytest

from hil_bench.abilities.conformance import report
from hil_bench.abilities.conformance.check import Check, Impact
from hil_bench.abilities.conformance.suite import CHAPTERS, Outcome, Result
from hil_bench.canopen_device.eds_document import EdsFinding, Severity


def result(outcome, detail="", chapter="SDO upload", clause="7.2.4.3.6"):
    check = Check(clause, "this is right", Impact.READ, lambda _dut: None)
    return Result(chapter, check, outcome, detail)


RESULTS = [
    result(Outcome.PASSED, "4 bytes"),
    result(Outcome.FAILED, "a | b; c is right", clause="7.2.4.3.7"),
    result(Outcome.NOT_APPLICABLE, "no RPDO", chapter="RPDO"),
]


def test_markdown_names_what_fails_before_all_else():
    text = report.markdown(RESULTS, device="Node 5, device.eds", allowed=Impact.WRITE)
    lines = text.splitlines()
    assert "Node 5, device.eds; reading and writing." in lines[2]
    assert "This is no certificate" in lines[3]
    assert lines[5] == "**1 passed, 1 failed (1 required), 1 not applicable; EDS: no findings**"
    assert lines.index("## What fails") < lines.index("### SDO upload") < lines.index("### RPDO")
    assert "- 7.2.4.3.7 (required): this is right. a \\| b; c is right" in lines
    assert "| 7.2.4.3.6 | required | this is right | ok | 4 bytes |" in lines
    assert "| 7.2.4.3.7 | required | this is right | **FAILED** | a \\| b; c is right |" in lines


def test_the_order_is_that_of_the_test_that_certifies():
    """EDS, SDO and PDO, object dictionary, SYNC and errors, NMT, storing; however they were run."""
    every = [result(Outcome.PASSED, chapter=chapter.title) for chapter in CHAPTERS]
    text = report.markdown(every, device="d", allowed=Impact.STORE)
    assert [line for line in text.splitlines() if line.startswith("## ")] == [
        "## 1. Electronic data sheet",
        "## 2. SDO and PDO",
        "## 3. Object dictionary",
        "## 4. SYNC, emergency and error control",
        "## 5. NMT state machine",
        "## 6. Store and restore",
        "## 7. Node-ID and bit rate",
        "## How open clauses are read",
    ]
    assert text.count("| 7.2.4.3.6 |") == len(CHAPTERS)


def test_findings_of_the_eds_stand_first():
    findings = [
        EdsFinding(12, "1018sub2", "no default | none"),
        EdsFinding(30, "", "x", Severity.ERROR),
    ]
    text = report.markdown(RESULTS[:1], device="d", allowed=Impact.READ, eds=findings)
    assert "EDS: 1 error, 1 warning**" in text
    assert "| 12 | warning | 1018sub2 | no default \\| none |" in text
    assert text.index("| 12 |") < text.index("| 7.2.4.3.6 |")


def test_what_a_device_says_is_no_markup():
    text = report.markdown(
        [result(Outcome.FAILED, "it says <b>|[x](y)\n`")],
        device="Node 5: <script>",
        allowed=Impact.READ,
    )
    assert "Node 5: &lt;script&gt;; reading only." in text
    assert "it says &lt;b&gt;\\|\\[x\\](y) \\` |" in text
    assert "<" not in text


def test_markdown_of_a_device_without_failures():
    text = report.markdown(RESULTS[:1], device="d", allowed=Impact.READ, command="make it")
    assert "What fails" not in text
    assert "```sh\nmake it\n```" in text


def test_json_has_every_result():
    assert report.as_json(RESULTS)[1] == {
        "chapter": "SDO upload",
        "clause": "7.2.4.3.7",
        "degree": "required",
        "check": "this is right",
        "impact": "read",
        "outcome": "failed",
        "detail": "a | b; c is right",
    }


def test_a_line_of_text():
    assert report.line(RESULTS[2]) == (
        "not applicable  required     7.2.4.3.6    this is right: no RPDO"
    )


@pytest.mark.parametrize("name", ["device.html", "device.HTM"])
def test_a_report_is_no_web_page(tmp_path, cli, name):
    said = cli(f"conformance --virtual --node-id 1 --report {tmp_path / name}", code=2)
    assert said.err.endswith(f"{name}: the report is Markdown; give FILE.md\n")
    assert [*tmp_path.iterdir()] == []
