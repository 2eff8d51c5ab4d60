"""The report of scenarios and judged recordings: what stands in it, and that it stays text."""

import base64
import importlib.util
import json
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import numpy as np
import pytest
from support.expectations import TICK

from hil_bench.abilities.recording.report import RecordingWish
from hil_bench.abilities.scenario import picture
from hil_bench.abilities.scenario import report as report_module
from hil_bench.abilities.scenario.examination import Examination
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.run import PlayOptions, play, prepare
from hil_bench.cli import main
from hil_bench.cli.exit_codes import ExitCode

HEAD = "duration_s = 0.03\n"
HOSTILE = r"<script>alert('x')</script> & $\frac{1$ ]]> --> \u0001"


class Page(HTMLParser):
    """The elements and the text of a page."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.links, self.words = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for key, value in attrs if key in {"href", "src"}]

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())

    @property
    def pictures(self):
        found = [link.partition("base64,")[2] for link in self.links if link.startswith("data:")]
        return [base64.b64decode(each) for each in found]


@pytest.fixture
def draws():
    """Ask for real pictures."""


@pytest.fixture(autouse=True)
def _drawn(request, monkeypatch):
    """Draw for those tests alone that look at pictures: it takes a second each."""
    if "draws" not in request.fixturenames:
        monkeypatch.setattr(report_module, "draw_scene", lambda _scene: b"<svg/>")


def scenario(tmp_path, *that, name="a", title="T", more="", ids=()):
    path = tmp_path / f"{name}.scenario.toml"
    wanted = "".join(f"[[expect]]\nid = {json.dumps(i)}\nthat = '{text}'\n" for i, text in that)
    listed = f"requirement_ids = {json.dumps(list(ids))}\n"
    path.write_text(f"title = {json.dumps(title)}\n{HEAD}{listed}{more}{wanted}")
    return path


def report(tmp_path, *words):
    file = tmp_path / "r.html"
    code = main([*map(str, words), "--report", str(file), "-q"])
    content = json.loads(file.with_suffix(".json").read_text())
    return code, Page(file.read_text()), content


def test_a_failure_has_its_times_frames_and_picture(tmp_path):
    """NMT start of node 1 is frame 000#0101 (CiA 301); at 0 bar no pressure is below 0."""
    step = '[[step]]\nat_s = 0.005\nnmt = "start"\ntarget = "valve"\n'
    path = scenario(tmp_path, ("R1", "always from 6 ms to 9 ms axis1.P_A < 0 bar"), more=step)
    code, page, content = report(tmp_path, "test", path)
    assert code == ExitCode.CHECK_FAILED
    ((proof,),) = [chapter["proofs"] for chapter in content["chapters"]]
    assert proof["exhibit"]["violated"] == [[pytest.approx(0.006), pytest.approx(0.010)]]
    lines = [line for table in proof["exhibit"]["frames"] for line in table["lines"]]
    (start,) = [line for line in lines if line["raw"] == "000#0101"]
    assert (start["time"], start["direction"]) == (pytest.approx(0.005), "to the bench")
    assert (start["name"], start["meaning"]) == ("NMT", "start, node 1")
    assert "000#0101 to the bench NMT start, node 1" in page.text
    assert f"hil-bench test {path} --seed 1" in page.text
    assert page.pictures == [b"<svg/>"]


def test_of_two_requirements_in_one_the_times_of_both_are_shown(tmp_path):
    """At rest no pressure is below 0."""
    both = " and ".join(
        f"(always from {begin} ms to {end} ms axis1.{name} < 0 bar)"
        for name, begin, end in (("P_A", 6, 9), ("P_B", 20, 21))
    )
    _, _, content = report(tmp_path, "test", scenario(tmp_path, ("R1", both)))
    assert content["chapters"][0]["proofs"][0]["exhibit"]["violated"] == [
        [pytest.approx(0.006), pytest.approx(0.010)],
        [pytest.approx(0.020), pytest.approx(0.022)],
    ]


