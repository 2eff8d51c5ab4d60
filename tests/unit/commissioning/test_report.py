"""The report's text; what it looks like in a browser was looked at."""

import html
import re

import numpy as np
import pytest

from hil_bench.abilities.commissioning.identity import NodeDescription
from hil_bench.abilities.commissioning.measures import (
    SAMPLE_CHANNELS,
    Curve,
    Diagnosis,
    Measure,
    StepResult,
    Verdict,
)
from hil_bench.abilities.commissioning.report import ReportHead, write_report
from hil_bench.abilities.commissioning.session import Commissioning
from hil_bench.abilities.common.page import POLICY
from hil_bench.outside.recording.channels import TIME, recording_dtype

HEAD = ReportHead("Report of <axis 1>", {"date": "2026-01-02", "plan": "a|b.toml"})


def found():
    trace = np.zeros(10, dtype=recording_dtype((TIME, *SAMPLE_CHANNELS)))
    line = np.linspace(1.0, 10.0, 5)
    curve = Curve("Gain", "Frequency [Hz]", "Gain [dB]", line, line, line, line, is_frequency=True)
    ramp = StepResult(
        "ramp",
        Verdict.FAILED,
        [
            Measure("P_A", 50e5, "Pa", 0.0, 40e5),
            Measure("speed", 0.1, "m/s", low=0.05),
            Measure("load force", -12.5, "N"),
        ],
        [Diagnosis("valve inverted", "speed < 0", "exchange the hoses")],
        trace=trace,
        curves=[curve],
    )
    ramp.notes.append("a heartbeat is <off>")
    chirp = StepResult("chirp", Verdict.NOT_RUN, problem="step ramp failed")
    node = NodeDescription(4, "OPERATIONAL", False, 0x196, 1, 2, 3, 4, "encoder")
    return Commissioning("axis1", (ramp, chirp), (node,), 0)


@pytest.fixture
def no_plot(monkeypatch):
    monkeypatch.setattr(
        "hil_bench.abilities.commissioning.report.importlib.util.find_spec", lambda _: None
    )


@pytest.mark.usefixtures("no_plot")
def test_both_say_the_same(tmp_path):
    markdown, page = write_report(tmp_path, found(), HEAD)
    text = html.unescape(markdown.read_text(encoding="utf-8"))
    assert f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">' in page.read_text()
    plain = html.unescape(re.sub(r"<[^>]+>", " ", page.read_text(encoding="utf-8")))
    for fact in (
        "Report of <axis 1>",
        "2026-01-02",
        "valve inverted",
        "speed < 0",
        "exchange the hoses",
        "a heartbeat is <off>",
        "50 bar",
        "0 to 40 bar",
        "100 mm/s",
        "from 50 mm/s",
        "-0.0125 kN",
        "not run",
        "step ramp failed",
        "0x00000003",
        "CiA 406, encoder",
    ):
        assert fact in text
        assert fact in plain
    assert "| P_A | 50 bar | 0 to 40 bar | FAIL |" in text
    assert "| plan | a\\|b.toml |" in text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["report.html", "report.md"]


@pytest.mark.usefixtures("no_plot")
def test_what_a_device_says_is_no_markup_in_either(tmp_path):
    hostile = "<img src=x onerror=alert(1)>|[go](http://x)`\\"
    node = NodeDescription(4, "OPERATIONAL", False, 0x196, 1, 2, 3, 4, hostile)
    step = StepResult("sensors", Verdict.STOPPED, problem=f"{hostile}\n# not a heading")
    step.notes.append(hostile)
    step.findings.append(Diagnosis(hostile, hostile, hostile))
    markdown, page = write_report(
        tmp_path,
        Commissioning("axis1", (step,), (node,), 0),
        ReportHead(hostile, {"plan": hostile}),
    )
    text = markdown.read_text(encoding="utf-8")
    # GFM: a backslash makes the next character plain; &lt; is "<" and begins no tag.
    assert text.startswith("# &lt;img src=x onerror=alert(1)&gt;|\\[go\\](http://x)\\`\\\\\n")
    cell = "&lt;img src=x onerror=alert(1)&gt;\\|\\[go\\](http://x)\\`\\\\"
    assert f"| 4 | {cell} | CiA 406" in text
    assert f"| plan | {cell} |" in text
    for file in (text, page.read_text(encoding="utf-8")):
        assert "<img src=x" not in file
    assert not re.search(r"(?<!\\)[`\[\]]", text)
    assert text.count("\n#") == 3  # Steps, Nodes, the step: none by a device


def test_pictures_stand_in_both(tmp_path):
    paths = write_report(tmp_path, found(), HEAD)
    assert [path.name for path in paths] == ["report.md", "report.html", "ramp.png"]
    assert "![Slow ramp both ways](ramp.png)" in paths[0].read_text(encoding="utf-8")
    assert 'src="data:image/png;base64,iVBOR' in paths[1].read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("measure", "is_right"),
    [
        (Measure("x", 1.0, "m"), True),
        (Measure("x", float("nan"), "m"), True),
        (Measure("x", float("nan"), "m", high=1.0), False),
        (Measure("x", 1.0, "m", 1.0, 1.0), True),
        (Measure("x", 1.1, "m", 1.0, 1.0), False),
    ],
)
def test_a_measure_is_right_within_its_limits(measure, is_right):
    assert measure.is_right is is_right


def test_what_could_not_be_told_is_no_failure_and_no_pass():
    unknown, wrong = Measure("x", float("nan"), "m", high=1.0), Measure("y", 2.0, "m", high=1.0)
    for measures, verdict in (([unknown], "inconclusive"), ([unknown, wrong], "failed")):
        result = StepResult("ramp", measures=measures)
        result.judge()
        assert result.verdict == verdict


def test_a_step_fails_by_a_measure_or_a_finding_but_stays_stopped():
    wrong = Measure("x", 2.0, "m", high=1.0)
    for result, verdict in (
        (StepResult("ramp"), Verdict.PASSED),
        (StepResult("ramp", measures=[wrong]), Verdict.FAILED),
        (StepResult("ramp", findings=[Diagnosis("a", "b", "c")]), Verdict.FAILED),
        (StepResult("ramp", Verdict.STOPPED, measures=[wrong]), Verdict.STOPPED),
    ):
        result.judge()
        assert result.verdict is verdict


def test_a_value_out_of_its_limits_is_not_rounded_into_them():
    expected = {0.599996: "60 %", 0.600004: "60.0004 %", 0.323: "32.3 %"}
    assert {
        value: Measure("dead band", value, "-", 0.3231, 0.6).text() for value in expected
    } == expected
