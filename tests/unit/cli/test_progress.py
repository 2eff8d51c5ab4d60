"""Lines now and then, and lines that nobody takes."""

import argparse
import contextlib
import io
import logging
import os
import threading
from types import SimpleNamespace

import pytest

from hil_bench import ConfigError
from hil_bench.abilities.commissioning.verbs import commission
from hil_bench.abilities.common import progress
from hil_bench.abilities.common.progress import Work, WorkLines, shown_work
from hil_bench.abilities.eyes.verbs import decode
from hil_bench.abilities.scenario.verbs import test
from hil_bench.cli import main
from hil_bench.cli.process import PatientHandler
from hil_bench.cli.status_line import PERIOD, Progress


def test_a_line_a_minute_of_the_machines_time():
    said, clock = [], [0]
    shown = Progress(said.append, lambda _now: ["x +1.00 mm", "in 3"], lambda: clock[0])
    for second in range(130):
        clock[0] = second * PERIOD // 60
        shown.look(second * 2_000_000_000)  # a bench at twice the speed
    assert said == ["120.000 s: x +1.00 mm  in 3", "240.000 s: x +1.00 mm  in 3"]


def test_a_line_of_many_axes_is_for_a_terminal():
    said, clock = [], [0]
    axes = "  ".join(f"axis{number} x   +1.00 mm  P_A  48.5" for number in range(24))
    shown = Progress(said.append, lambda _now: [axes, "in 3  out 4"], lambda: clock[0])
    clock[0] = PERIOD
    shown.look(0)
    three = "  ".join(f"axis{number} x   +1.00 mm  P_A  48.5" for number in range(3))
    assert said == [f"0.000 s: {three}  axis3 x   +1.00 mm  and 41 more  in 3  out 4"]
    said.clear()
    axes, clock[0] = "x" * 200, 2 * PERIOD
    shown.look(0)
    assert said == ["0.000 s:   and 1 more  in 3  out 4"]


def test_a_line_every_ten_seconds_of_work():
    said, clock = [], [0]
    work = Work("campaign", 64, "runs")
    lines = WorkLines(work, said.append, lambda: clock[0])
    for second in range(26):
        clock[0] = second * 1_000_000_000
        work.done = 2 * second
        work.remark = "1 failed" if second > 15 else ""
        lines.look()
    assert said == ["campaign: 20 of 64 runs, 10 s", "campaign: 40 of 64 runs, 20 s; 1 failed"]


def test_work_that_prints_its_parts_has_a_line_where_one_takes_long():
    said, clock = [], [0]
    work = Work("conformance", 64, "checks")
    lines = WorkLines(work, said.append, lambda: clock[0], pauses=True)
    for second in range(40):
        clock[0] = second * 1_000_000_000
        work.done = min(second, 20)  # the 21st part takes long
        lines.look()
    assert said == ["conformance: 20 of 64 checks, 30 s"]


def test_nothing_is_said_while_somebody_is_asked_or_reads(monkeypatch):
    """A pager that shows a page takes no more; then the pipe is full, and the work stands still."""
    said, clock = [], [0]
    work = Work("commission", 5, "steps")
    lines = WorkLines(work, said.append, lambda: clock[0], pauses=True)

    def look_at(second):
        clock[0] = second * 1_000_000_000
        lines.look()

    work.is_waiting = True
    look_at(30)
    work.is_waiting = False
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    monkeypatch.setattr("sys.stdout", SimpleNamespace(fileno=lambda: writing))
    try:
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(writing, bytes(1 << 12))
        look_at(60)
        assert said == []
        os.read(reading, 1 << 16)
        look_at(69)
        look_at(70)
    finally:
        os.close(reading)
        os.close(writing)
    assert said == ["commission: 0 of 5 steps, 70 s"]


@pytest.mark.parametrize(
    ("words", "title"),
    [
        ("decode b.log", "decode"),
        ("test s.toml", "test"),
        ("commission p.toml --virtual", "commission"),
    ],
)
def test_verbs_that_print_their_parts_say_it_where_one_takes_long(
    words, title, tmp_path, monkeypatch, cli
):
    """Each is looked at while it is at work, as late as a line is due."""
    own, looked, said = WorkLines.look, threading.Event(), []

    def look(lines):
        lines._say, lines._clock = said.append, lambda: lines._due
        own(lines)
        if said:
            looked.set()

    def wait(*_args, **_options):
        assert looked.wait(60.0)
        raise ConfigError("over")

    monkeypatch.setattr(progress, "_LOOK_S", 0.0)
    monkeypatch.setattr(WorkLines, "look", look)
    monkeypatch.setattr(decode, "_print", wait)
    monkeypatch.setattr(test, "_one_by_one", wait)
    monkeypatch.setattr(commission, "commission", wait)
    monkeypatch.chdir(tmp_path)
    files = {"b.log": LOG, "s.toml": SCENARIO, "p.toml": PLAN}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    cli(words, 2)
    assert said[0].startswith(f"{title}: ")