def test_a_word_that_stays_is_no_news_where_the_frames_begin(tmp_path, monkeypatch):
    """The valve of "manual" is ACTIVE from its start on: its PDOs are cyclic at 400 ms."""
    monkeypatch.setattr(report_module, "_BEFORE", 50_000_000)
    monkeypatch.setattr(report_module, "_KNOWN", 100_000_000)
    text = "always from 400 ms to 410 ms axis1.P_A < 0 bar"
    manual = '[controller]\nexample = "manual"\n'
    path = scenario(tmp_path, ("R1", text), more=manual)
    path.write_text(path.read_text().replace(HEAD, "duration_s = 0.5\n"))
    _, _, content = report(tmp_path, "test", path)
    ((proof,),) = [chapter["proofs"] for chapter in content["chapters"]]
    around, cyclic = proof["exhibit"]["frames"]
    assert not [line for line in around["lines"] if "PDO" in line["name"]]
    assert {line["name"] for line in cyclic["lines"]} >= {"SYNC", "valve TPDO1"}


def test_what_passes_needs_no_picture(tmp_path):
    path = scenario(tmp_path, ("R1", "always axis1.P_A < 250 bar"))
    code, page, content = report(tmp_path, "test", path)
    assert (code, content["outcome"]) == (ExitCode.DONE, "passed")
    assert page.pictures == []


def test_requirements_are_traced_through_all_runs(tmp_path):
    """The worst verdict and the lowest margin count; what nobody expects is not judged."""
    one = scenario(tmp_path, ("R1", "always axis1.P_A < 250 bar"), ids=["R1", "R9"])
    two = scenario(
        tmp_path,
        ("R1", "always axis1.P_A < 1 bar"),
        ("R2", "whenever axis1.P_A > 250 bar then axis1.P_B > 1 bar"),
        name="b",
    )
    _, page, content = report(tmp_path, "test", one, two)
    rows = {row["id"]: row for row in content["requirements"]}
    assert list(rows) == ["R1", "R9", "R2"]
    assert rows["R1"]["cells"] == ["passed", "failed"]
    assert (rows["R1"]["outcome"], rows["R1"]["proven"]) == ("failed", [1])
    margins = [chapter["proofs"][0]["judgement"]["margin"] for chapter in content["chapters"]]
    assert rows["R1"]["margin"] == margins[1] < 0 < margins[0]
    assert rows["R9"]["cells"] == ["not judged", ""]
    assert rows["R2"]["cells"] == ["", "not exercised"]
    assert "R9 not judged" in page.text


def test_a_run_that_fails_is_a_problem(tmp_path):
    more = '[controller]\nfirmware = ["/no/such"]\n'
    path = scenario(tmp_path, ("R1", "always axis1.P_A < 250 bar"), more=more)
    code, page, content = report(tmp_path, "test", path)
    assert (code, content["outcome"]) == (ExitCode.USAGE, "failed")
    assert "/no/such: cannot be started" in page.text


def test_names_and_texts_stay_text(tmp_path):
    path = scenario(
        tmp_path, (HOSTILE, "always axis1.P_A < 1 bar"), title=HOSTILE, name="<img src=x>"
    )
    _, page, _ = report(tmp_path, "test", path)
    assert not {"script", "iframe", "object", "link"} & set(page.tags)
    assert page.tags.count("img") == 1
    assert page.text.count("<script>alert('x')</script>") >= 4


def test_the_file_needs_nothing_from_elsewhere(tmp_path):
    path = scenario(tmp_path, ("R1", "always axis1.P_A < 1 bar"))
    _, page, _ = report(tmp_path, "test", path)
    assert all(link.startswith(("#", "data:image/svg+xml;base64,")) for link in page.links)


@pytest.mark.long
@pytest.mark.usefixtures("draws")
def test_two_reports_are_the_same(tmp_path):
    path = scenario(tmp_path, ("R1", "always axis1.P_A < 1 bar"))
    texts = []
    for _ in range(2):
        _, page, _ = report(tmp_path, "test", path)
        texts.append((tmp_path / "r.html").read_bytes())
        (drawn,) = page.pictures
        assert ET.fromstring(drawn).tag.endswith("svg")  # noqa: S314 - our own
    assert texts[0] == texts[1]


