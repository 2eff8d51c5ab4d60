"""The recorder in its own process, and what is left when somebody kills it or its parent."""

import os
import random
import signal
import struct
import subprocess
import sys
from multiprocessing import Pipe
from pathlib import Path

import pytest

from hil_bench import ConfigError, read_frames
from hil_bench.abilities.common.shared_ring import _TAKEN, SharedRing, pack_frames
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.abilities.recording.recorder import RecordingPlan
from hil_bench.abilities.recording.recorder_process import (
    _FRAMES,
    _ROW,
    LOOK,
    RecorderProcess,
    record,
)
from hil_bench.abilities.recording.report import Progress
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import Channel

try:
    import resource
except ImportError:  # Windows
    resource = None

CHANNELS = (Channel("axis1.P_A", "Pa"),)


def plan(*paths):
    return RecordingPlan(paths, CHANNELS)


def feed(recorder, first, after):
    for number in range(first, after):
        recorder.append_frames(
            [Frame(0x181, bytes(2), bus=1)], number * 1_000_000, is_received=False
        )
        recorder.append_row((number * 1e-3, 1e5 * number))


def wait_until_taken(recorder):
    """Wait until the process has taken all that is in the ring, however long that takes."""
    ring = recorder._ring
    while ring._counters[_TAKEN] < ring._end:
        os.sched_yield()


def test_the_process_puts_rows_and_frames_on_the_disk(tmp_path, monkeypatch):
    """Its work in this process: a block is on the disk, not only with the system."""
    path = tmp_path / "run.mf4"
    on_disk = []
    monkeypatch.setattr(os, "fsync", lambda _: on_disk.append(path.stat().st_size))
    monkeypatch.setattr(os, "nice", lambda _: 0, raising=False)
    recording = plan(path)
    ring, (ours, its) = SharedRing(1 << 16), Pipe()
    ring.put(_ROW, struct.pack("<2d", 0.25, 2e5))
    for message in pack_frames([Frame(0x181, b"\1")], 250_000_000, is_received=True):
        ring.put(_FRAMES, message)
    ours.send(None)  # the word that ends it
    progress = Progress(recording.paths)
    record(recording, ring, progress, its)
    assert ours.recv() is None  # its files were open
    assert on_disk
    report = progress.report({})
    assert (report.rows, report.frames) == (1, 1)
    assert read_recording(path).tolist() == [(0.25, 2e5)]
    assert [tuple(each) for each in read_frames(path)] == [(Frame(0x181, b"\1"), 250_000_000, True)]


def test_all_that_was_recorded_is_in_the_files(tmp_path):
    csv, mf4 = tmp_path / "run.csv", tmp_path / "run.mf4"
    with RecorderProcess(plan(csv, mf4)) as recorder:
        feed(recorder, 0, 500)
    report = recorder.report
    assert (report.rows, report.frames, report.lost, report.problems) == (500, 500, 0, [])
    expected = [(number * 1e-3, 1e5 * number) for number in range(500)]
    assert read_recording(csv).tolist() == read_recording(mf4).tolist() == expected
    frames = list(read_frames(mf4))
    assert [logged.now for logged in frames] == [n * 1_000_000 for n in range(500)]
    assert {logged.frame for logged in frames} == {Frame(0x181, bytes(2), bus=1)}


WRITING, WAITING = 1, 2
"""Seeds of the moment, and what the recorder does when it is killed."""


@pytest.mark.parametrize("seed", [WRITING, WAITING])
def test_a_killed_recorder_leaves_all_but_its_last_block(tmp_path, seed):
    """Blocks are of 0.25 s at most; what was taken for an earlier one is in the files."""
    paths = csv, mf4, log = [tmp_path / f"run{suffix}" for suffix in (".csv", ".mf4", ".log")]
    generator = random.Random(seed)  # noqa: S311 - no secret
    first, more = (generator.randrange(100, 2000) for _ in range(2))
    with RecorderProcess(plan(*paths)) as recorder:
        feed(recorder, 0, first)
        wait_until_taken(recorder)
        feed(recorder, first, first + more)
        wait_until_taken(recorder)
        while seed == WAITING and len(read_recording(csv)) < first + more:
            os.sched_yield()
        os.kill(recorder.pid, signal.SIGKILL)
        feed(recorder, first + more, first + more + 100)  # the loop goes on
    held = []
    for rows in (read_recording(csv).tolist(), read_recording(mf4).tolist()):
        assert len(rows) >= first
        assert rows == [(number * 1e-3, 1e5 * number) for number in range(len(rows))]
        held.append(len(rows))
    times = [logged.now for logged in read_frames(log)]
    assert len(times) >= first
    assert times == [number * 1_000_000 for number in range(len(times))]
    # What is counted is in the files; a block may be there that was not yet counted.
    counted = [file.rows or file.frames for file in recorder.report.files]
    for file, count, in_file in zip(
        recorder.report.files, counted, (*held, len(times)), strict=True
    ):
        assert first <= count <= in_file
        assert file.problem == (
            f"{file.path}: recording ended at {(count - 1) * 1e-3:.3f} s: the recorder's process "
            "was killed (SIGKILL, by somebody or for want of memory); what was written before is "
            "readable"
        )


class Clock:
    """One that is due whenever it is asked."""

    def __init__(self):
        self._now = 0

    def __call__(self):
        self._now += LOOK
        return self._now


