"""`hil-bench test` on a machine, which is a virtual bench here, behind its bus."""

import contextlib

import numpy as np
import pytest
from support.machines import WRONG_REVISION
from support.tables import from_text

from hil_bench import VirtualBench, load_config
from hil_bench.abilities.common.controller_side import OpenNetwork
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.abilities.scenario.recorded import SetPoints, lay_samples
from hil_bench.abilities.scenario.resolve import SetAction
from hil_bench.abilities.scenario.verbs import machine_test
from hil_bench.cli import main
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.outside.recording.channels import TIME, Channel, recording_dtype
from hil_drivers import Network

HEAD = 'title = "T"\nduration_s = 0.8\n'
PLAN = """[plan]
period_ms = 2
[limits]
position_mm = [-150, 150]
speed_mm_s = 400
pressure_bar = [-1, 120]
time_s = 2
[communication]
"""
MOVE = '[[step]]\nat_s = 0.1\nset = { "valve.spool_setpoint" = 0.6 }\n'
STOP = '[[step]]\nat_s = 0.5\nset = { "valve.spool_setpoint" = 0.0 }\n'
BUS = ["-i", "virtual", "-c", "machine-test"]


def expect(*texts):
    return "".join(f"[[expect]]\nid = \"R{k}\"\nthat = '{that}'\n" for k, that in enumerate(texts))


class Bench:
    """The machine; opened when the bus is."""

    def __init__(self, tmp_path, monkeypatch):
        self.tmp_path, self.bench, self.text = tmp_path, None, None
        monkeypatch.setattr(machine_test, "open_network", self.open)

    @contextlib.contextmanager
    def open(self, _args, _config):
        path = None
        if self.text is not None:
            path = self.tmp_path / "real.toml"
            path.write_text(self.text)
        self.bench = VirtualBench(load_config(path))
        with self.bench as bench, Network(bench.bus, clock=bench.now) as network:
            bench.pump = network.pump
            yield OpenNetwork(network, "virtual bench", bench)

    def test(self, *texts, plan=PLAN, words=("--yes",)):
        paths = []
        for number, text in enumerate(texts):
            path = self.tmp_path / f"{number}.scenario.toml"
            path.write_text(HEAD + text)
            paths.append(str(path))
        (self.tmp_path / "plan.toml").write_text(plan)
        more = ["--plan", str(self.tmp_path / "plan.toml"), "--output", str(self.tmp_path / "o")]
        return main(["test", *paths, *BUS, *more, *words])

    @property
    def spool(self):
        return self.bench.signals["axis1.spool_setpoint"]


@pytest.fixture
def machine(tmp_path, monkeypatch):
    return Bench(tmp_path, monkeypatch)


def test_the_set_points_of_the_file_move_the_machine(machine, capsys):
    """The valve opens behind 23 % (README), so that 60 % moves the piston, and 0 stops it."""
    wanted = expect(
        "always from 0 s to 98 ms abs(axis1.speed) < 1 mm/s",
        "eventually from 0.2 s to 0.5 s axis1.speed > 50 mm/s",
        "always after 0.7 s abs(position.measured_speed) < 5 mm/s",
        "always pressure_a.measured < 1 bar",
    )
    assert machine.test(MOVE + STOP + wanted) == ExitCode.CHECK_FAILED
    outcomes = [line.split()[1] for line in capsys.readouterr().out.splitlines() if "R" in line[:4]]
    assert outcomes == ["passed", "passed", "passed", "failed"]
    assert machine.spool.max() == pytest.approx(0.6, abs=1e-4)
    opened = np.count_nonzero(machine.spool > 0.5) * machine.bench.config.tick_ns * 1e-9
    assert opened == pytest.approx(0.4, abs=0.003)  # from 0.1 s to 0.5 s, at samples of 2 ms
    assert machine.spool[-1] == 0.0


def test_a_limit_closes_the_valve_and_nothing_moves_behind_it(machine, capsys):
    plan = PLAN.replace("[-150, 150]", "[-5, 5]")
    text = MOVE + expect("always axis1.P_A < 250 bar")
    assert machine.test(text, text, plan=plan) == ExitCode.CHECK_FAILED
    out = capsys.readouterr().out
    assert "mm is beyond its limit of 5 mm; the valve was closed" in out
    assert "not run: an earlier scenario was stopped" in out
    position = machine.bench.signals["axis1.position"]
    assert 0.005 < position.max() < 0.012
    starts = np.flatnonzero(np.diff((machine.spool > 0.5).astype(int)) == 1)
    assert len(starts) == 1
    assert machine.spool[-1] == 0.0


def test_an_interruption_closes_the_valve(machine, capsys, monkeypatch):
    real = SetPoints.at

    def interrupted(self, time):
        if time >= 0.3:
            raise KeyboardInterrupt
        return real(self, time)

    monkeypatch.setattr(SetPoints, "at", interrupted)
    text = MOVE + expect("always axis1.P_A < 250 bar")
    assert machine.test(text, text) == ExitCode.INTERRUPTED
    out = capsys.readouterr().out
    assert "interrupted; the valve was closed" in out
    assert "not run" in out
    assert machine.spool[-1] == 0.0


def test_a_device_that_is_another_one_is_not_moved(machine, capsys):
    machine.text = WRONG_REVISION
    text = MOVE + expect("always axis1.P_A < 250 bar")
    assert machine.test(text) == ExitCode.CHECK_FAILED
    assert "nothing was moved; wrong EDS revision" in capsys.readouterr().out
    assert not machine.spool.any()


