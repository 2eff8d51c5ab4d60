"""The snapshot between two processes: whole rows, no waiting, nothing left behind."""

import multiprocessing
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from hil_bench.outside.helper_process import Snapshot, SnapshotRow

WIDTH = 64
SPAWN = multiprocessing.get_context("spawn")


def test_there_is_no_row_before_the_first_is_written():
    assert Snapshot(WIDTH).read() is None


def test_a_reader_sees_the_newest_row():
    snapshot = Snapshot(2)
    snapshot.write((1.0, 2.0))
    snapshot.write((3.0, 4.0))

    assert snapshot.read() == SnapshotRow(2, (3.0, 4.0))
    assert snapshot.read() == SnapshotRow(2, (3.0, 4.0))


def test_a_row_half_written_is_not_shown():
    snapshot = Snapshot(2)
    snapshot.write((1.0, 2.0))
    snapshot._memory[8:16] = b"\x00\x00\x00\x00\x00\x00\x08@"

    assert snapshot.read() is None
    snapshot.write((5.0, 6.0))
    assert snapshot.read() == SnapshotRow(2, (5.0, 6.0))


def test_a_row_of_the_wrong_length_is_refused():
    with pytest.raises(Exception, match="pack expected 3 items"):
        Snapshot(2).write((1.0,))


def read_many(snapshot, found):
    """Reads until the row 0 tells the end; sends what was wrong and how many rows were seen."""
    last, torn, seen = 0, 0, 0
    found.send("ready")
    while True:
        row = snapshot.read()
        if row is None:
            continue
        torn += len(set(row.values)) != 1 or row.sequence < last
        seen += row.sequence != last
        last = row.sequence
        if row.values[0] < 0.0:
            break
    found.send((torn, seen))


@pytest.mark.long
def test_a_reader_in_another_process_never_sees_a_torn_row():
    snapshot = Snapshot(WIDTH)
    here, there = SPAWN.Pipe()
    reader = SPAWN.Process(target=read_many, args=(snapshot, there))
    reader.start()
    assert here.recv() == "ready"
    # All values of a row are the same, so that a torn row shows.
    for number in range(200_000):
        snapshot.write([float(number)] * WIDTH)
    snapshot.write([-1.0] * WIDTH)
    torn, seen = here.recv()
    reader.join()

    assert torn == 0
    assert seen > 1
    assert reader.exitcode == 0


def wait_for_ever(_snapshot, found):
    found.send("ready")
    found.recv()


def test_a_reader_that_is_killed_leaves_the_writer_at_work():
    snapshot = Snapshot(1)
    here, there = SPAWN.Pipe()
    reader = SPAWN.Process(target=wait_for_ever, args=(snapshot, there))
    reader.start()
    assert here.recv() == "ready"
    assert reader.pid is not None
    os.kill(reader.pid, signal.SIGKILL)
    reader.join()
    snapshot.write((7.0,))

    assert snapshot.read() == SnapshotRow(1, (7.0,))


PROGRAM = """
import multiprocessing, os, signal, sys
from hil_bench.outside.helper_process import Snapshot

def read(snapshot, pipe):
    pipe.send(snapshot.read().values)
    os.kill(os.getpid(), signal.SIGKILL)

if __name__ == "__main__":
    print(os.getpid())
    context = multiprocessing.get_context("spawn")
    snapshot = Snapshot(1)
    snapshot.write([3.0])
    here, there = context.Pipe()
    reader = context.Process(target=read, args=(snapshot, there))
    reader.start()
    print(here.recv())
    reader.join()
    print(reader.exitcode)
"""


def test_nothing_is_left_behind_nor_said_when_a_reader_is_killed(make_file):
    program = make_file("program.py", PROGRAM)
    done = subprocess.run(  # noqa: S603 - the program just written
        [sys.executable, "-W", "error", program], capture_output=True, text=True, check=True
    )

    pid, values, exit_code = done.stdout.splitlines()
    assert (values, exit_code) == ("(3.0,)", "-9")
    assert done.stderr == ""
    shared = Path("/dev/shm")  # noqa: S108 - only looked at
    assert not list(shared.glob(f"pym-{pid}-*"))