@pytest.mark.usefixtures("draws")
def test_names_in_pictures_are_no_mathematics(tmp_path):
    """A recording names its signals as it likes; an odd formula would be an error of matplotlib."""
    name = r"$\frac{1$ 測 <b>"
    rows = "".join(f"{k * 0.001:.3f},{k}\n" for k in range(5))
    (tmp_path / "r.csv").write_text(f'time,"{name}"\ns,-\n{rows}')
    wanted = f"[[expect]]\nid = \"R\"\nthat = '''always '{name}' < 3'''\n"
    (tmp_path / "q.toml").write_text(wanted)
    code, page, content = report(tmp_path, "judge", tmp_path / "q.toml", tmp_path / "r.csv")
    assert code == ExitCode.CHECK_FAILED
    assert content["chapters"][0]["proofs"][0]["exhibit"]["violated"] == [
        [pytest.approx(0.003), pytest.approx(0.005)]
    ]
    ET.fromstring(page.pictures[0])  # noqa: S314 - our own


def test_a_judged_recording_shows_its_own_frames(tmp_path):
    """The boot-up of node 1 is 701#00 (CiA 301), at the first tick."""
    path = scenario(tmp_path, ("R1", "always axis1.P_A < 1 bar"))
    wish = RecordingWish((tmp_path / "run.mf4",))
    play(prepare(load_scenario(path)), PlayOptions(record=wish))
    _, page, content = report(tmp_path, "judge", path, tmp_path / "run.mf4")
    ((proof,),) = [chapter["proofs"] for chapter in content["chapters"]]
    (table,) = proof["exhibit"]["frames"]
    boots = [line for line in table["lines"] if line["raw"] == "701#00"]
    assert [line["name"] for line in boots] == ["node 1 heartbeat"]
    assert f"hil-bench judge {path} {tmp_path / 'run.mf4'}" in page.text


@pytest.mark.parametrize(
    ("name", "wrong"),
    [("r.pdf", "give the name of an .html file"), ("no/r.html", "there is no folder")],
)
def test_a_report_that_cannot_be_is_refused_before_the_run(tmp_path, cli, name, wrong):
    path = scenario(tmp_path, ("R1", "always axis1.P_A < 1 bar"))
    found = cli(["test", str(path), "--report", str(tmp_path / name)], ExitCode.USAGE)
    assert wrong in found.err
    assert found.out == ""


def test_a_report_needs_jinja(tmp_path, capsys, monkeypatch):
    real = importlib.util.find_spec
    monkeypatch.setattr(
        "hil_bench.abilities.scenario.verbs.scenario_report.find_spec",
        lambda name: None if name == "jinja2" else real(name),
    )
    path = scenario(tmp_path, ("R1", "always axis1.P_A < 1 bar"))
    assert main(["test", str(path), "--report", str(tmp_path / "r.html")]) == ExitCode.USAGE
    assert "--report needs Jinja2: pip install 'hil-bench[report]'" in capsys.readouterr().err


def test_a_picture_shades_fault_and_violation_and_marks_the_instant(tmp_path):
    """The file says when the fault is; the requirement is violated at ticks 10 to 12."""
    step = '[[step]]\nat_s = 0.004\nfault = "drop_supply"\ntarget = "axis1"\npressure_bar = 20\n'
    text = "always from 10 ms to 12 ms axis1.P_A < 0 bar"
    path = scenario(tmp_path, ("R1", text), more=f"{step}for_s = 0.003\n")
    found = play(prepare(load_scenario(path)), PlayOptions(keeps_evidence=True))
    (finding,) = found.findings
    examination = Examination(
        finding.requirement.condition, found.evidence.columns, found.evidence.ticks, TICK
    )
    spans = [(0.010, 0.013)]
    assert examination.violated_spans() == [(10, 12)]
    instant = finding.judgement.deciding.time
    assert 0.010 <= instant <= 0.012
    node = examination.find_cause().node
    scene = picture.Scene(
        finding.requirement.condition, node, instant, tuple(spans), found.evidence
    )
    figure = picture._figure(scene)
    (margin,) = (each for each in figure.axes if each.get_ylabel().startswith("Margin"))
    filled = np.concatenate([p.vertices for c in margin.collections for p in c.get_paths()])
    # It is below zero all the run, and counts at ticks 10 to 12 alone.
    assert (filled[:, 0].min(), filled[:, 0].max()) == pytest.approx((0.010, 0.012))
    words = [(text.get_text(), text.xy[0]) for text in figure.axes[0].texts]
    assert words == [(" drop_supply axis1", pytest.approx(0.004)), (" violated", 0.010)]
    for place in figure.axes:
        boxes = [patch.get_bbox() for patch in place.patches if hasattr(patch, "get_bbox")]
        shaded = [(box.x0, box.x1) for box in boxes]
        assert shaded == [pytest.approx((0.004, 0.007)), pytest.approx(spans[0])]
        assert place.lines[-1].get_xdata()[0] == instant


