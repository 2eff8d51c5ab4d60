"""`hil-bench plot`; what the pictures look like was looked at."""

import os
from pathlib import Path

import pytest
from support.tables import from_text

from hil_bench import RecordingWish, VirtualBench
from hil_bench.abilities.recording.recorder import InlineRecorder, RecordingPlan
from hil_bench.canopen_device.frame import Frame
from hil_bench.cli import main
from hil_bench.outside.recording.channels import Channel


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plot")
    paths = tuple(folder / f"run{suffix}" for suffix in (".mf4", ".csv", ".log"))
    with VirtualBench(record=RecordingWish(paths)) as bench:
        bench.run(0.05)
    return folder


@pytest.mark.parametrize(
    ("arguments", "texts"),
    [
        (["run.mf4"], ["Pressure [bar]", "Spool [%]"]),
        (["run.csv", "--signals", "axis1.P_*"], ["axis1.P_A", "axis1.P_B", "[bar]"]),
        (["run.mf4", "--frames"], ["0x704", "Frames [1/s]"]),
        (["run.log"], ["0x701", "CAN identifier"]),
    ],
)
def test_each_kind_is_drawn(folder, tmp_path, monkeypatch, cli, arguments, texts):
    monkeypatch.setitem(__import__("matplotlib").rcParams, "svg.fonttype", "none")
    picture = tmp_path / "x.svg"
    name, *options = arguments
    assert cli(["plot", str(folder / name), "-o", str(picture), *options]).out == f"{picture}\n"
    drawn = picture.read_text(encoding="utf-8")
    for text in texts:
        assert text in drawn


@pytest.mark.parametrize("suffix", [".csv", ".mf4"])
def test_words_and_counts_are_no_percent(tmp_path, monkeypatch, suffix):
    """A control word of 7 beside a spool at 50 %: a panel each, the word's without a unit."""
    monkeypatch.setitem(__import__("matplotlib").rcParams, "svg.fonttype", "none")
    channels = (Channel("valve.device_control_word", "1"), Channel("valve.spool", "-"))
    recorder = InlineRecorder(RecordingPlan((tmp_path / f"r{suffix}",), channels))
    recorder.start()
    for tick in range(3):
        recorder.append_row((tick * 0.001, 7.0, 0.5))
    recorder.stop()
    assert main(["plot", str(tmp_path / f"r{suffix}"), "-o", str(tmp_path / "r.svg")]) == 0
    drawn = (tmp_path / "r.svg").read_text(encoding="utf-8")
    assert [drawn.count(label) for label in ("[-]", "[%]", ">700<")] == [1, 1, 0]


@pytest.mark.parametrize("words", [["--from", "0.05"], ["--to", "0.001"]])
def test_the_ends_of_a_time_belong_to_it(folder, tmp_path, words):
    """The recording has rows from 0.001 to 0.05 s, the refusal below says."""
    picture = tmp_path / "end.png"
    assert main(["plot", str(folder / "run.csv"), "-o", str(picture), *words]) == 0
    assert picture.exists()


def test_it_goes_beside_the_recording(folder):
    assert main(["plot", str(folder / "run.mf4")]) == 0
    assert (folder / "run.png").read_bytes().startswith(b"\x89PNG")


def test_a_picture_without_suffix_is_png(folder, capsys):
    assert main(["plot", str(folder / "run.mf4"), "-o", str(folder / "picture")]) == 0
    assert capsys.readouterr().out == f"{folder / 'picture.png'}\n"
    assert (folder / "picture.png").read_bytes().startswith(b"\x89PNG")


def test_a_name_that_is_no_text_is_drawn_too(folder):
    path = folder / os.fsdecode(b"\xff.csv")
    path.write_bytes((folder / "run.csv").read_bytes())
    assert main(["plot", str(path), "-o", str(folder / "odd.png")]) == 0
    assert (folder / "odd.png").exists()


@from_text("arguments", "message")
def test_what_cannot_be_drawn(folder, arguments, message, cli, monkeypatch):
    monkeypatch.chdir(folder)
    Path("bench.toml").write_text("load_series_s_n = [\n0.0, 1.0\n0.5, 2.0\n]\n")  # with numbers
    error = cli(["plot", *arguments.split()], 2).err
    assert error.startswith("hil-bench: error: ")
    assert message in error
    assert error.count("\n") == 1


def test_a_recording_of_frames_alone_is_drawn_as_traffic(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    recorder = InlineRecorder(RecordingPlan((tmp_path / "bus.mf4",), ()))
    recorder.start()
    recorder.append_frames([Frame(0x701, b"\5")], 0, is_received=True)
    recorder.stop()

    assert main(["plot", "bus.mf4", "-o", "bus.svg"]) == 0
    assert "0x701" in (tmp_path / "bus.svg").read_text()
    note, picture = capsys.readouterr().out.splitlines()
    assert note.startswith("bus.mf4: holds frames and no signals; 'hil-bench decode bus.mf4")
    assert picture == "bus.svg"
    assert main(["plot", "bus.mf4", "--signals", "axis1.*"]) == 2
    assert "bus.mf4: holds frames and no signals; 'hil-bench decode" in capsys.readouterr().err
