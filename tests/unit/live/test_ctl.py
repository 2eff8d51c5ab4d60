"""`hil-bench ctl`: a running bench from the shell."""

import contextlib
import json
from types import SimpleNamespace

import pytest
from support.feed_loop import FeedLoop
from support.tables import from_text

from hil_bench import BusError, Faults
from hil_bench.abilities.live import ctl
from hil_bench.cli import main
from hil_bench.cli.exit_codes import ExitCode


@pytest.fixture
def loop(monkeypatch):
    loop = FeedLoop()
    monkeypatch.setattr(ctl, "connect", loop.connect)
    monkeypatch.setattr(ctl, "find_names", lambda: ["bench"])
    return loop


@pytest.fixture
def ask(loop, capsys):
    """Return what a command prints as JSON; the bench is then one look further."""

    def run(*words):
        assert main(["ctl", *words, "--json"]) == 0
        loop.look_again()
        return json.loads(capsys.readouterr().out)

    return run


def active(loop):
    return [(str(fault.kind), fault.target) for fault in loop.session.bench.part(Faults).active]


def test_the_benches_are_listed(ask, monkeypatch, cli):
    (bench,) = ask("list")["benches"]
    assert (bench["name"], bench["bench"]) == ("bench", "built-in bench")

    def lost(name):
        raise BusError(f"bench {name}: gone")

    monkeypatch.setattr(ctl, "connect", lost)
    assert cli("ctl list").out == "bench  bench  bench bench: gone\n"
    monkeypatch.setattr(ctl, "find_names", list)
    assert cli("ctl list").out.startswith("no bench runs (looked in ")


def test_the_status_has_units_for_people_and_si_for_programs(ask, loop, cli):
    loop.session.bench.part(Faults).freeze("position", duration=1.0)
    loop.look_again()
    status = ask("status")
    values = status["values"]
    # Table I of the paper: a supply of 100 bar, which both chambers share at rest.
    assert values["axis1.P_A"] + values["axis1.P_B"] == pytest.approx(100e5)
    lines = cli("ctl status").out.splitlines()
    assert any(line.split() == ["node", "position", "PRE-OPERATIONAL"] for line in lines)
    shown = next(line.split() for line in lines if "axis1.P_A" in line)
    assert float(shown[2]) == pytest.approx(values["axis1.P_A"] / 1e5, abs=0.05)
    assert shown[3] == "bar"
    assert any("freeze position since 0.001 s, until 1.001 s" in line for line in lines)


def test_the_status_of_work_that_is_over_has_its_findings():
    items = [
        {"name": "R1", "verdict": "inconclusive", "text": "nothing seen after 1 s; seen 1 of 6 s"},
        {"name": "0.5 s", "verdict": "done", "text": "set valve.spool_setpoint = 0.4"},
        {"name": "R2", "verdict": "passed", "text": ""},
        {"name": "2 s", "verdict": "", "text": "SYNC on"},
    ]
    work = {"done": 2, "total": 3, "now": "", "verdict": "inconclusive", "items": items}
    assert list(ctl._work_lines(work)) == [
        "work   2 of 3  inconclusive",
        "       R1 inconclusive: nothing seen after 1 s; seen 1 of 6 s",
    ]
    assert list(ctl._work_lines({**work, "now": "T", "total": 0})) == ["work   T"]


def test_a_fault_has_the_keys_of_the_configuration(ask, loop):
    number = ask("fault", "offset", "pressure_a", "offset_bar=20", "for_s=5")["number"]
    (fault,) = loop.session.bench.part(Faults).active
    assert (str(fault.kind), fault.target, fault.duration) == ("offset", "pressure_a", 5 * 10**9)
    sensor = loop.session.bench.sensors[0]
    assert sensor.measured - loop.session.bench.axes[0].plant.output.P_A == pytest.approx(20e5)
    ask("clear", str(number))
    assert active(loop) == []


@from_text("words", "text")
def test_a_wrong_fault_is_one_line(loop, cli, words, text):
    (line,) = cli(["ctl", "fault", *words.split()], 2).err.splitlines()
    assert text in line
    assert active(loop) == []


def test_faults_are_cleared_by_number_kind_or_target(ask, loop, cli):
    for words in (
        ["freeze", "position"],
        ["freeze", "pressure_a"],
        ["offset", "pressure_b", "offset_bar=1"],
    ):
        ask("fault", *words)
    assert ask("clear", "pressure_a")["cleared"] == [2]
    assert ask("clear", "freeze", "3")["cleared"] == [1, 3]
    assert active(loop) == []
    assert "clear freeze: there is no such fault; active: none" in cli("ctl clear freeze", 2).err
    ask("fault", "freeze", "position")
    assert ask("clear")["cleared"] is None
    assert active(loop) == []


