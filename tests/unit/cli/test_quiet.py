"""-q: no verb prints anything but errors, and what was asked for a program all the same."""

from pathlib import Path

import pytest

from hil_bench.cli import main

EDS = str(Path(__file__).parents[3] / "device_profiles" / "valve_408.eds")
SCENARIO = str(Path(__file__).parents[3] / "examples" / "scenarios" / "settling.scenario.toml")

LOOK_UPS = {
    "analyse": ["analyse", "linearisation"],
    "bus-load": ["bus-load", "-b", "1000000", "--simulate", "1"],
    "check": ["check"],
    "check-eds": ["check-eds", EDS],
    "ctl": ["ctl", "list"],
    "decode": ["decode", "bus.log"],
    "devices": ["devices"],
    "doctor": ["doctor", "--seconds", "0"],
    "new": ["new", "--catalogue"],
    "plot": ["plot", "bus.log"],
    "registers": ["registers"],
    "scan": ["scan", "--virtual", "--patience", "0.1"],
    "scenario": ["scenario", "check", SCENARIO],
}
FOR_PROGRAMS = [
    ["completion", "bash"],
    ["devices", "--json"],
    ["registers", "--csv"],
    ["scenario", "schema"],
]


@pytest.fixture(autouse=True)
def log(tmp_path, monkeypatch):
    """Work in a folder that holds a log."""
    (tmp_path / "bus.log").write_text("(0.1) can0 181#0102\n(0.2) can0 080#\n")
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("verb", LOOK_UPS)
def test_a_quiet_verb_prints_nothing(verb, capfd):
    aloud = main(LOOK_UPS[verb])
    said = capfd.readouterr().out

    quiet = main([*LOOK_UPS[verb], "-q"])

    assert capfd.readouterr() == ("", "")
    assert quiet == aloud == 0
    assert said or verb == "scenario"


@pytest.mark.parametrize("words", FOR_PROGRAMS, ids=" ".join)
def test_what_is_for_a_program_is_printed_all_the_same(words, cli):
    said = cli(words).out

    assert cli([*words, "-q"]).out == said != ""


def test_an_error_is_told(cli):
    assert "no.toml" in cli("devices no.toml -q", 2).err
