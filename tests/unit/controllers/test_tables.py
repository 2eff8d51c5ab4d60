"""Tables of controllers: in a bench, in a scenario, on the command line and in a test."""

import json
import re

import pytest
from support.tables import from_text

from hil_bench import ConfigError, load_config
from hil_bench.abilities.scenario.judgement import RequirementOutcome
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.run import play, prepare
from hil_bench.cli import main
from hil_bench.errors import ControllerError

FILE = """
import can

def message(number):
    return can.Message(arbitration_id=number, data=[], is_extended_id=False)

def blinks(rig):
    while True:
        rig.bus.send(message(int(rig.parameters.get("id", 0x111))))
        rig.sleep(0.01)

def answers(rig):
    while True:
        if rig.bus.recv(None).arbitration_id == 0x111:
            rig.bus.send(message(0x222))
"""
BLINKS = {"kind": "python", "call": "mine.py:blinks"}
ANSWERS = {"kind": "python", "call": "mine.py:answers"}
PASSED = RequirementOutcome.PASSED


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "mine.py").write_text(FILE)
    return tmp_path


@pytest.mark.parametrize("named", ["target_mm", "id"])
def test_a_parameter_that_nobody_gives_is_a_line_that_says_who_may(folder, named):
    text = f"def asks(rig):\n    rig.parameters['{named}'] + rig.parameters['gain']\n"
    (folder / "asks.py").write_text(text)
    asks = {"kind": "python", "call": "asks.py:asks"}
    one = prepare(scenario(folder, "always axis1.P_A < 250 bar", controller=asks))
    missing = "gain" if named == "id" else named
    words = f"{missing}: give it in [parameters] of a scenario; there is id"
    with pytest.raises(ControllerError, match=re.escape(words)) as error:
        play(one)
    assert "asks.py:2: " in str(error.value)


def toml(table):
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in table.items())


def bench_file(folder, **controllers):
    text = "".join(f"[controllers.{name}]\n{toml(each)}" for name, each in controllers.items())
    (folder / "bench.toml").write_text(text)
    return folder / "bench.toml"


def scenario(folder, *wanted, controller=None, steps="", bench=""):
    text = f'title = "T"\nduration_s = 0.1\n{bench}\n[parameters]\nid = 321\n'
    text += f"[controller]\n{toml(controller)}" if controller else ""
    text += steps
    text += "".join(
        f'[[expect]]\nid = "R{number}"\nthat = "{that}"\n' for number, that in enumerate(wanted)
    )
    (folder / "a.scenario.toml").write_text(text)
    return load_scenario(folder / "a.scenario.toml")


def outcomes(found):
    return [each.judgement.outcome for each in play(prepare(found)).findings]


def step(at, **keys):
    return f"[[step]]\nat_s = {at}\n{toml(keys)}"


def test_a_controller_of_a_scenario_has_its_parameters(folder):
    found = scenario(folder, "eventually from 1 ms to 1 ms frame(0x141)", controller=BLINKS)
    assert outcomes(found) == [PASSED]  # 0x141 is 321


def test_controllers_of_the_bench_hear_each_other_and_are_switched_by_name(folder):
    bench_file(folder, lamp=BLINKS, eye=ANSWERS)
    wanted = (
        "eventually from 2 ms to 2 ms frame(0x222)",  # hears the frame of 1 ms at its end
        "always from 51 ms to 100 ms not frame(0x111)",
        "eventually from 76 ms to 76 ms frame(0x111)",
    )
    steps = step(0.05, firmware="kill", target="lamp")
    bench, unused = 'bench = "bench.toml"', "[parameters]\nid = 321\n"
    text = scenario(folder, *wanted[:2], steps=steps, bench=bench).path.read_text()
    (folder / "a.scenario.toml").write_text(text.replace(unused, ""))
    assert outcomes(load_scenario(folder / "a.scenario.toml")) == [PASSED, PASSED]
    again = text.replace(unused, "").replace("51 ms to 100 ms", "51 ms to 75 ms")
    again += step(0.075, firmware="start", target="lamp")
    again += f'[[expect]]\nid = "R3"\nthat = "{wanted[2]}"\n'
    (folder / "a.scenario.toml").write_text(again)
    assert outcomes(load_scenario(folder / "a.scenario.toml")) == [PASSED] * 3


@from_text("steps", "words")
def test_a_switch_of_nothing_is_refused(folder, steps, words):
    bench_file(folder, lamp=BLINKS, eye=ANSWERS)
    found = scenario(
        folder, "always axis1.P_A > id * 1 bar", steps=f"{steps}\n", bench='bench = "bench.toml"'
    )
    with pytest.raises(ConfigError) as error:
        prepare(found)
    assert any(line.endswith(words) for line in str(error.value).splitlines())


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({}, ":controllers.x.kind: missing; give for example kind = "),
        (
            {"kind": "pythons"},
            ':controllers.x.kind: "pythons" is no kind of controller; the nearest is',
        ),
        ({"kind": "python"}, ":controllers.x.call: missing; give for example call = "),
        ({**BLINKS, "cal": 1}, ":controllers.x.cal: unknown key; the nearest known key is call"),
        ({**BLINKS, "buses": "bus"}, ':controllers.x.buses: "bus" is not a list of texts'),
        (
            {**BLINKS, "buses": ["b"]},
            ':controllers.x.buses: "b" is no bus of the bench; the nearest',
        ),
        ({**BLINKS, "call": "mine.py:f"}, ":controllers.x.call: mine.py: f is not there"),
    ],
)
def test_a_table_that_makes_no_controller_gets_one_line(folder, table, words):
    with pytest.raises(ConfigError) as error:
        load_config(bench_file(folder, x=table))
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_the_name_of_a_scenarios_controller_is_taken(folder):
    with pytest.raises(ConfigError, match="is the controller of a scenario; give another name"):
        load_config(bench_file(folder, controller=BLINKS))


def test_run_takes_controllers_from_the_command_line(folder, monkeypatch, capfd):
    monkeypatch.chdir(folder)
    words = ["run", "--hub", "0", "--speed", "max", "--duration", "0.1"]
    answers = ["--controller", "python", "call=mine.py:answers"]
    code = main([*words, "--controller", "python", "call=mine.py:blinks", *answers])
    shown = capfd.readouterr().out
    assert code == 0
    assert "drive  python: python on bus\ndrive  python2: python on bus\n" in shown
    # Four boot-ups; ten blinks from 1 ms on, each with an answer, the last one beyond the end.
    assert "24 sent" in shown


@pytest.mark.parametrize("words", [["call=mine.py:blinks"], ["python", "mine.py:blinks"]])
def test_words_that_are_no_controller_are_refused(words, capfd):
    assert main(["run", "--hub", "0", "--duration", "0.1", "--controller", *words]) == 2
    assert "is no controller; give KIND [KEY=VALUE ...]" in capfd.readouterr().err
