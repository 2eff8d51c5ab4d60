"""Exit codes where several things happen at once, above all on a disk that is full.

`/dev/full` takes no byte (full(4)): a link to it is an output file on a full disk. The expected
codes are those of docs/exit-codes.md: the worst event decides, and a failed requirement stays one.
"""

import contextlib
import itertools
import os
import re
import sys
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import pytest

from hil_bench.abilities.demo import verbs as demo
from hil_bench.abilities.scenario.verbs import scenario_run
from hil_bench.cli import exit_codes, main
from hil_bench.cli.exit_codes import SEVERITY, Ending, ExitCode, Interruption, worst
from hil_bench.cli.paced_run import PacedRun
from hil_bench.errors import BusError, DiskError, about_file

ALONE = ["--speed", "max", "--no-feed"]
ON_A_BUS = [*ALONE, "-i", "virtual", "-c", "exit-codes"]
PASSING, FAILING = "always axis1.P_A < 250 bar", "always axis1.P_A < 1 bar"
UNDECIDED = "whenever axis1.P_A > 250 bar then axis1.P_B > 1 bar"


@pytest.mark.parametrize(
    ("name", "code", "said"),
    [
        ("scipy.io", ExitCode.USAGE, "needs scipy, which is missing; pip install 'hil-bench[all]'"),
        ("hil_bench.gone", ExitCode.INTERNAL, "this is a bug"),
        ("sci", ExitCode.INTERNAL, "this is a bug"),
    ],
)
def test_a_missing_extra_is_no_bug(name, code, said, capsys):
    error = ModuleNotFoundError(f"No module named {name!r}", name=name)
    assert exit_codes.report_error(error, verbosity=0) is code
    assert said in capsys.readouterr().err


@pytest.fixture
def full(tmp_path):
    """Makes an output file that takes no byte."""

    def make(name):
        path = tmp_path / name
        path.symlink_to("/dev/full")
        return str(path)

    return make


def scenario(tmp_path, that, duration=0.02):
    path = tmp_path / "a.scenario.toml"
    path.write_text(
        f'title = "T"\nduration_s = {duration}\n[[expect]]\nid = "R1"\nthat = \'{that}\'\n'
    )
    return str(path)


def test_the_worst_event_decides_in_any_order():
    pairs = [*itertools.combinations(SEVERITY, 2)]
    assert [(worst(*pair), worst(*reversed(pair))) for pair in pairs] == [(a, a) for a, _ in pairs]


def test_the_documented_order_is_that_of_the_code():
    text = (Path(__file__).parents[3] / "docs" / "exit-codes.md").read_text()
    rows = [int(number) for number in re.findall(r"^\| (\d+) \|", text, re.MULTILINE)]
    assert rows == list(SEVERITY)


def test_an_error_after_a_verdict_does_not_hide_it(capsys):
    ending = Ending(Namespace(verbose=0))
    ending.take(ExitCode.CHECK_FAILED)
    with ending.going_on(), about_file("report.html"):
        raise OSError(28, "No space left on device")
    assert ending.code is ExitCode.CHECK_FAILED
    ending.take_error(BusError("can0: lost"))
    assert ending.code is ExitCode.BUS
    assert capsys.readouterr().err.splitlines() == [
        "hil-bench: error: report.html: cannot be written: No space left on device",
        "hil-bench: error: can0: lost",
    ]


@pytest.mark.parametrize("words", [ALONE, ON_A_BUS], ids=["alone", "on a bus"])
@pytest.mark.parametrize(
    ("that", "code"),
    [(PASSING, ExitCode.LOST), (FAILING, ExitCode.CHECK_FAILED), (UNDECIDED, ExitCode.LOST)],
)
def test_a_scenario_whose_recording_is_lost(tmp_path, full, cli, words, that, code):
    path = scenario(tmp_path, that)
    said = cli(["run", "--scenario", path, "--record", full("run.log"), *words], code)
    assert "  R1  " in said.out
    assert "run.log: recording ended at 0.000 s: No space left on device" in said.out
    assert "No space left on device" in said.err


@pytest.mark.parametrize("words", [ALONE, ON_A_BUS], ids=["alone", "on a bus"])
def test_a_lost_recording_ends_a_scenario_where_that_is_wanted(
    tmp_path, full, cli, monkeypatch, words
):
    """The first block is written at 0.25 s; two seconds later the requirement would fail."""
    monkeypatch.setattr("hil_bench.cli.helpers.LOOK", 0)
    path = scenario(tmp_path, "always after 2 s axis1.P_A < 0 bar", duration=3)
    words = ["run", "--scenario", path, *words, "--end-on-loss", "--record"]
    assert main([*words, str(tmp_path / "whole.log")]) == ExitCode.CHECK_FAILED
    assert "R1  inconclusive" in cli([*words, full("run.log")], ExitCode.LOST).out