def feed_until_told(recorder, caplog, first):
    """Append rows for as long as nothing is said; pytest-timeout ends it otherwise."""
    while not caplog.messages:
        feed(recorder, first, first + 1)
        first += 1
    return first


def test_a_killed_recorder_is_said_at_once_and_once(tmp_path, caplog):
    path = tmp_path / "run.csv"
    with RecorderProcess(plan(path), Clock()) as recorder:
        feed(recorder, 0, 10)
        while recorder.report.rows < 10:
            os.sched_yield()
        os.kill(recorder.pid, signal.SIGKILL)
        feed_until_told(recorder, caplog, 10)
        assert not recorder.report.is_complete
        feed(recorder, 100, 200)
    (said,) = caplog.messages
    assert said == recorder.report.problems[0]
    assert said.startswith(f"{path}: recording ended at 0.009 s: the recorder's process was killed")
    assert (recorder.report.rows, recorder.report.lost) == (10, 0)


def test_an_error_in_the_recorder_is_said_in_a_line(tmp_path, caplog, capfd):
    path = tmp_path / "run.csv"
    with RecorderProcess(plan(path), Clock()) as recorder:
        recorder._ring.put(1, b"half a row")  # which it cannot take apart
        feed_until_told(recorder, caplog, 0)
    (said,) = caplog.messages
    assert "the recorder's process ended by an error of hil-bench (ValueError: " in said
    assert capfd.readouterr().err == ""


def test_a_recorder_that_is_too_slow_is_said_at_once_and_once(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr("hil_bench.abilities.recording.recorder_process.CAPACITY", 1000)
    path = tmp_path / "run.csv"
    with RecorderProcess(plan(path), Clock()) as recorder:
        os.kill(recorder.pid, signal.SIGSTOP)
        feed(recorder, 0, 500)
        os.kill(recorder.pid, signal.SIGCONT)
    assert caplog.messages == [
        f"{path}: the recorder is too slow, or its disk: the recording has gaps from now on"
    ]
    assert not recorder.report.is_complete


@pytest.mark.skipif(resource is None, reason="limits the size of files by setrlimit")
def test_a_full_disk_is_said_at_once_with_what_is_on_it(tmp_path, caplog):
    """The kernel refuses to let a file grow, as where the disk is full."""
    csv, mf4 = tmp_path / "run.csv", tmp_path / "run.mf4"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    recorder = RecorderProcess(plan(csv, mf4), Clock())
    resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, before[1]))  # the recorder inherits it
    try:
        recorder.start()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    feed(recorder, 0, 100)
    while recorder.report.rows < 100:
        os.sched_yield()
    feed(recorder, 100, 3000)  # as text 14 to 20 bytes a row; compressed a fraction of it
    while not caplog.messages:
        recorder._look()
    recorder.stop()
    of_csv, of_mf4 = recorder.report.files
    rows = len(read_recording(csv))
    assert caplog.messages == [of_csv.problem]
    assert of_csv.problem == (
        f"{csv}: recording ended at {(rows - 1) * 1e-3:.3f} s: File too large; what was written "
        "before is readable"
    )
    assert of_csv.rows == rows >= 100
    assert csv.stat().st_size <= 30_000
    assert (of_mf4.rows, of_mf4.problem) == (3000, "")
    assert len(read_recording(mf4)) == 3000


KILLED_LOOP = """
import os, signal, sys
sys.path.insert(0, sys.argv[2])
from pathlib import Path
from test_recorder_process import RecorderProcess, feed, plan
if __name__ == "__main__":
    recorder = RecorderProcess(plan(Path(sys.argv[1])))
    recorder.start()
    feed(recorder, 0, 700)
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_loop_leaves_the_recorder_to_write_all(tmp_path, make_file):
    script = make_file("killed_loop.py", KILLED_LOOP)
    path = tmp_path / "run.mf4"
    # Ends when the recorder does too, which has the same standard output.
    ended = subprocess.run(  # noqa: S603 - our own script
        [sys.executable, str(script), str(path), str(Path(__file__).parent)],
        stdout=subprocess.PIPE,
        check=False,
    )
    assert ended.returncode == -signal.SIGKILL
    assert len(read_recording(path)) == 700


def test_a_file_that_cannot_be_written_is_told_before_the_run(tmp_path):
    path = tmp_path / "no" / "run.csv"
    with (
        pytest.raises(ConfigError, match=rf"^{path}: there is no folder {path.parent}; make"),
        RecorderProcess(plan(path)),
    ):
        pass


def test_a_loop_that_is_faster_than_the_recorder_counts_what_it_leaves_out(tmp_path, monkeypatch):
    monkeypatch.setattr("hil_bench.abilities.recording.recorder_process.CAPACITY", 1000)
    with RecorderProcess(plan(tmp_path / "run.mf4")) as recorder:
        os.kill(recorder.pid, signal.SIGSTOP)
        feed(recorder, 0, 500)
        os.kill(recorder.pid, signal.SIGCONT)
    # 1000 bytes hold 12 + 24 (frame, 22 bytes) and 12 + 16 (row) bytes, each filled up to 8.
    assert recorder.report.rows + recorder.report.frames + recorder.report.lost == 1000
    assert recorder.report.lost > 900
