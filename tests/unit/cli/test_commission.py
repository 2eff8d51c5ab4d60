"""`hil-bench commission`."""

import re
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.direct_lockstep import DirectLockStep
from support.tables import from_text

from hil_bench import load_config, read_frames
from hil_bench.abilities.commissioning.plan import load_plan
from hil_bench.abilities.commissioning.verbs import commission
from hil_bench.abilities.common.progress import Work
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.cli import main

LOCKSTEP = "hil_bench.abilities.lockstep.commission_options"
PLAN = """
[plan]
bench = "sheet.toml"
period_ms = 4
[limits]
position_mm = [-150, 150]
speed_mm_s = 400
pressure_bar = [-1, 110]
[communication]
[sensors]
duration_s = 0.2
[direction]
"""
FAST = "[bench]\ntick_us = 2000\nstep_us = 200\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(
        "hil_bench.abilities.commissioning.report.importlib.util.find_spec", lambda _: None
    )
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plan.toml").write_text(PLAN)
    (tmp_path / "sheet.toml").write_text(FAST)
    return tmp_path


def test_a_virtual_machine_passes_and_leaves_report_and_recording(folder, cli):
    out = cli("commission plan.toml --virtual --output out").out.splitlines()
    assert [line.split() for line in out[:3]] == [
        ["communication", "passed"],
        ["sensors", "passed"],
        ["direction", "passed"],
    ]
    # Transmission type, event timer and heartbeat of four devices; the valve's supervision of us.
    assert out[3] == "settings  restored: 14 of nodes 1, 2, 3, 4"
    assert out[4] == "nodes     1, 2, 3, 4: PRE-OPERATIONAL again"
    assert out[5] == "verdict   passed"
    assert re.fullmatch(r"recorded  \d+ rows, \d+ frames: out/commissioning.mf4", out[7])
    report = (folder / "out" / "report.md").read_text(encoding="utf-8")
    assert "| data sheet | sheet.toml |" in report
    assert "| 4 | HIL bench linear encoder |" in report
    assert "| 4 | 0x1017 (Producer heartbeat time) | 0 | 100 | restored |" in report
    signals = read_recording(folder / "out" / "commissioning.mf4")
    assert sorted(set(signals["step"])) == [2.0, 3.0]
    setpoint = signals["axis1.spool_setpoint"]
    # The set-point of the direction's pulses: 40 % each way, out of the valve's own words too.
    assert (setpoint.min(), setpoint.max()) == (-0.4, 0.4)
    frames = list(read_frames(folder / "out" / "commissioning.mf4"))
    assert {0x080, 0x201, 0x181, 0x184} <= {logged.frame.can_id for logged in frames}
    sent = {logged.frame.can_id for logged in frames if not logged.is_received}
    assert 0x201 in sent
    # One time base: the sample of a SYNC is dated when the SYNC was sent.
    syncs = [round(logged.now * 1e-9, 6) for logged in frames if logged.frame.can_id == 0x080]
    assert {round(time, 6) for time in signals["time"]} <= set(syncs)
    assert 0x181 not in sent


def test_another_machine_than_the_data_sheets_fails_by_name(folder, cli):
    (folder / "machine.toml").write_text(
        FAST + "[plant.axis1]\nsupply_pressure_bar = 0.001\ntank_pressure_bar = 0\n"
    )
    arguments = ["plan.toml", "--virtual", "--machine", "machine.toml"]
    out = cli(["commission", *arguments], 1).out
    assert "\nfound     no supply pressure: no motion and no force: " in out
    assert "verdict   failed" in out


def test_a_recording_that_failed_is_told_and_the_rest_goes_on(folder, monkeypatch, cli):
    def write_rows(_file, _rows):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("hil_bench.abilities.recording.mdf_writer.MdfFile.write_rows", write_rows)
    out = cli("commission plan.toml --virtual --output out", 5).out
    assert "verdict   passed" in out
    problem = next(line for line in out.splitlines() if "No space left on device" in line)
    report = (folder / "out" / "report.md").read_text(encoding="utf-8")
    assert f"| recording | commissioning.mf4; {problem.strip()} |" in report


def test_in_lockstep_every_run_leaves_the_same_recording(folder, monkeypatch, capsys):
    recordings = []
    for name in ("first", "second"):
        bus = DirectLockStep(load_config(folder / "sheet.toml"))
        monkeypatch.setattr(f"{LOCKSTEP}.open_transport", lambda *_, bus=bus: bus)
        arguments = ["plan.toml", "-i", "virtual", "--lockstep", "--yes", "--output", name]
        assert main(["commission", *arguments]) == 0, capsys.readouterr()
        recordings.append((folder / name / "commissioning.mf4").read_bytes())
    assert recordings[0] == recordings[1]
    signals = read_recording(folder / "first" / "commissioning.mf4")
    assert (signals["axis1.spool_setpoint"].min(), signals["axis1.spool_setpoint"].max()) == (
        *(-0.4, 0.4),
    )
    # Time is bench time: a sample each 4 ms of it, without a gap in a motion of 0.4 s.
    steps = signals["time"][signals["axis1.spool_setpoint"] == 0.4]
    assert steps[-1] - steps[0] == pytest.approx(0.4 - 0.004, abs=1e-9)
    report = (folder / "first" / "report.md").read_text(encoding="utf-8")
    assert "| bus | direct in lock-step |" in report