class LateWish(Interruption):
    """A Ctrl-C some ticks after the first."""

    looks = 0

    @property
    def requested(self):
        self.looks += 1
        return self.looks > 10

    @requested.setter
    def requested(self, _value):
        pass


@pytest.mark.parametrize("words", [ALONE, ON_A_BUS], ids=["alone", "on a bus"])
@pytest.mark.parametrize(("that", "code"), [(PASSING, 5), (FAILING, 1)])
def test_a_lost_recording_and_ctrl_c(tmp_path, full, monkeypatch, words, that, code):
    wish = LateWish()
    for module in (scenario_run, exit_codes):
        monkeypatch.setattr(module, "interruption", lambda: contextlib.nullcontext(wish))
    path = scenario(tmp_path, that, duration=1)
    assert main(["run", "--scenario", path, "--record", full("run.log"), *words]) == code


def test_a_missed_budget_does_not_hide_a_failed_requirement(tmp_path, monkeypatch):
    real = PacedRun.run

    def late(self):
        report = real(self)
        return replace(report, ticks=replace(report.ticks, overruns=1))

    monkeypatch.setattr(PacedRun, "run", late)
    for that, code in ((PASSING, ExitCode.TIMING), (FAILING, ExitCode.CHECK_FAILED)):
        path = scenario(tmp_path, that)
        words = ["-i", "virtual", "-c", "exit-codes", "--no-feed", "--speed", "10"]
        assert main(["run", "--scenario", path, "--strict-timing", *words]) == code


def test_a_summary_is_printed_though_its_histograms_are_lost(full, cli):
    words = [*ON_A_BUS[2:], "--speed", "50", "--duration", "0.01", "--no-feed"]
    said = cli(["run", *words, "--histograms", full("h.json")], ExitCode.LOST)
    assert "\nsummary\n" in said.out
    assert "h.json: No space left on device" in said.err


@pytest.mark.parametrize(("that", "code"), [(PASSING, 5), (FAILING, 1)])
def test_a_report_that_is_lost_after_the_verdicts(tmp_path, make_file, full, cli, that, code):
    path = scenario(tmp_path, that)
    said = cli(["test", path, "--junit", full("j.xml"), "--report", full("t.html")], code)
    assert "  R1  " in said.out
    assert [line.partition(": cannot")[0][-6:] for line in said.err.splitlines()] == [
        "/j.xml",
        "t.html",
    ]
    recorded = make_file("run.csv", "time,axis1.P_A\ns,Pa\n0,2e5\n0.001,2e5\n")
    assert main(["judge", path, str(recorded), "--report", full("r.html")]) == code


class Closed:
    """A standard output whose reader has gone, or whose disk is full."""

    encoding = "utf-8"

    def __init__(self, error):
        self.error = error

    def write(self, _text):
        raise self.error

    def flush(self):
        raise self.error

    def fileno(self):
        return os.open(os.devnull, os.O_WRONLY)


@pytest.mark.parametrize(
    ("error", "passed"), [(BrokenPipeError(), 0), (OSError(28, "No space left on device"), 5)]
)
@pytest.mark.parametrize("verb", ["test", "judge", "run"])
def test_a_verdict_survives_its_reader(tmp_path, monkeypatch, verb, error, passed):
    recorded = tmp_path / "run.csv"
    rows = "".join(f"{tick / 1000},2e5\n" for tick in range(21))  # all of the scenario's 20 ms
    recorded.write_text(f"time,axis1.P_A\ns,Pa\n{rows}")
    for that, code in ((PASSING, passed), (FAILING, ExitCode.CHECK_FAILED)):
        path = scenario(tmp_path, that)
        words = {
            "test": ["test", path],
            "judge": ["judge", path, str(recorded)],
            "run": ["run", "--scenario", path, *ALONE],
        }[verb]
        with monkeypatch.context() as patch:
            patch.setattr(sys, "stdout", Closed(error))
            assert main(words) == code


def test_a_demo_says_its_summary_though_no_file_can_be_written(tmp_path, full, cli, monkeypatch):
    def draw(_recording, path):
        raise DiskError(f"{path}: cannot be written: No space left on device")

    monkeypatch.setattr(demo, "draw", draw)
    full("demo.csv.part")
    full("demo.log")
    words = ["--speed", "max", "--duration", "0.02", "--output", str(tmp_path)]
    said = cli(["demo", *words], ExitCode.LOST)
    assert said.out.startswith("motion    0.0 s in ")
    assert "plot      none, it could not be written" in said.out
    assert len(said.err.splitlines()) == 3


def test_values_of_a_log_that_are_lost(tmp_path, make_file, full):
    log = tmp_path / "bus.log"
    log.write_text("(0.000000) can0 181#0000000000000000\n(0.001000) can0 182#0000000000000000\n")
    config = make_file("bench.toml", "")
    assert main(["decode", str(log), str(config), "-o", full("v.csv")]) == ExitCode.LOST
