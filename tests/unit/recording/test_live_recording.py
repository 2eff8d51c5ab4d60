"""A recording that is begun and ended while the bench runs."""

import json
from pathlib import Path

import numpy as np
import pytest
from support.feed_loop import FeedLoop, Wire

import hil_bench
from hil_bench.abilities.live import attached, ctl
from hil_bench.abilities.recording import sessions
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.errors import ConfigError, ControllerError


@pytest.fixture
def loop(monkeypatch):
    loop = FeedLoop()
    monkeypatch.setattr(attached, "connect", loop.connect)
    monkeypatch.setattr(ctl, "connect", loop.connect)
    yield loop
    loop.recording.close()


def test_it_has_each_tick_from_its_beginning_to_its_end(loop, tmp_path):
    bench = hil_bench.attach()
    with bench.record(tmp_path / "run.mf4") as recording:
        loop.look_again()
        begins = bench.status()["state"]["recording"]["begins"]
        loop.tick(300)
    loop.look_again()
    assert bench.status()["state"]["recording"] is None
    table = read_recording(tmp_path / "run.mf4")
    assert recording.content["rows"] == len(table) >= 300
    assert recording.content["lost"] == 0
    assert begins < table["time"][0] <= begins + 2e-3
    assert np.unique(np.round(np.diff(table["time"]) * 1e3)) == [1]
    assert [name for name in table.dtype.names if name != "time"] == [
        channel.name for channel in loop.session.channels
    ]


def test_after_its_end_no_row_is_made_for_it(loop, tmp_path):
    bench = hil_bench.attach()
    bench.record(tmp_path / "run.csv").stop()
    assert loop.session._row_observers == []
    assert loop.session._frame_observers == []


def test_the_shell_begins_and_ends_it(loop, tmp_path, monkeypatch, cli):
    monkeypatch.chdir(tmp_path)
    assert "run.mf4: recording since 0.0" in cli("ctl record run.mf4").out
    loop.look_again()
    assert f"record {Path.cwd()}/run.mf4 since 0.0" in cli("ctl status").out
    found = json.loads(cli("ctl record --stop --json").out)
    assert Path(found["path"]) == tmp_path / "run.mf4"
    assert found["rows"] == len(read_recording(tmp_path / "run.mf4"))


def test_what_cannot_be_recorded_is_said_in_words(loop, tmp_path):
    bench = hil_bench.attach()
    with pytest.raises(ConfigError, match=r'no recording has the suffix ".txt"'):
        bench.record(tmp_path / "run.txt")
    with pytest.raises(ConfigError, match=r"no/such/run\.mf4: "):
        bench.record(tmp_path / "no/such/run.mf4")
    wire = Wire(loop)
    wire.say(id=1, do="start_recording", path="run.mf4")
    wire.say(id=2, do="stop_recording")
    loop.tick(3)
    errors = [line["error"] for line in wire.lines() if line["type"] == "answer"]
    assert errors == [
        "record: run.mf4: give an absolute path",
        "record: no recording runs that ctl, the page or attach() has begun",
    ]
    bench.record(tmp_path / "run.mf4")
    with pytest.raises(ConfigError, match=r"run\.mf4 is being recorded; stop that first"):
        bench.record(tmp_path / "other.mf4")


@pytest.mark.usefixtures("loop")
def test_another_error_is_an_answer_and_the_bench_goes_on(tmp_path, monkeypatch):
    class Sink:
        def start(self):
            raise OSError("no process left")

    monkeypatch.setattr(sessions, "open_sink", lambda *_, **_options: Sink())
    bench = hil_bench.attach()
    with pytest.raises(ControllerError, match="record: OSError: no process left"):
        bench.record(tmp_path / "run.mf4")
    assert bench.status()["state"]["recording"] is None


def test_the_end_of_the_bench_closes_the_file(loop, tmp_path):
    hil_bench.attach().record(tmp_path / "run.mf4")
    loop.tick(50)
    loop.feed.stop()
    assert loop.recording.state() == {"recording": None}
    assert len(read_recording(tmp_path / "run.mf4")) >= 50
