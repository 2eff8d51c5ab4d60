"""What a recording holds when all goes well, and what is left when it does not."""

import errno
import random
import struct

import numpy as np
import pytest
from support.tables import from_text

from hil_bench import ConfigError, read_frames
from hil_bench.abilities.common import block_file
from hil_bench.abilities.recording.formats import FRAME_SUFFIXES, SIGNAL_SUFFIXES, SUFFIXES
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.abilities.recording.recorder import (
    BLOCK_PERIOD,
    InlineRecorder,
    Recorder,
    RecordingPlan,
)
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import Channel, LoggedFrame

CHANNELS = (Channel("axis1.P_A", "Pa"),)
ROW = struct.Struct("<2d")


def fail(_number, problem):
    pytest.fail(problem)


def row(number):
    return number * 1e-3, 1e5 * number


def frame(number):
    return LoggedFrame(
        Frame(0x181, number.to_bytes(2, "little")), number * 1_000_000, bool(number % 2)
    )


def feed(recorder, first, after):
    for number in range(first, after):
        recorder.append_row(ROW.pack(*row(number)))
        recorder.append_frames([frame(number)])
    recorder.write_block()


def found(path):
    """Return the numbers of rows and frames in a file, after checking each of them."""
    numbers = []
    if path.suffix in SIGNAL_SUFFIXES:
        rows = read_recording(path).tolist()
        numbers = [round(time * 1e3) for time, _ in rows]
        assert rows == [row(number) for number in numbers]
    frames = list(read_frames(path)) if path.suffix in FRAME_SUFFIXES else []
    frame_numbers = [logged.now // 1_000_000 for logged in frames]
    expected = [frame(number) for number in frame_numbers]
    if path.suffix == ".log":  # which does not say who sent a frame
        expected = [logged._replace(is_received=None) for logged in expected]
    assert frames == expected
    return numbers, frame_numbers


def plan(tmp_path, *suffixes, **options):
    return RecordingPlan(tuple(tmp_path / f"run{s}" for s in suffixes), CHANNELS, **options)


def test_every_format_holds_what_it_has_a_place_for(tmp_path):
    recorder = Recorder(plan(tmp_path, *SUFFIXES), durable=True, tell=fail)
    for block in range(3):
        feed(recorder, 10 * block, 10 * block + 10)
    report = recorder.close()
    assert (report.rows, report.frames, report.problems) == (30, 30, [])
    for suffix in SUFFIXES:
        rows, frames = found(tmp_path / f"run{suffix}")
        assert rows == (list(range(30)) if suffix in SIGNAL_SUFFIXES else [])
        assert frames == (list(range(30)) if suffix in FRAME_SUFFIXES else [])


def test_a_log_is_recorded_from_the_start_and_counts_no_rows(tmp_path):
    """Without a trigger it has begun, even where the format has no place for signals."""
    recorder = Recorder(plan(tmp_path, ".log"), durable=False, tell=fail)
    feed(recorder, 0, 3)
    report = recorder.close()
    assert (report.is_triggered, report.rows, report.frames) == (True, 0, 3)


def test_a_bench_that_is_killed_has_lost_a_block_at_most(tmp_path):
    """The time of a row ends a block; here no value beside it ever grows."""
    recorder = InlineRecorder(plan(tmp_path, ".csv"))
    recorder.start()
    last = 3 * BLOCK_PERIOD
    for time in np.linspace(0.0, last, 76):
        recorder.append_row((time, 0.0))
    seen = read_recording(tmp_path / "run.csv")["time"][-1]  # nothing was closed
    assert last - seen <= BLOCK_PERIOD
    recorder.stop()


@pytest.fixture
def operations(monkeypatch):
    """Every write to a file, in order: address and data."""
    done = []
    write = block_file.OutputFile._write

    def write_and_keep(self, address, data):
        done.append((address, data))
        write(self, address, data)

    monkeypatch.setattr(block_file.OutputFile, "_write", write_and_keep)
    return done


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_writer_killed_at_any_moment_leaves_whole_blocks(tmp_path, operations, suffix):
    """What has been written before a moment is replayed: a file as SIGKILL leaves it."""
    recorder = Recorder(plan(tmp_path, suffix), durable=False, tell=fail)
    head = len(operations)
    blocks = []
    for block in range(4):
        feed(recorder, 10 * block, 10 * block + 10)
        blocks.append(len(operations))
    done = operations[:]
    recorder.close()
    moments = random.Random(7)  # noqa: S311 - no secret
    killed = tmp_path / f"killed{suffix}"
    for number in range(head, len(done)):
        content = bytearray()
        for address, data in done[:number]:
            content[address : address + len(data)] = data
        address, data = done[number]
        # A few bytes in the middle, within one page, are replaced at once or not at all.
        is_appended = address == len(content)
        cut = moments.randrange(len(data) + 1) if is_appended else len(data)
        content[address : address + cut] = data[:cut]
        killed.write_bytes(content)
        complete = sum(1 for end in blocks if end <= number)
        rows, frames = ([], []) if is_empty_log(killed) else found(killed)
        for numbers in (rows, frames):
            assert numbers == list(range(len(numbers)))
        expected = rows if suffix in SIGNAL_SUFFIXES else frames
        assert len(expected) >= 10 * complete, f"{number} writes and {cut} bytes"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_power_cut_at_any_moment_leaves_all_but_the_last_two_blocks(
    tmp_path, make_file, operations, monkeypatch, suffix
):
    """After the last fsync some writes reach the disk and some do not, in any order.

    What was appended may end anywhere, since a file system that keeps data in order never shows a
    size without its data; each replacement is there or not.
    """
    monkeypatch.setattr(block_file.os, "fsync", lambda _descriptor: operations.append(None))
    recorder = Recorder(plan(tmp_path, suffix), durable=True, tell=fail)
    feed(recorder, 0, 10)
    blocks = [0, len(operations)]
    for block in range(1, 4):
        feed(recorder, 10 * block, 10 * block + 10)
        blocks.append(len(operations))
    done = operations[:]
    recorder.close()
    chance = random.Random(3)  # noqa: S311 - no secret
    for number in range(blocks[1], len(done) + 1):
        left = make_file(f"cut{suffix}", after_power_cut(done[:number], chance))
        begun = sum(1 for end in blocks[1:] if end <= number)
        rows, frames = found(left)
        expected = rows if suffix in SIGNAL_SUFFIXES else frames
        assert len(expected) >= 10 * (begun - 1), f"{number} operations"
        assert expected == list(range(len(expected)))


def after_power_cut(operations, chance):
    """Return what the disk may hold."""
    synced = max((n for n, operation in enumerate(operations) if operation is None), default=0)
    content = bytearray()
    for operation in operations[:synced]:
        if operation is not None:
            address, data = operation
            content[address : address + len(data)] = data
    size = len(content)
    for address, data in filter(None, operations[synced:]):
        if address >= size or chance.random() < 0.5:
            content[address : address + len(data)] = data
    return bytes(content[: chance.randrange(size, len(content) + 1)])


def is_empty_log(path):
    """Whether nothing was complete yet, which a log of python-can's cannot tell from damage."""
    try:
        return path.suffix == ".blf" and not list(read_frames(path))
    except ConfigError:
        return True


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_full_disk_ends_a_file_after_its_last_block_and_the_others_go_on(
    tmp_path, monkeypatch, suffix
):
    other = ".log" if suffix == ".csv" else ".csv"
    told = []
    recorder = Recorder(
        plan(tmp_path, suffix, other), durable=False, tell=lambda _number, text: told.append(text)
    )
    feed(recorder, 0, 10)
    write = block_file.OutputFile._write

    def write_half(self, address, data):
        if self.path.suffix == suffix:
            write(self, address, data[: len(data) // 2])
            raise OSError(errno.ENOSPC, "No space left on device")
        write(self, address, data)

    monkeypatch.setattr(block_file.OutputFile, "_write", write_half)
    feed(recorder, 10, 20)
    feed(recorder, 20, 30)
    report = recorder.close()
    (problem,) = told
    assert problem == (
        f"{tmp_path}/run{suffix}: recording ended at 0.009 s: No space left on device; "
        "what was written before is readable"
    )
    assert report.problems == told
    assert [(file.rows, file.frames) for file in report.files] == [
        (10 if suffix in SIGNAL_SUFFIXES else None, 10 if suffix in FRAME_SUFFIXES else None),
        (30 if other in SIGNAL_SUFFIXES else None, 30 if other in FRAME_SUFFIXES else None),
    ]
    assert max(map(len, found(tmp_path / f"run{suffix}"))) == 10
    assert max(map(len, found(tmp_path / f"run{other}"))) == 30


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_folder_that_vanishes_is_told_once(tmp_path, suffix):
    folder = tmp_path / "results"
    folder.mkdir()
    told = []
    recorder = Recorder(
        plan(folder, suffix), durable=False, tell=lambda _number, text: told.append(text)
    )
    feed(recorder, 0, 10)
    folder.rename(tmp_path / "elsewhere")
    feed(recorder, 10, 20)
    feed(recorder, 20, 30)
    recorder.close()
    assert told == [
        (
            f"{folder}/run{suffix}: recording ended at 0.009 s: the file or its folder has "
            "vanished; "
            "what was written before is readable"
        )
    ]


@pytest.mark.parametrize(
    ("trigger", "first"),
    # Row n is at n ms and 100000 n Pa: above 25 bar is n = 26; 10 ms before it begins at 16.
    [("axis1.P_A > 25 bar", 16), ("axis1.P_A > 2.5 MPa", 16), ("time > 0.0305", 21)],
)
def test_a_trigger_begins_it_with_the_time_before(tmp_path, trigger, first):
    wanted = plan(tmp_path, ".mf4", trigger=trigger, pre_trigger=0.010)
    recorder = Recorder(wanted, durable=False, tell=fail)
    for block in range(8):
        feed(recorder, 7 * block, 7 * block + 7)
        if block < 3:
            assert not recorder.report.is_triggered
    assert recorder.close().is_triggered
    assert found(tmp_path / "run.mf4") == (list(range(first, 56)), list(range(first, 56)))


def test_a_trigger_that_never_comes_leaves_an_empty_file(tmp_path):
    wanted = plan(tmp_path, ".csv", trigger="axis1.P_A < 0")
    recorder = Recorder(wanted, durable=False, tell=fail)
    feed(recorder, 0, 50)
    report = recorder.close()
    assert (report.is_triggered, report.rows) == (False, 0)
    assert found(tmp_path / "run.csv") == ([], [])


@from_text("trigger", "message")
def test_a_trigger_that_makes_no_sense(tmp_path, trigger, message):
    with pytest.raises(ConfigError) as caught:
        plan(tmp_path, ".csv", trigger=trigger).check()
    assert str(caught.value) == message


def test_an_unknown_suffix_says_which_there_are(tmp_path):
    with pytest.raises(ConfigError) as caught:
        plan(tmp_path, ".h5").check()
    assert str(caught.value) == (
        f'{tmp_path}/run.h5: no recording has the suffix ".h5"; give a file name that ends in '
        ".mf4 (signals and frames), .csv (signals), .blf, .asc or .log (frames)"
    )


def test_a_second_file_that_cannot_be_opened_closes_the_first(tmp_path):
    paths = (tmp_path / "run.csv", tmp_path / "no" / "run.mf4")
    with pytest.raises(ConfigError, match=r"there is no folder .*; make it first"):
        Recorder(RecordingPlan(paths, CHANNELS), durable=False, tell=fail)