def test_a_plan_that_leaves_the_stroke_is_refused_before_the_bus_is_used(
    folder, monkeypatch, capsys
):
    monkeypatch.setattr(
        "hil_bench.abilities.common.controller_side.open_can_bus",
        lambda *_: pytest.fail("bus opened"),
    )
    plan = PLAN.replace("[-150, 150]", "[-150, 250]")
    (folder / "plan.toml").write_text(plan)
    assert main(["commission", "plan.toml", "-i", "virtual", "-c", "x", "--yes"]) == 2
    # A line for each of the three steps, for the limits are of them all; Table I: 400 mm of stroke.
    err = capsys.readouterr().err.splitlines()
    assert err[-1] == (
        "hil-bench: error: plan.toml:direction: may go from -150 to 250 mm, the stroke is "
        "-200 to 200 mm; give position_mm within it, or contact_speed_mm_s too if the piston "
        "may touch its stops"
    )
    assert len(err) == 3


@pytest.mark.usefixtures("folder")
def test_a_silent_bus_is_inconclusive_and_nobody_is_asked(cli, monkeypatch):
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("builtins.input", lambda _text: pytest.fail("asked"))
    out, err = cli("commission plan.toml -i virtual -c test_commission", 6)
    assert out.count("found     node missing: ") == 4
    assert "\nverdict   inconclusive\n" in out
    assert err == ""


def test_without_anybody_to_ask_the_bus_is_not_used(folder, monkeypatch, cli):
    monkeypatch.setattr("sys.stdin.isatty", lambda: False)
    monkeypatch.setattr(
        "hil_bench.abilities.common.controller_side.open_can_bus",
        lambda *_: pytest.fail("bus opened"),
    )
    assert cli("commission plan.toml -i virtual -c x", 2).err == (
        "hil-bench: error: motion needs a confirmation, and this is no terminal; "
        "give --yes to move without asking\n"
    )
    assert not list((folder / "hil-bench-commissioning").iterdir())


LEFT = (
    '{"node": 4, "object": "0x1017.00", "name": "Producer heartbeat time", '
    '"before": "e803", "during": "6400"}\n'
)


@pytest.fixture
def lockstep_bus(folder, monkeypatch):
    """A bench in lock-step that the verb is joined with, and the words that say so."""
    bus = DirectLockStep(load_config(folder / "sheet.toml"))
    monkeypatch.setattr(f"{LOCKSTEP}.open_transport", lambda *_: bus)
    return bus, ["plan.toml", "-i", "virtual", "--lockstep", "--yes", "--output", "out"]


def test_what_a_killed_run_left_changed_is_restored_on_request(folder, lockstep_bus, cli):
    bus, words = lockstep_bus
    (folder / "out").mkdir()
    left = folder / "out" / "unrestored.jsonl"
    left.write_text(LEFT)
    # Another run would take what is changed now for what was there before.
    assert cli(["commission", *words], 2).err == (
        "hil-bench: error: out/unrestored.jsonl: an earlier run was ended before it could restore "
        "these settings; restore them: hil-bench commission plan.toml sheet.toml -i virtual "
        "--lockstep --output out --restore (or remove the file)\n"
    )
    assert cli(["commission", *words, "--restore"]).out == "settings  restored: 1 of node 4\n"
    assert bus.bench.nodes[3].object_dictionary.number(0x1017) == 1000
    assert not left.exists()


def test_what_cannot_be_restored_is_told_with_the_command_that_mends_it(folder, lockstep_bus, cli):
    _, words = lockstep_bus
    command = "hil-bench commission plan.toml sheet.toml -i virtual --lockstep"
    (folder / "out").mkdir()
    (folder / "out" / "unrestored.jsonl").write_text(LEFT.replace('"node": 4', '"node": 9'))
    assert cli(["commission", *words, "--restore"], 1).err.splitlines() == [
        "settings  not restored: 1 of node 9: node 9 does not answer",
        "          0x1017 (Producer heartbeat time): was 1000, may be 100",
        f"          mend: {command} --output out --restore",
        "          or power-cycle the device, which brings back what it has stored",
    ]
    assert (folder / "out" / "unrestored.jsonl").exists()


@from_text("arguments", "message")
@pytest.mark.usefixtures("folder")
def test_arguments_that_cannot_be_meant(arguments, message, cli):
    assert cli(["commission", *arguments.split()], 2).err == f"hil-bench: error: {message}\n"


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(("said", "moves"), [("yes", 1), (" YES ", 1), ("y", 0), ("", 0)])
def test_who_is_asked_sees_the_limits_of_each_motion(said, moves, capsys, monkeypatch):
    """Meanwhile no line of progress comes between the question and the answer."""
    plan, work, waiting = load_plan(Path("plan.toml")), Work("commission"), []

    def answer(_text):
        waiting.append(work.is_waiting)
        return said

    monkeypatch.setattr("builtins.input", answer)
    assert commission._confirmed(SimpleNamespace(description="can0"), plan, work) == moves
    assert (waiting, work.is_waiting) == ([True], False)
    assert capsys.readouterr().err == (
        "The axis on can0 is going to move:\n"
        "  direction: position -150 to 150 mm, speed to 400 mm/s, pressure -1 to 110 bar, "
        "time to 60 s\n"
    )
