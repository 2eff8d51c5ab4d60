"""Programs whose SYNC is their clock, beside other controllers on one bench."""

import json
import os
import select
import sys

import pytest
from support.bus_programs import JOIN

from hil_bench import VirtualBench, load_config
from hil_bench.errors import ConfigError, ControllerError

PROGRAM = (
    JOIN
    + """
for number in range(int(sys.argv[1])):
    say(f"< send 321 1 {number:02X} >")
    sync()
say("< send 322 0 >")
sys.exit(int(sys.argv[2]))
"""
)
LAMP = """
import can

def blinks(rig):
    while True:
        rig.bus.send(can.Message(arbitration_id=0x111, data=[], is_extended_id=False))
        rig.sleep(0.005)
"""


def make_bench(folder, words, more=""):
    (folder / "program.py").write_text(PROGRAM)
    (folder / "lamp.py").write_text(LAMP)
    command = json.dumps([sys.executable, str(folder / "program.py"), *words])
    text = f'[controllers.main]\nkind = "process"\ncommand = {command}\n{more}'
    text += '[controllers.lamp]\nkind = "python"\ncall = "lamp.py:blinks"\n'
    (folder / "bench.toml").write_text(text)
    return VirtualBench(load_config(folder / "bench.toml"))


def frames_of(bench, *wanted):
    return [
        (each.now // 1_000_000, each.frame.can_id, bytes(each.frame.data))
        for each in bench.frames
        if each.frame.can_id in wanted
    ]


def test_its_sync_is_its_clock_and_the_bench_goes_on_behind_its_end(tmp_path):
    with make_bench(tmp_path, ["5", "0"]) as bench:
        bench.run(0.02)
        # A cycle begins with its frame, which is served at once, and ends with SYNC, a tick later.
        assert frames_of(bench, 0x321) == [(k, 0x321, bytes([k])) for k in range(5)]
        assert frames_of(bench, 0x080) == [(k, 0x080, b"") for k in range(1, 6)]
        assert frames_of(bench, 0x322) == [(5, 0x322, b"")]  # the last words of a program that ends
        assert frames_of(bench, 0x111) == [(k, 0x111, b"") for k in (1, 6, 11, 16)]


def test_both_give_the_same_frames_at_every_run(tmp_path):
    runs = []
    for _ in range(3):
        with make_bench(tmp_path, ["8", "0"]) as bench:
            bench.run(0.02)
            runs.append([tuple(each) for each in bench.frames])
    assert runs[0] == runs[1] == runs[2]


def test_an_exit_code_ends_the_run_with_the_last_lines(tmp_path):
    with make_bench(tmp_path, ["2", "7"]) as bench, pytest.raises(ControllerError) as error:
        bench.run(0.02)
    assert str(error.value).startswith("controller main: ")
    assert "has ended, exit code 7" in str(error.value)


def test_its_end_in_order_is_told(tmp_path, caplog):
    with make_bench(tmp_path, ["2", "0"]) as bench:
        bench.run(0.02)
    assert "controller main: has ended: exit code 0" in caplog.text


CHILD = """
import subprocess
subprocess.Popen(["sleep", "100"], stdout=open(sys.argv[1], "wb"))
while True:
    sync()
"""


def test_no_child_of_it_stays(tmp_path):
    """The child alone has the other end of a pipe, which closes with it."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "parent.py").write_text(JOIN + CHILD)
    command = [sys.executable, str(tmp_path / "parent.py"), str(tmp_path / "pipe")]
    tables = {"controllers": {"main": {"kind": "process", "command": command}}}
    ours = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    with VirtualBench(load_config(tables=tables)) as bench:
        bench.run(0.005)
        assert select.select([ours], [], [], 0)[0] == []
    assert select.select([ours], [], [], 10)[0] == [ours]
    assert os.read(ours, 1) == b""
    os.close(ours)


@pytest.mark.parametrize("kind", ["process", "program"])
def test_a_command_needs_a_word(kind):
    tables = {"controllers": {"main": {"kind": kind, "command": []}}}
    with pytest.raises(ConfigError, match="command: is empty; give the program and its arguments"):
        load_config(tables=tables)


def test_on_copper_it_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"\[bus\.wire\]: a controller whose SYNC is its clock"):
        make_bench(tmp_path, ["1", "0"], "[bus]\n[bus.wire]\n")


COUNTING = (
    PROGRAM.partition("for number")[0]
    + """
asked = " 8 40 00 10 00 00 00 00 00 >"
for number in range(10):
    say(f"< send 080 0 >< send 601{asked}< send 602{asked}< send 604{asked}")
    text, pieces = b"", 0
    while b"frame 584" not in text:
        text += bus.recv(65536)
        pieces += 1
    say(f"< send 321 2 {pieces:02X} {text.count(b'<'):02X} >")
"""
)


def test_what_it_asks_in_one_piece_is_answered_in_one_piece(tmp_path):
    """Each piece wakes the program, and it has no use for half of an answer."""
    (tmp_path / "counting.py").write_text(COUNTING)
    command = [sys.executable, str(tmp_path / "counting.py")]
    tables = {"controllers": {"main": {"kind": "process", "command": command}}}
    with VirtualBench(load_config(tables=tables)) as bench:
        bench.run(0.011)
        counts = [tuple(data) for _, _, data in frames_of(bench, 0x321)]
    assert len(counts) == 10
    assert [pieces for pieces, _ in counts[1:]] == [1] * 9  # with the first come the boot-ups
    assert all(frames >= 3 for _, frames in counts)  # with heartbeats of the nodes among them