def test_loads_are_set_in_their_units(ask, loop):
    set_now = {}
    plant = loop.session.bench.axes[0].plant
    plant.influence = set_now.__setitem__
    ask("set", "axis1.load_n=5000", "axis1.supply_pressure_bar=80")
    assert set_now == {"load": 5000.0, "supply_pressure": pytest.approx(80e5)}
    ask("set", "axis1.supply_pressure_mpa=7")
    assert set_now["supply_pressure"] == pytest.approx(7e6)


def test_objects_are_set_and_read(ask, loop):
    ask("set", "valve.0x1017=500")
    assert loop.session.nodes["valve"]["0x1017"] == 500
    assert ask("get", "valve.0x1017", "valve.0x1008")["values"] == {
        "valve.0x1017": 500,
        "valve.0x1008": loop.session.nodes["valve"]["0x1008"],
    }


def test_a_number_that_is_read_has_its_unit_or_is_said_to_be_raw(ask, cli):
    """An EDS has no units; a signal of a J1939 device has one."""
    ask("set", "valve.0x1017=500")
    assert cli("ctl get valve.0x1017").out == "valve.0x1017 = 500 (raw)\n"
    signals = {"x": {"unit": "%"}, "n": {"unit": "-"}}
    hello = {"ecus": {"joystick": {"signals": signals}}}
    texts = [ctl._unit_text(f"joystick.{name}", 5.0, hello) for name in signals]
    assert texts == ["%", ""]
    assert ctl._unit_text("valve.0x1008", "name", hello) == ""


@from_text("words", "text")
@pytest.mark.usefixtures("loop")
def test_a_wrong_word_is_one_line(cli, words, text):
    (line,) = cli(["ctl", *words.split()], 2).err.splitlines()
    assert text in line


def test_nothing_is_set_where_a_word_is_wrong(loop, capsys):
    before = loop.session.nodes["valve"]["0x1017"]
    assert main(["ctl", "set", "valve.0x1017=777", "axis1.load=5"]) == 2
    assert loop.session.nodes["valve"]["0x1017"] == before
    assert "cannot be set" in capsys.readouterr().err


def test_what_acted_before_a_setting_that_the_bench_refuses_is_said(loop, capsys):
    """0x1018 is the identity, which nobody may write; the words behind it are not asked for."""
    words = ["axis1.load_n=5000", "valve.0x1017=777", "valve.0x1018.01=1", "valve.0x1017=778"]
    assert main(["ctl", "set", *words]) != 0
    assert loop.session.nodes["valve"]["0x1017"] == 777
    assert capsys.readouterr().out.splitlines() == words[:2]


def test_a_bench_whose_time_stands_still_is_said(loop, capsys, cli):
    loop.session.door.close()
    assert main(["ctl", "fault", "freeze", "position"]) == 3
    assert "the bench has ended; it takes no more commands" in capsys.readouterr().err
    loop.tick = lambda: None
    assert "no answer in 1 s; its time stands still" in cli("ctl fault freeze position", 3).err


def test_no_bench_is_said(monkeypatch, tmp_path, cli):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert cli("ctl status", 3).err == (
        "hil-bench: error: no bench runs; start one with hil-bench run "
        f"(looked in {tmp_path}/hil-bench)\n"
    )
    (tmp_path / "hil-bench").mkdir(mode=0o755)
    assert cli("ctl --bench x status", 3).err == (
        f'hil-bench: error: no bench with the name "x" runs ({tmp_path}/hil-bench: must be a '
        "folder that only its owner may enter (0700))\n"
    )


@pytest.mark.parametrize(
    "words",
    [
        ["--bench", "bench", "--json", "status"],
        ["--bench", "bench", "status", "--json"],
        ["status", "--bench", "bench", "--json"],
        ["--bench", "other", "--json", "status", "--bench", "bench"],
    ],
)
def test_the_bench_may_be_named_before_the_action_and_after_it(loop, monkeypatch, capsys, words):
    names = []

    def connect(name):
        names.append(name)
        return loop.connect(name)

    monkeypatch.setattr(ctl, "connect", connect)
    assert main(["ctl", *words]) == 0
    assert names == ["bench"]
    assert json.loads(capsys.readouterr().out)["name"] == "bench"


def test_a_recording_that_is_not_complete_is_lost_output(monkeypatch, cli):
    found = {"path": "r.mf4", "rows": 3, "frames": None, "end": 0.1, "problem": "", "lost": 2}
    client = SimpleNamespace(request=lambda _action: found)
    monkeypatch.setattr(ctl, "connect", lambda _name: contextlib.nullcontext(client))
    said = cli("ctl record --stop", ExitCode.LOST)
    assert said.out == "r.mf4: 3 rows, until 0.100 s\n"
    assert said.err == "hil-bench: error: 2 messages left out\n"