def test_a_stage_counts_when_the_next_one_begins():
    work = Work("evidence", 3)
    assert work.line(0) == "evidence: 0 of 3 parts, 0 s"
    work.begin("devices")
    work.begin("plant")
    assert work.line(12_300_000_000) == "evidence: 1 of 3 parts, 12 s; plant"
    assert Work("analyse").line(10_000_000_000) == "analyse: 10 s"


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize(
    ("stream", "quiet", "said"),
    [
        (io.StringIO, False, "WorkLines"),
        (Terminal, False, "WorkBar"),
        (io.StringIO, True, None),
        (Terminal, True, None),
    ],
)
def test_a_log_gets_lines_a_terminal_a_bar_and_quiet_nothing(stream, quiet, said, monkeypatch):
    looked = threading.Event()
    monkeypatch.setattr("sys.stderr", stream())
    monkeypatch.setattr(progress, "_LOOK_S", 0.0)
    seen = []
    for name in ("WorkLines", "WorkBar"):
        own = getattr(progress, name)

        def look(_self, own=own):
            seen.append(own.__name__)
            looked.set()

        monkeypatch.setattr(own, "look", look)
    with shown_work(argparse.Namespace(quiet=quiet), Work("test", 3)):
        assert quiet or looked.wait(60.0)
    assert {*seen} == ({said} if said else set())
    assert "hil-bench-progress" not in [each.name for each in threading.enumerate()]


LOG = "(0.5) can0 000#0102\n"  # NMT: start node 2
LOG += "".join(f"({second}.0) can0 182#00004842{second:02X}\n" for second in range(1, 8))  # 50 bar
TABLE = "time,axis1.P_A\ns,Pa\n0,5e6\n1,5e6\n"
SCENARIO = (
    'title = "T"\nduration_s = 0.01\n\n[[expect]]\nid = "p"\nthat = "always axis1.P_A < 60 bar"\n'
)
PLAN = "[plan]\n[limits]\nposition_mm = [-1, 1]\nspeed_mm_s = 1\npressure_bar = [0, 1]\n"
PLAN += "[communication]\n"
EXPECT = '[[expect]]\nid = "p"\nthat = "always axis1.P_A < 60 bar"\n'


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("explain b.log", "explain: 8 frames, 0 s"),
        ("decode b.log b.toml -o o.csv", "decode: 8 frames, 0 s; their values"),
        ("judge r.toml t.csv u.csv", "judge: 1 of 2 recordings, 0 s; u.csv"),
    ],
)
def test_long_looks_say_how_far_they_are(words, said, tmp_path, monkeypatch):
    """As they stand at their end."""
    works = []
    own = Work.__init__

    def begin(self, *of_work, **more):
        own(self, *of_work, **more)
        works.append(self)

    monkeypatch.setattr(Work, "__init__", begin)
    monkeypatch.chdir(tmp_path)
    texts = {"b.log": LOG, "b.toml": "", "r.toml": EXPECT, "t.csv": TABLE, "u.csv": TABLE}
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    assert main(words.split()) == 0
    (work,) = works
    assert work.line(0) == said


def test_a_bar_shows_what_is_done(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    work = Work("campaign", 64, "runs")
    bar = progress.WorkBar(work)
    work.done, work.remark = 16, "2 failed"
    bar.look()
    bar.close()
    assert "campaign:  25%" in terminal.getvalue()
    assert "16/64" in terminal.getvalue()
    assert "2 failed" in terminal.getvalue()


@pytest.fixture
def pipe():
    reader, writer = os.pipe()
    with open(writer, "w", encoding="utf-8") as stream:  # noqa: PTH123 - a descriptor
        yield reader, stream
    os.close(reader)


def test_a_line_that_nobody_takes_is_left_out_and_counted(pipe):
    reader, stream = pipe
    os.set_blocking(stream.fileno(), False)
    with contextlib.suppress(BlockingIOError):
        while os.write(stream.fileno(), b"." * 4096):
            pass
    os.set_blocking(stream.fileno(), True)  # now a write would wait for ever
    handler = PatientHandler()
    handler.setStream(stream)
    for number in range(3):
        handler.handle(logging.makeLogRecord({"msg": f"line {number}"}))
    os.set_blocking(reader, False)
    with contextlib.suppress(BlockingIOError):
        while b"line" not in os.read(reader, 65_536):
            pass
        pytest.fail("a line was written")
    handler.handle(logging.makeLogRecord({"msg": "line 3"}))
    assert os.read(reader, 100) == b"line 3 (3 lines before this one are lost)\n"


def test_a_line_that_can_be_taken_is_written(pipe):
    reader, stream = pipe
    handler = PatientHandler()
    handler.setStream(stream)
    handler.handle(logging.makeLogRecord({"msg": "all is %s", "args": ("well",)}))
    assert os.read(reader, 100) == b"all is well\n"


def test_what_a_file_put_into_a_warning_reaches_no_terminal(pipe):
    reader, stream = pipe
    handler = PatientHandler()
    handler.setStream(stream)
    handler.handle(logging.makeLogRecord({"msg": "%s\nb", "args": ("a\x18\x1b[2J",)}))
    assert os.read(reader, 100) == b"a\\x18\\x1b[2J\nb\n"
