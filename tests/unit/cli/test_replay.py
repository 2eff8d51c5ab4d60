"""`hil-bench replay`."""

import json
import shlex
from pathlib import Path

import can
import pytest
from support.tables import from_text

from hil_bench.bench.configuration import load_config
from hil_bench.bench.virtual_bench import VirtualBench
from hil_bench.cli import main
from hil_bench.outside.realtime.clock import VirtualClock

TWO_BUSES = Path(__file__).parents[3] / "examples/two_buses.toml"


@pytest.fixture(scope="module")
def run_mf4(tmp_path_factory):
    path = tmp_path_factory.mktemp("replay") / "run.mf4"
    with VirtualBench(record=path) as bench:
        bench.bus.send(can.Message(arbitration_id=0, data=[1, 0], is_extended_id=False))
        bench.run(0.05)
    return path


def test_frames_go_back_on_a_bus(run_mf4, monkeypatch, capsys):
    monkeypatch.setattr("hil_bench.abilities.replay.verbs.MonotonicClock", VirtualClock)
    with can.Bus(interface="virtual", channel="test_replay") as listener:
        bus = ["-i", "virtual", "-c", "test_replay"]
        assert main(["replay", str(run_mf4), *bus, "--frames", "received"]) == 0
        message = listener.recv(1.0)
        assert listener.recv(0.0) is None
    assert (message.arbitration_id, bytes(message.data)) == (0, b"\x01\x00")
    assert capsys.readouterr().out == (
        "1 of 1 frames on virtual test_replay in 0.0 s, at most 0.0 ms late\n"
    )


def test_frames_of_the_other_direction_are_none(run_mf4, capsys):
    with VirtualBench(record=run_mf4.with_name("silent.mf4")) as bench:
        bench.run(0.01)
    path = run_mf4.with_name("silent.mf4")
    bus = ["-i", "virtual", "-c", "test_replay"]
    assert main(["replay", str(path), *bus, "--frames", "received"]) == 2
    # Each of the four nodes has sent its boot-up message.
    assert capsys.readouterr().err == (
        f"hil-bench: error: {path}: has no received frames to play; all its 4 are others\n"
    )


def test_frames_of_can_fd_go_to_a_bus_of_can_fd_alone(make_file, monkeypatch, cli):
    monkeypatch.setattr("hil_bench.abilities.replay.verbs.MonotonicClock", VirtualClock)
    path = make_file("f.log", "(0.0) can0 123##1000102030405060708090A0B\n(0.1) can0 123#01\n")
    with can.Bus(interface="virtual", channel="test_replay") as listener:
        bus = ["-i", "virtual", "-c", "test_replay"]
        assert cli(["replay", str(path), *bus], 2).err == (
            f"hil-bench: error: {path}: has 1 frames of CAN FD; give --fd, and a bus that carries "
            "it\n"
        )
        assert listener.recv(0.0) is None
        assert main(["replay", str(path), *bus, "--fd"]) == 0
        message = listener.recv(1.0)
    assert (message.is_fd, message.bitrate_switch) == (True, True)
    assert bytes(message.data) == bytes(range(12))


def test_frames_of_another_bus_are_not_put_on_this_one(make_file, monkeypatch, cli, tmp_path):
    monkeypatch.setattr("hil_bench.abilities.replay.verbs.MonotonicClock", VirtualClock)
    log = make_file("f.log", "(0.0) can1 182#01\n(0.1) can0 181#01\n(0.2) can1 183#01\n")
    both = tmp_path / "both.mf4"
    config = load_config(TWO_BUSES)
    with VirtualBench(config, record=both) as bench:
        bench.run(0.002)
    for path, ids, others in ((log, [0x181], "2 of can1"), (both, [0x701], "3 of can1")):
        with can.Bus(interface="virtual", channel="test_replay") as listener:
            bus = ["-i", "virtual", "-c", "test_replay"]
            err = cli(["replay", str(path), str(TWO_BUSES), *bus]).err
            heard = list(iter(lambda: listener.recv(0.0), None))
        assert [message.arbitration_id for message in heard] == ids
        assert f"{path}: frames of other channels left out ({others})" in err


def test_what_a_log_has_beside_its_frames_is_not_sent_and_said(make_file, monkeypatch, cli):
    monkeypatch.setattr("hil_bench.abilities.replay.verbs.MonotonicClock", VirtualClock)
    path = make_file("f.log", "(0.0) can0 123#01\n(0.1) can0 12\n(0.2) can0 124#01")
    shown = cli(["replay", str(path), "-i", "virtual", "-c", "test_replay"])
    assert shown.out.startswith("1 of 1 frames")
    assert "f.log: line 2 is no frame of its format; left out" in shown.err
    assert "f.log: ends early: its last line has no line end, and is left out" in shown.err


def test_a_candump_log_does_not_say_who_sent_a_frame(run_mf4, cli):
    path = run_mf4.with_name("run.log")
    with VirtualBench(record=path) as bench:
        bench.run(0.01)
    bus = ["-i", "virtual", "-c", "test_replay"]
    assert cli(["replay", str(path), *bus, "--frames", "received"], 2).err == (
        f"hil-bench: error: {path}: a candump log does not say which frames were received; "
        "record .mf4, .blf or .asc, or leave --frames out\n"
    )


