"""Runs of scenarios whose controller is a program in lock-step: started, killed, dead by itself.

The programs are small scripts that speak the socketcand protocol over a bare socket.
"""

import json
import sys

import pytest
from support.bus_programs import JOIN

from hil_bench.abilities.scenario.judgement import RequirementOutcome
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.run import play, prepare
from hil_bench.errors import ConfigError, ControllerError

PROGRAM = (
    JOIN
    + """
say(f"< send {sys.argv[1]} 1 0 >")
for _ in range(int(sys.argv[2])):
    sync()
sys.exit(int(sys.argv[3]))
"""
)
PASSED = RequirementOutcome.PASSED


def load(tmp_path, words, steps, *wanted):
    """Return a scenario of 100 ms with the program as its controller."""
    (tmp_path / "program.py").write_text(PROGRAM)
    command = json.dumps([sys.executable, str(tmp_path / "program.py"), *words])
    text = 'title = "T"\nduration_s = 0.1\n[parameters]\nid = 321\n'
    text += f"[controller]\nfirmware = {command}\n"
    text += "".join(f'[[step]]\nat_s = {at}\nfirmware = "{what}"\n' for at, what in steps)
    text += "".join(
        f"[[expect]]\nid = \"R{k}\"\nthat = '{that}'\n" for k, that in enumerate(wanted)
    )
    (tmp_path / "a.scenario.toml").write_text(text)
    return load_scenario(tmp_path / "a.scenario.toml")


def outcomes(scenario):
    return [each.judgement.outcome for each in play(prepare(scenario)).findings]


def test_the_firmwares_sync_is_the_scenarios_time(tmp_path):
    """The name of a parameter in the command line is its value: 321."""
    wanted = (
        "eventually from 1 ms to 1 ms frame(0x321)",
        "always after 1 ms frame(0x080)",
        "always after 2 ms not frame(0x321)",
    )
    found = play(prepare(load(tmp_path, ["{id}", "200", "0"], [], *wanted)))
    assert [each.judgement.outcome for each in found.findings] == [PASSED] * 3
    assert found.duration == pytest.approx(0.1)
    assert not found.is_early


def test_time_goes_on_without_killed_firmware_until_it_is_started_again(tmp_path):
    wanted = (
        "always from 1 ms to 50 ms frame(0x080)",
        "always from 51 ms to 80 ms not frame(0x080)",
        "always from 82 ms to 100 ms frame(0x080)",
    )
    steps = [(0.05, "kill"), (0.08, "start")]
    assert outcomes(load(tmp_path, ["{id}", "200", "0"], steps, *wanted)) == [PASSED] * 3


def test_firmware_may_be_started_later(tmp_path):
    wanted = ("always from 0 s to 50 ms not frame(0x080)", "always after 52 ms frame(0x080)")
    assert (
        outcomes(load(tmp_path, ["{id}", "200", "0"], [(0.05, "start")], *wanted)) == [PASSED] * 2
    )


def test_firmware_that_dies_ends_the_run(tmp_path):
    with pytest.raises(ControllerError, match="exit code 7"):
        play(prepare(load(tmp_path, ["{id}", "5", "7"], [], "always axis1.P_A < 250 bar")))


def test_firmware_that_is_not_there_is_one_line(tmp_path):
    scenario = load(tmp_path, ["{id}"], [], "always axis1.P_A < 250 bar")
    text = scenario.path.read_text().replace(sys.executable, "/nowhere/firmware")
    scenario.path.write_text(text)
    with pytest.raises(ControllerError, match="/nowhere/firmware: cannot be started: "):
        play(prepare(load_scenario(scenario.path)))


def test_the_sync_of_firmware_cannot_be_switched(tmp_path):
    scenario = load(tmp_path, ["{id}", "5", "7"], [], "always axis1.P_A < 250 bar")
    scenario.path.write_text(scenario.path.read_text() + "[[step]]\nat_s = 0\nsync = false\n")
    with pytest.raises(ConfigError, match="lets bench time pass, so it cannot be switched"):
        prepare(load_scenario(scenario.path))
