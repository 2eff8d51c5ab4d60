"""`hil-bench run --scenario`: in real time or on a bus, with the verdicts of `hil-bench test`."""

import contextlib
import json
import math

import pytest
from support.tables import from_text

from hil_bench.abilities.modbus.binding import ModbusBinding
from hil_bench.abilities.modbus.protocol.register_map import Assignment
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.run import prepare
from hil_bench.abilities.scenario.stage import Stage
from hil_bench.abilities.scenario.verbs import scenario_run
from hil_bench.abilities.scenario.verbs.scenario_view import shown_stage
from hil_bench.bench.session import open_session
from hil_bench.cli import main
from hil_bench.cli.exit_codes import ExitCode

HEAD = 'title = "T"\nduration_s = 0.02\n'
ALONE = ["--speed", "max", "--no-feed"]
ON_A_BUS = [*ALONE, "-i", "virtual", "-c", "scenario-run"]
PASSING, FAILING = "always axis1.P_A < 250 bar", "always axis1.P_A < 1 bar"


def scenario(tmp_path, that, more=""):
    path = tmp_path / "a.scenario.toml"
    path.write_text(f"{HEAD}{more}[[expect]]\nid = \"R1\"\nthat = '{that}'\n")
    return str(path)


def run(path, *words):
    return main(["run", "--scenario", path, *words])


@pytest.mark.parametrize("words", [ALONE, ON_A_BUS], ids=["alone", "on a bus"])
@pytest.mark.parametrize(
    ("that", "code"),
    [
        (PASSING, ExitCode.DONE),
        (FAILING, ExitCode.CHECK_FAILED),
        ("whenever axis1.P_A > 250 bar then axis1.P_B > 1 bar", ExitCode.INCONCLUSIVE),
    ],
)
def test_the_verdict_is_the_exit_code(tmp_path, capsys, words, that, code):
    path = scenario(tmp_path, that)
    assert run(path, *words) == code
    lines = capsys.readouterr().out.splitlines()
    assert lines[lines.index(f"{path}: T") + 1].startswith("  R1  ")


@pytest.mark.parametrize(
    ("bench", "step"),
    [
        ("", ""),
        ("", '[[step]]\nat_s = 0.01\nnmt = "start"\ntarget = "all"\n'),
        ("[modbus]\nport = 0\n", ""),
        ("[modbus]\nport = 0\n",
         '[[step]]\nat_s = 0.01\nset = { "modbus.pressure_a.filter_type" = 1 }\n'),
    ],
)  # fmt: skip
def test_a_controller_that_never_comes_exercises_nothing(tmp_path, capsys, bench, step):
    """A step is nobody."""
    (tmp_path / "bench.toml").write_text(bench)
    more = 'bench = "bench.toml"\n[controller]\nfirmware = ["/no/such"]\n' + step
    assert run(scenario(tmp_path, PASSING, more), *ON_A_BUS) == ExitCode.INCONCLUSIVE
    said = "R1  not exercised  no controller on the bus has sent a frame or written a register"
    assert said in capsys.readouterr().out


def test_a_client_that_writes_a_register_is_somebody(tmp_path):
    (tmp_path / "bench.toml").write_text("[modbus]\n")
    prepared = prepare(load_scenario(scenario(tmp_path, PASSING, 'bench = "bench.toml"\n')), {})
    session = open_session(prepared.config)
    stage = Stage(prepared, session)
    binding = session.bench.part(ModbusBinding)
    binding.exchange(0)
    assert stage.is_silent
    binding.plan.mailbox.post([Assignment(0, 1.0)])
    binding.exchange(1_000_000)
    assert not stage.is_silent


@pytest.mark.parametrize("words", [ALONE, ON_A_BUS], ids=["alone", "on a bus"])
def test_steps_act_at_their_ticks(tmp_path, words):
    """SYNC has the identifier 0x080 (CiA 301); the step switches it on at 10 ms."""
    that = "always from 0 s to 9 ms not frame(0x080) and always after 10 ms frame(0x080)"
    path = scenario(tmp_path, that, "[[step]]\nat_s = 0.01\nsync = true\n")
    assert run(path, *words) == ExitCode.DONE


def test_verdicts_are_those_of_test(tmp_path, capsys):
    path = scenario(tmp_path, FAILING)
    run(path, *ALONE)
    alone = capsys.readouterr().out
    main(["test", path])
    assert capsys.readouterr().out == alone


@pytest.mark.parametrize("words", [ALONE, ON_A_BUS], ids=["alone", "on a bus"])
def test_a_program_reads_the_verdicts_and_nothing_else(tmp_path, capsys, words):
    path = scenario(tmp_path, FAILING)
    assert run(path, *words, "--json") == ExitCode.CHECK_FAILED
    found = json.loads(capsys.readouterr().out)["scenario"]
    assert found["path"] == path
    assert [each["judgement"]["outcome"] for each in found["findings"]] == ["failed"]
    assert run(path, *words, "-q") == ExitCode.CHECK_FAILED
    assert capsys.readouterr().out == ""