def test_a_report_that_cannot_be_written_is_a_line(tmp_path, capsys):
    (tmp_path / "r.html").symlink_to("gone/r.html")  # seen only when it is written
    path = scenario(tmp_path, ("R1", "always axis1.P_A < 250 bar"))
    assert main(["test", str(path), "--report", str(tmp_path / "r.html")]) == ExitCode.USAGE
    assert "r.html: cannot be written: No such file or directory" in capsys.readouterr().err


def test_a_report_says_how_much_was_seen(tmp_path):
    """The recording has rows from 0 to 0.015 s of 0.03 s."""
    rows = "".join(f"{k / 1000},{2e7}\n" for k in range(16))
    (tmp_path / "run.csv").write_text("time,axis1.P_A\ns,Pa\n" + rows)
    equal = "R2", "always axis1.P_A <= 200 bar"
    path = scenario(tmp_path, ("R1", "always axis1.P_A < 250 bar"), equal)
    code, page, content = report(tmp_path, "judge", path, tmp_path / "run.csv")
    assert code == ExitCode.INCONCLUSIVE
    assert "Seen Why R1 inconclusive 50 % nothing seen after 0.015 s; seen 0.015 of" in page.text
    proof, _ = content["chapters"][0]["proofs"]
    assert proof["judgement"]["coverage"]["seen"] == 0.015
    gone = tmp_path / "gone.csv"
    path.write_text(path.read_text().replace("0.03", "0.015"))
    code, page, content = report(tmp_path, "judge", path, tmp_path / "run.csv", gone)
    assert (code, content["outcome"]) == (ExitCode.USAGE, "inconclusive")
    assert f"{gone}: cannot be read: No such file" in page.text
    assert "R2 passed +0 100 %" in page.text
    path.write_text(path.read_text().replace("0.015", "0.03"))
    late = ["judge", path, tmp_path / "run.csv", "--start", "-0.02"]
    _, page, _ = report(tmp_path, *late)
    assert "Judged its rows are from 0 to 0.015 s; judged are -0.02 to 0.01 s" in page.text


@pytest.mark.usefixtures("draws")
def test_a_small_violation_of_a_long_motion_is_seen(tmp_path, monkeypatch):
    """0.1 mm beyond a limit, of 70 mm, every 10 ms: the panel ends near the violation."""
    figures = []
    draw = picture._figure
    monkeypatch.setattr(
        picture, "_figure", lambda scene: figures.append(draw(scene)) or figures[-1]
    )
    rows = "".join(f"{row / 100},{height}\n" for row, height in enumerate([0, 35, 70, 35, 0]))
    (tmp_path / "run.csv").write_text(f"time,lift.height\ns,mm\n{rows}")
    (tmp_path / "r.toml").write_text(
        '[[expect]]\nid = "R"\nthat = "always lift.height < 69.9 mm"\n'
    )
    report = ["--report", str(tmp_path / "r.html")]

    assert main(["judge", str(tmp_path / "r.toml"), str(tmp_path / "run.csv"), *report]) == 1
    (figure,) = figures
    (place,) = [each for each in figure.axes if each.get_ylabel() == "Margin [mm]"]
    low, high = place.get_ylim()
    assert place.lines[0].get_ydata().min() == pytest.approx(-0.1)
    assert place.lines[0].get_xdata() == pytest.approx([0.0, 0.01, 0.02, 0.03, 0.04])
    assert low < -0.1
    assert len({each.get_xlim() for each in figure.axes}) == 1  # one time for all panels
    assert 0.1 / (high - low) > 0.1  # a tenth of the panel's height at least
