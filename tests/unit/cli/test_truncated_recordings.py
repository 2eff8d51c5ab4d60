"""Recordings that were cut off, as by a copy that broke: read up to there, or refused."""

import can
import pytest

from hil_bench import RecordingWish, VirtualBench
from hil_bench.cli import main
from hil_bench.outside.realtime.clock import VirtualClock

SUFFIXES = (".mf4", ".csv", ".blf", ".asc", ".log")
START_ALL = can.Message(arbitration_id=0, data=[1, 0], is_extended_id=False)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """The whole files, by suffix."""
    folder = tmp_path_factory.mktemp("whole")
    paths = {suffix: folder / f"run{suffix}" for suffix in SUFFIXES}
    with VirtualBench(record=RecordingWish(tuple(paths.values()))) as bench:
        bench.bus.send(START_ALL)
        bench.run(0.2)
    return {suffix: path.read_bytes() for suffix, path in paths.items()}


FRAMES = (".mf4", ".blf", ".asc", ".log")
SHARES = (0.0, 0.01, 0.3, 0.7, 0.999)
COMMANDS = {
    "replay FILE --virtual": ((".mf4", ".csv"), SHARES),
    "replay FILE -i virtual -c test_truncated": (FRAMES, SHARES),
    "shadow --log FILE": (FRAMES, SHARES),
    "plot FILE --output picture.png": (SUFFIXES, (0.0, 0.3)),
}


@pytest.mark.parametrize(
    ("command", "suffix", "left"),
    [
        (command, suffix, left)
        for command, (suffixes, shares) in COMMANDS.items()
        for suffix in suffixes
        for left in shares
    ],
)
def test_it_is_read_or_refused(recordings, tmp_path, monkeypatch, capsys, command, suffix, left):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("hil_bench.abilities.replay.verbs.MonotonicClock", VirtualClock)
    content = recordings[suffix]
    cut = tmp_path / f"cut{suffix}"
    cut.write_bytes(content[: int(left * len(content))])
    ended = main(command.replace("FILE", cut.name).split())
    said = capsys.readouterr().err.splitlines()
    lines = [line for line in said if "warning: " not in line or ended != 6]  # what was left out
    assert ended in {0, 1, 2, 6}
    assert len(lines) <= 1
    if ended == 2:
        assert lines[0].startswith(f"hil-bench: error: {cut.name}: ")
    if suffix == ".mf4" and left > 0.1:
        assert lines[0].endswith("where a block should be; give the whole recording")


def test_an_identification_says_that_its_recording_is_cut_off(recordings, tmp_path, capsys):
    cut = tmp_path / "cut.mf4"
    cut.write_bytes(recordings[".mf4"][:-100])
    assert main(["identify", str(cut)]) == 2
    left = len(recordings[".mf4"]) - 100
    assert capsys.readouterr().err == (
        f"hil-bench: error: {cut}: is cut off or damaged: it ends after {left} bytes, where a "
        "block should be; give the whole recording\n"
    )