class Clock:
    """A clock that jumps to each deadline."""

    def __init__(self):
        self.time, self.deadlines = 7_000_000_000, []

    def now(self):
        return self.time

    def sleep_until(self, deadline):
        self.deadlines.append(deadline)
        self.time = max(self.time, deadline)


def test_each_tick_waits_for_its_time(tmp_path, monkeypatch):
    clock = Clock()
    monkeypatch.setattr(scenario_run, "clock_of", lambda _speed: clock)
    assert run(scenario(tmp_path, PASSING), "--no-feed", "--speed", "1") == ExitCode.DONE
    assert clock.deadlines[:21] == [7_000_000_000 + k * 1_000_000 for k in range(21)]


def test_a_late_run_says_so(tmp_path, monkeypatch, capsys):
    clock = Clock()
    monkeypatch.setattr(scenario_run, "clock_of", lambda _speed: clock)
    clock.sleep_until = lambda deadline: setattr(
        clock, "time", max(clock.time, deadline + 3 * 10**8)
    )
    run(scenario(tmp_path, PASSING), "--no-feed", "--speed", "1")
    assert "up to 0.3 s behind real time" in capsys.readouterr().out


def test_a_wish_to_stop_ends_it(tmp_path, monkeypatch, capsys):
    """Nothing is known of the rest; what has failed by then has failed."""
    clock = Clock()
    monkeypatch.setattr(scenario_run, "clock_of", lambda _speed: clock)
    wish = scenario_run.Interruption()
    clock.sleep_until = lambda _deadline: wish.request(15)
    monkeypatch.setattr(scenario_run, "interruption", lambda: contextlib.nullcontext(wish))
    words = ["--no-feed", "--speed", "1"]
    assert run(scenario(tmp_path, PASSING), *words) == ExitCode.INTERRUPTED
    out = capsys.readouterr().out
    assert "R1  inconclusive" in out
    assert out.rstrip().endswith("of 0.02 s")
    wish.requested = False
    assert run(scenario(tmp_path, FAILING), *words) == ExitCode.CHECK_FAILED


def test_a_command_to_stop_ends_it(tmp_path, monkeypatch):
    sessions = []

    def look():
        sessions[0].controls.is_over = True

    def opened(_args, _config, session, **_):
        sessions.append(session)
        return contextlib.nullcontext(look)

    monkeypatch.setattr(scenario_run, "watched_run", opened)
    assert run(scenario(tmp_path, PASSING), "--speed", "max") == ExitCode.INCONCLUSIVE


def test_those_who_watch_are_served_each_tick(tmp_path, monkeypatch):
    looks = []

    def opened(*_, **__):
        return contextlib.nullcontext(lambda: looks.append(1))

    monkeypatch.setattr(scenario_run, "watched_run", opened)
    run(scenario(tmp_path, PASSING), "--speed", "max")
    assert len(looks) >= 21


def test_a_tick_that_the_loop_leaves_out_is_unknown(tmp_path):
    prepared = prepare(load_scenario(scenario(tmp_path, PASSING)))
    session = open_session(prepared.config)
    stage = Stage(prepared, session)
    session.start()
    for tick in (0, 1, 4):
        session.tick((), tick * 1_000_000)
    (column,) = stage.witness.columns().values()
    assert [math.isnan(value) for value in column] == [False, False, True, True, False]


FIRMWARE = '[controller]\nfirmware = ["/no/such"]\n[[step]]\nat_s = 0.01\nfirmware = "kill"\n'


@from_text("words", "wrong")
def test_what_does_not_go_with_a_scenario_is_refused(tmp_path, capsys, words, wrong):
    assert run(scenario(tmp_path, PASSING, FIRMWARE), *words.split()) == ExitCode.USAGE
    assert wrong in capsys.readouterr().err


def test_a_parameter_without_a_scenario_is_refused(capsys):
    assert main(["run", "--set", "x=1", *ON_A_BUS]) == ExitCode.USAGE
    assert "--set: gives a parameter of a scenario" in capsys.readouterr().err


def test_those_who_watch_see_a_scenario_run_and_then_its_verdict(tmp_path):
    """At 21 ticks of 1 ms the run of 20 ms is over; the step at 10 ms is done after 11."""
    step = "[[step]]\nat_s = 0.01\nsync = true\n"
    prepared = prepare(load_scenario(scenario(tmp_path, FAILING, step)))
    session = open_session(prepared.config)
    stage = Stage(prepared, session)
    look = shown_stage(prepared, stage).state
    session.start()
    seen = []
    for tick in range(21):
        session.tick((), tick * 1_000_000)
        seen.append(look())
    runs, ended = seen[10], seen[-1]
    assert (runs.now, runs.verdict, runs.done, runs.total) == ("T", "", 0.0, 0.02)
    assert (ended.now, ended.verdict) == ("", "failed")
    assert [(item.name, item.verdict) for item in ended.items] == [
        ("R1", "failed"),
        ("0.010 s", "done"),
    ]