def test_a_fault_of_the_valve_ends_the_motion(machine, capsys):
    machine.text = '[[faults]]\nkind = "disable"\ntarget = "valve"\nat_s = 0.9\n'
    text = MOVE + expect("always axis1.P_A < 250 bar")
    assert machine.test(text) == ExitCode.CHECK_FAILED
    assert "the valve was closed" in capsys.readouterr().out
    assert machine.spool[-1] == 0.0


HOLDS = expect("always axis1.P_A < 250 bar")


@from_text("text", "wrong")
def test_what_a_machine_lacks_is_refused_before_the_bus_is_opened(machine, capsys, text, wrong):
    assert machine.test(MOVE + HOLDS, text) == ExitCode.USAGE
    error = capsys.readouterr().err
    assert wrong in error
    assert "1.scenario.toml" in error
    assert machine.bench is None


@pytest.mark.parametrize(
    ("plan", "wrong"),
    [
        (PLAN.replace("time_s = 2", "time_s = 0.5"), "lasts 0.8 s, the limit is 0.5 s"),
        (PLAN.replace("150]", "900]"), "give position_mm within it"),
    ],
)
def test_limits_are_held_against_the_file_first(machine, capsys, plan, wrong):
    assert machine.test(MOVE + HOLDS, plan=plan) == ExitCode.USAGE
    assert wrong in capsys.readouterr().err
    assert machine.bench is None


def test_nothing_moves_unasked(machine, capsys, monkeypatch):
    assert machine.test(MOVE + HOLDS, words=()) == ExitCode.USAGE
    assert "give --yes to move without asking" in capsys.readouterr().err
    assert machine.bench is None
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("builtins.input", lambda _question: "no")
    assert machine.test(MOVE + HOLDS, words=()) == ExitCode.USAGE
    found = capsys.readouterr().err
    assert "0.scenario.toml: for 0.8 s, from -150 to 150 mm" in found
    assert "motion was not confirmed; nothing was moved" in found
    assert machine.bench.now() == 0.0
    monkeypatch.setattr("builtins.input", lambda _question: "yes")
    assert machine.test(MOVE + HOLDS, words=()) == ExitCode.DONE


@from_text("words", "wrong")
def test_a_machine_has_its_own_arguments(make_file, cli, words, wrong):
    path = make_file("a.scenario.toml", HEAD + MOVE + HOLDS)
    assert wrong in cli(["test", str(path), *words.split()], ExitCode.USAGE).err


def test_set_points_go_straight_from_point_to_point():
    """A ramp begins where the step before it has come to; a course waits for its first point."""
    actions = [
        (100, SetAction("v", 0.4, 200)),
        (200, SetAction("v", 0.0, 100)),
        (400, SetAction("v", 0.5, 0, ((50, 0.1), (150, 0.5)))),
    ]
    found = SetPoints(actions, 1_000_000)
    times = (0.0, 0.099, 0.15, 0.2, 0.25, 0.3, 0.449, 0.45, 0.5, 0.55, 9.0)
    wanted = (0.0, 0.0, 0.1, 0.2, 0.1, 0.0, 0.0, 0.1, 0.3, 0.5, 0.5)
    assert [found.at(time) for time in times] == pytest.approx(wanted)


def test_a_sample_that_was_left_out_is_unknown():
    """Samples come late by parts of a period; each belongs to the nearest point of the grid."""
    dtype = recording_dtype((TIME, Channel("speed", "m/s")))
    samples = np.array([(0.0001, 1.0), (0.0024, 2.0), (0.0081, 5.0), (0.0121, 7.0)], dtype=dtype)
    trace = lay_samples(samples, {"axis1.speed": "speed"}, 6, 0.002)
    np.testing.assert_equal(trace.columns["axis1.speed"], [1, 2, np.nan, np.nan, 5, np.nan])
    assert trace.planned == 6


def test_what_the_drivers_tell_is_recorded_with_the_set_points(machine, tmp_path):
    path = tmp_path / "run.csv"
    assert (
        machine.test(
            MOVE + STOP + expect("always axis1.P_A < 250 bar"),
            words=("--yes", "--record", str(path)),
        )
        == 0
    )
    recording = read_recording(path)
    # A row each 2 ms of 0.8 s; the valve is open from 0.1 s to 0.5 s.
    assert len(recording) == pytest.approx(401, abs=2)
    is_open = recording["axis1.spool_setpoint"] > 0.5
    assert np.count_nonzero(is_open) * 2e-3 == pytest.approx(0.4, abs=0.004)
    assert np.ptp(recording["axis1.position"]) > 0.02


def test_a_lost_recording_is_lost_output(machine, tmp_path, monkeypatch, capsys):
    def write_rows(_file, _rows):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("hil_bench.abilities.recording.mdf_writer.MdfFile.write_rows", write_rows)
    for that, code in (
        ("always axis1.P_A < 250 bar", ExitCode.LOST),
        ("always axis1.P_A < 0 bar", ExitCode.CHECK_FAILED),
    ):
        words = ("--yes", "--record", str(tmp_path / "run.mf4"))
        assert machine.test(MOVE + STOP + expect(that), words=words) == code
        assert "No space left on device" in capsys.readouterr().err


def test_a_recording_without_a_machine_is_refused(make_file, capsys):
    path = make_file("a.scenario.toml", HEAD + expect("always axis1.P_A < 250 bar"))
    assert main(["test", str(path), "--record", "run.csv"]) == ExitCode.USAGE
    assert "run --scenario records a virtual bench" in capsys.readouterr().err
