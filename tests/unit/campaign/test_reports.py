"""Reports: whole without a network, whatever a title or a firmware says."""

import base64
import json
import math
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser

import matplotlib as mpl
import pytest
from matplotlib.figure import Figure
from support.campaigns import REST, margin_of, run_result, write_rest

from hil_bench import errors
from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.records import RunOutcome, Verdict, read_campaign
from hil_bench.abilities.campaign.reports import (
    LARGEST,
    Replay,
    beyond,
    bin_margins,
    replay,
    svg_of,
)
from hil_bench.abilities.campaign.snapshot import perform
from hil_bench.abilities.campaign.summary import smallest_margin, summarise, worst_runs
from hil_bench.abilities.common.figure_style import STYLE
from hil_bench.abilities.common.page import POLICY
from hil_bench.cli import main

HOSTILE = "<script>alert(1)</script> & more"
CLOSE = REST.replace("value = 250.0, range = [1.0, 301.0]", "value = 60.0, range = [20.0, 80.0]")


class Page(HTMLParser):
    """What a page shows, and what it would load."""

    def __init__(self, text):
        super().__init__()
        self.words, self.loaded, self.tags = "", [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.loaded += [v for k, v in attrs if k in {"src", "href"} and not v.startswith("#")]

    def handle_data(self, data):
        self.words += f" {data} "


@pytest.mark.long  # tens of runs of a scenario
@pytest.mark.parametrize("verb", ["campaign", "falsify"])
def test_a_report_is_whole_and_escapes_what_files_say(verb, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = CLOSE.replace('"Rest"', f'"{HOSTILE}"').replace('"R-2"', f'"R-2 {HOSTILE}"')
    path = write_rest(tmp_path, text)
    words = [verb, str(path), "--runs=16", "--jobs=0", "--report=report.html"]
    if verb == "falsify":
        words.append("--method=random")
    assert main(words) == 1
    html = (tmp_path / "report.html").read_text()
    page = Page(html)
    assert all(each.startswith("data:") for each in page.loaded)
    assert "script" not in page.tags
    assert POLICY in html
    assert HOSTILE in page.words
    for part in html.split("<svg")[1:]:
        ET.fromstring("<svg" + part.partition("</svg>")[0] + "</svg>")  # noqa: S314 - our own
    assert html.count("<svg") >= 2


@pytest.mark.parametrize("verb", ["campaign", "falsify"])
def test_a_report_that_cannot_be_is_refused_before_the_runs(verb, tmp_path, monkeypatch, capsys):
    for module in ("verbs.campaign", "snapshot"):
        monkeypatch.setattr(
            f"hil_bench.abilities.campaign.{module}.perform", lambda _spec: pytest.fail("was run")
        )
    monkeypatch.chdir(tmp_path)
    path = write_rest(tmp_path, CLOSE)
    assert main([verb, str(path), "--jobs=0", "--report=nowhere/report.html"]) == 2
    assert "there is no folder nowhere; make it first" in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["campaign", "falsify"])
def test_without_its_libraries_a_verb_says_what_to_install(verb, tmp_path, monkeypatch, cli):
    path = write_rest(tmp_path, CLOSE)
    monkeypatch.setattr(errors.importlib.util, "find_spec", lambda _: None)
    assert "pip install 'hil-bench[campaign]'" in cli([verb, str(path)], 2).err


@pytest.mark.parametrize("verb", ["campaign", "falsify"])
def test_the_verdicts_are_printed_before_a_report_that_fails(verb, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    not_drawn = Replay(b"", "not drawn here")
    monkeypatch.setattr("hil_bench.abilities.campaign.reports.replay", lambda *_: not_drawn)
    (tmp_path / "report.html").symlink_to("gone/report.html")  # seen only when it is written
    words = [str(write_rest(tmp_path, CLOSE)), "--runs=2", "--jobs=0", "--report=report.html"]
    words += ["--method=random"] * (verb == "falsify")
    assert main([verb, *words]) == 1  # R-1 fails, whatever becomes of the report
    said = capsys.readouterr()
    assert "R-1: " in said.out
    assert "report.html: " in said.err


@pytest.mark.long
def test_the_report_says_which_parameter_matters_and_what_repeats_the_worst(tmp_path):
    path = write_rest(tmp_path, CLOSE)
    report = tmp_path / "report.html"
    main(["campaign", str(path), "--runs=16", "--jobs=0", "--report", str(report)])
    words = " ".join(Page(report.read_text()).words.split())
    # The margin 1 - P_A / limit rises with the limit, and does not know the load.
    assert "rest R-1 limit_bar +1.00 16" in words
    assert words.count("rest: limit_bar=") == 10
    assert words.count("--set=limit_bar=") == 10


@pytest.mark.long
def test_the_worst_runs_are_drawn(tmp_path):
    path = write_rest(tmp_path, CLOSE)
    report = tmp_path / "report.html"
    main(["campaign", str(path), "--runs=2", "--jobs=0", "--report", str(report)])
    page = Page(report.read_text())
    assert len(page.loaded) == 2
    for each in page.loaded:
        picture = base64.b64decode(each.removeprefix("data:image/svg+xml;base64,"))
        assert ET.fromstring(picture).tag.endswith("svg")  # noqa: S314 - our own
        assert b"axis1.P_A" in picture  # R-1, whose margin is the smaller one


def test_an_undecided_run_is_worse_than_a_passed_one_and_has_no_margin():
    def result(outcome, margin):
        return run_result(Verdict("R-1", outcome, margin, ""), key=outcome)

    runs = [result("passed", 0.1), result("not exercised", 0.05), result("inconclusive", None)]
    assert [each.key for each in worst_runs(runs)] == ["inconclusive", "not exercised", "passed"]
    assert [smallest_margin(each) for each in runs] == [0.1, None, None]
    (summary,) = summarise(runs)
    assert (summary.margins, summary.tally.decided, summary.tally.runs) == ((0.1,), 1, 3)


def test_a_run_that_does_not_repeat_itself_is_not_drawn(tmp_path):
    plan = Plan(read_campaign(write_rest(tmp_path, CLOSE)))
    spec = next(iter(plan))
    result = perform(spec)
    other = result._replace(verdicts=result.verdicts[:1])
    assert "not deterministic" in replay(spec, other).problem
    cut_off = result._replace(outcome=RunOutcome.TIMED_OUT)
    assert replay(spec, cut_off) == (b"", "it did not come to its end, so it is not drawn")
    assert replay(spec, result).picture.startswith(b"<?xml")


def test_a_run_is_repeated_by_its_key_and_drawn_where_that_is_asked(tmp_path, cli):
    path = write_rest(tmp_path, CLOSE)
    specs = Plan(replace(read_campaign(path), runs=4))
    key = next(spec.key for spec in specs if margin_of(spec.values["limit_bar"]) > 0.0)
    words = ["campaign", str(path), "--runs=4", f"--run={key[:8]}"]
    plain = cli(words).out.splitlines()
    assert plain[0].startswith("rest: limit_bar=")
    assert plain[0].endswith(": passed")
    assert [line.split()[:2] for line in plain[1:]] == [["R-1", "passed"], ["R-2", "passed"]]
    picture = tmp_path / "run.svg"
    found = json.loads(cli([*words, f"--picture={picture}", "--json"]).out)
    assert (found["picture"], found["run"]["key"]) == (str(picture), key)
    assert b"axis1.P_A" in picture.read_bytes()


def test_the_table_of_a_report_has_smallest_and_median_of_the_margins(tmp_path, monkeypatch):
    monkeypatch.setattr("hil_bench.abilities.campaign.summary.worst_runs", lambda _: [])
    monkeypatch.chdir(tmp_path)
    path = write_rest(tmp_path, CLOSE)
    main(["campaign", str(path), "--runs=2", "--jobs=0", "--report=report.html"])
    words = " ".join(Page((tmp_path / "report.html").read_text()).words.split())
    margins = sorted(
        margin_of(spec.values["limit_bar"]) for spec in Plan(replace(read_campaign(path), runs=2))
    )
    assert f" {margins[0]:+.3g} {sum(margins) / 2:+.3g} " in words


@pytest.mark.long
def test_the_sobol_indices_are_in_report_and_json(tmp_path, capsys):
    path = write_rest(tmp_path, CLOSE)
    report = tmp_path / "report.html"
    words = ["campaign", str(path), "--runs=8", "--sampler=saltelli", "--jobs=0", "--json"]
    main([*words, "--report", str(report)])
    found = json.loads(capsys.readouterr().out)["sobol_indices"]
    # The margin of R-1 comes from the limit; a load of 1 N has one tick to
    # act.
    of_load = next(each for each in found if each["parameter"] == "load_n")
    assert max(of_load["total"].values()) < 1e-9
    assert "How much of a margin comes from which parameter" in Page(report.read_text()).words


def test_margins_outside_a_figure_are_counted():
    assert beyond([-3.0, 0.0, 3.0]) == ""
    assert beyond([-4.0, -5.0, 0.0]) == " (2 below -3: shown at the end)"
    assert beyond([-4.0, 9.0]) == " (1 below -3 and 1 above 3: shown at the end)"


def test_a_picture_has_the_same_bytes_wherever_its_layout_was_solved():
    """The solver's results differ by rounding; matplotlib hashes the place of each clip path."""
    figures = [Figure(), Figure()]
    for figure, rounding in zip(figures, (0.0, 1e-13), strict=True):
        figure.add_axes((0.1 + rounding, 0.1, 0.8, 0.8)).plot([0.0, 1.0], [0.0, 1.0])
    with mpl.rc_context(STYLE):
        one, other = map(svg_of, figures)
    assert one == other


# Bins of margins: nothing is clipped in silence, and zero parts what holds from what fails.


@pytest.mark.parametrize(
    "margins",
    [
        [],
        [0.0],
        [0.5, 0.5],
        [-0.25, 0.0, 1.0, 2.9],
        [-7.0, -3.0, 3.0, 9.0, math.inf, -math.inf, math.nan],
        [-1e-9, 1e-9],
        [-5e-324, 0.5],
    ],
)
def test_every_margin_is_counted_once(margins):
    found = bin_margins(margins)
    inside = sum(-LARGEST <= margin <= LARGEST for margin in margins)
    beyond_it = [sum(margin < -LARGEST for margin in margins), sum(m > LARGEST for m in margins)]
    assert [sum(found.counts), found.below, found.above] == [inside, *beyond_it]
    assert -LARGEST <= found.low
    assert found.low <= 0.0 <= found.high
    assert found.high > found.low


def test_zero_is_an_edge_so_that_no_bin_mixes_verdicts():
    found = bin_margins([-0.31, -1e-6, 1e-6, 0.77])
    width = (found.high - found.low) / len(found.counts)
    place = round(-found.low / width)
    assert place * width == pytest.approx(-found.low)
    assert sum(found.counts[:place]) == 2  # the two that fail


def test_bins_have_the_next_round_width_that_makes_no_more_than_thirty():
    for margin in (10.0**-power * digits for power in range(3) for digits in range(1, 300, 7)):
        if margin > 3.0:
            continue
        _, low, high, counts, _, _ = bin_margins([margin])
        width = (high - low) / len(counts)
        digits = width / 10.0 ** math.floor(math.log10(width) + 1e-9)
        rounds = [r for r in (1.0, 2.0, 2.5, 5.0, 10.0) if r == pytest.approx(digits)]
        assert rounds, width
        before = {1.0: 0.5, 2.0: 1.0, 2.5: 2.0, 5.0: 2.5, 10.0: 5.0}[rounds[0]] / rounds[0]
        assert before * width < margin / 30 * (1 + 1e-9) <= width * (1 + 2e-9)
