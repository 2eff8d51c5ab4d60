"""Each I/O call of a recorder fails in turn: what is said, and what is left."""

import struct

import pytest
from support.faulty_disk import Fault, FaultyDisk

from hil_bench import ConfigError, read_frames
from hil_bench.abilities.recording.formats import SIGNAL_SUFFIXES, SUFFIXES
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.abilities.recording.recorder import Recorder, RecordingPlan
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import Channel, LoggedFrame

FULL, BROKEN, SHORT, FORBIDDEN, INTERRUPTED = (
    Fault[name] for name in ("FULL", "BROKEN", "SHORT", "FORBIDDEN", "INTERRUPTED")
)
CHANNELS = (Channel("axis1.P_A", "Pa"),)
ROW = struct.Struct("<2d")
BLOCKS, IN_BLOCK = 3, 4
FED = BLOCKS * IN_BLOCK


def row(number):
    return number * 1e-3, 1e5 * number


def frame(number):
    return LoggedFrame(Frame(0x181, bytes([number])), number * 1_000_000, bool(number % 2))


def feed(recorder):
    for block in range(BLOCKS):
        for number in range(IN_BLOCK * block, IN_BLOCK * (block + 1)):
            recorder.append_row(ROW.pack(*row(number)))
            recorder.append_frames([frame(number)])
        recorder.write_block()


def count(path):
    """Return how many rows, or frames, a file holds, each of which is right."""
    if path.suffix in SIGNAL_SUFFIXES:
        rows = read_recording(path).tolist()
        assert rows == [row(number) for number in range(len(rows))]
        return len(rows)
    try:
        frames = [logged.frame for logged in read_frames(path)]
    except ConfigError:  # python-can's readers refuse a BLF or ASC file without any frame
        return 0
    assert frames == [frame(number).frame for number in range(len(frames))]
    return len(frames)


@pytest.fixture
def folders(tmp_path):
    made = tmp_path / "faulty", tmp_path / "sound"
    for folder in made:
        folder.mkdir()
    return made


@pytest.mark.parametrize(
    ("suffix", "fault"),
    [
        *((suffix, fault) for suffix in SUFFIXES for fault in (FULL, BROKEN, SHORT)),
        *((".csv", fault) for fault in (FORBIDDEN, INTERRUPTED)),  # as BROKEN for our code
    ],
)
def test_any_call_that_fails_ends_that_file_alone_and_is_said_once(
    folders, monkeypatch, suffix, fault
):
    disk = FaultyDisk(monkeypatch, folders[0])
    faulty, sound = folders[0] / f"run{suffix}", folders[1] / "run.csv"
    plan = RecordingPlan((faulty, sound), CHANNELS)
    calls = at = 0
    while at <= calls:
        told = []
        with disk.failing(fault, at):
            problem, report = run(plan, told)
            calls = len(disk.calls)
        assert not disk.descriptors
        if report is None:
            assert problem.startswith(f"{faulty}: cannot be written: ")
        else:
            is_hit = at < calls and fault is not SHORT and (fault is not FULL or told != [])
            if is_hit:
                assert_that_it_ended(report, told, sound)
            else:
                assert_that_all_is_there(report, told)
        at += 1
    assert calls > 4 * BLOCKS


def run(plan, told):
    """Record; return why that could not begin, or the report."""
    try:
        recorder = Recorder(plan, durable=True, tell=lambda *problem: told.append(problem))
    except ConfigError as error:
        return str(error), None
    feed(recorder)
    return "", recorder.close()


def assert_that_it_ended(report, told, sound):
    faulty, of_sound = report.files
    counted = faulty.frames if faulty.rows is None else faulty.rows
    ((number, text),) = told
    assert (number, report.problems) == (0, [text])
    end = max(counted - 1, 0) * 1e-3
    assert text.startswith(f"{faulty.path}: recording ended at {end:.3f} s: ")
    assert not report.is_complete
    assert counted <= count(faulty.path) <= FED
    assert (of_sound.rows, of_sound.problem, count(sound)) == (FED, "", FED)


def assert_that_all_is_there(report, told):
    assert (told, report.is_complete) == ([], True)
    for file in report.files:
        assert (file.frames if file.rows is None else file.rows) == count(file.path) == FED