def test_set_points_drive_the_plant(run_mf4, cli):
    out = cli(["replay", str(run_mf4), "--virtual"]).out.splitlines()
    assert out[1].split() == (
        ["axis1.position", "0", "mm", "0", "mm", "0.001", "s", "1", "mm:", "passed"]
    )
    assert len(out) == 6


OURS = """\
time,axis1.position,axis1.spool_setpoint
s,m,-
{}"""
THEIRS = """\
s_mess;U;t
mm;V;ms
{}"""
RIG = """\
[time]
column = "t"
unit = "ms"
[position]
column = "s_mess"
unit = "mm"
offset = -50.0
[spool_setpoint]
column = "U"
unit = "V"
polarity = -1
"""


def test_the_columns_of_another_logger_are_ours(tmp_path, capsys):
    rows = [(0.002 * row, 0.0, 0.3 if row > 10 else 0.0) for row in range(100)]
    ours, theirs, rig = (tmp_path / name for name in ("ours.csv", "theirs.csv", "rig.toml"))
    ours.write_text(OURS.format("".join(f"{t!r},{x!r},{u!r}\n" for t, x, u in rows)))
    lines = [f"{1e3 * x + 50.0};{-10.0 * u};{1e3 * t}\n" for t, x, u in rows]
    theirs.write_text(THEIRS.format("".join(lines).replace(".", ",")))
    rig.write_text(RIG)
    found = []
    for file, arguments in ((ours, []), (theirs, ["--columns", str(rig)])):
        assert main(["replay", str(file), "--virtual", "--json", *arguments]) == 1
        found.append(json.loads(capsys.readouterr().out))
    (mine,), (other,) = found
    assert mine["channel"] == other["channel"] == "axis1.position"
    assert other["maximum"] == pytest.approx(mine["maximum"], rel=1e-9)
    assert mine["maximum"] > 0.001  # it has moved


@from_text("arguments", "message")
def test_columns_that_say_too_little(tmp_path, arguments, message, capsys):
    file, rig = tmp_path / "theirs.csv", tmp_path / "rig.toml"
    file.write_text(THEIRS.format("0;0;0\n0;0;1\n"))
    rig.write_text(RIG.replace("-1", '"unknown"'))
    assert main(["replay", str(file), *arguments.format(file, rig).split()]) == 2
    assert capsys.readouterr().err == f"hil-bench: error: {message.format(file)}\n"


def test_what_is_out_of_tolerance_fails(run_mf4, make_file, capsys):
    other = make_file("bench.toml", "[plant.axis1]\ninternal_leakage_l_min_bar = 0.1\n")
    arguments = ["--virtual", "--tolerance", "P_A=0.001 bar", "--json"]
    assert main(["replay", str(run_mf4), str(other), *arguments]) == 1
    verdicts = {d["channel"]: d["is_within"] for d in json.loads(capsys.readouterr().out)}
    assert not verdicts["axis1.P_A"]


@pytest.mark.parametrize(
    ("unit", "position", "code", "said"),
    [
        # 100 rows of 1 ms, of which the last 49 do not have the position.
        ("m", "nan", 6, "1 mm: inconclusive; seen 0.05 of 0.099 s"),
        (
            "bar",
            "0.0",
            2,
            'axis1.position is in "bar", which is no unit of it; give it in mm or rev',
        ),
        # No cylinder of the bench is as long.
        ("m", "9.0", 1, "axis1.position is 9000 mm at most, more than "),
    ],
)
def test_what_a_column_does_not_show_and_what_it_cannot_be(
    make_file, cli, unit, position, code, said
):
    rows = [(0.001 * row, position if row > 50 else "0.0", 0.0) for row in range(100)]
    text = OURS.format("".join(f"{t:.3f},{x},{u}\n" for t, x, u in rows))
    file = make_file("ours.csv", text.replace("s,m,-", f"s,{unit},-"))
    shown = cli(["replay", str(file), "--virtual"], code)
    assert said in shown.out + shown.err
    assert (f"{file}: " in shown.err) == (position != "nan")


@from_text("arguments", "message")
def test_arguments_that_cannot_be_meant(run_mf4, arguments, message, cli):
    assert (
        cli(["replay", str(run_mf4), *shlex.split(arguments)], 2).err
        == f"hil-bench: error: {message}\n"
    )


def test_a_speed_that_is_none(run_mf4, capsys):
    assert main(["replay", str(run_mf4), "--speed", "0"]) == 2
    assert "'0': give a positive number, or max" in capsys.readouterr().err


def test_signals_alone_are_nothing_for_a_bus(tmp_path, capsys):
    path = tmp_path / "run.csv"
    with VirtualBench(record=path) as bench:
        bench.run(0.01)
    assert main(["replay", str(path), "-i", "virtual", "-c", "x"]) == 2
    assert 'no log of frames has the suffix ".csv"' in capsys.readouterr().err
