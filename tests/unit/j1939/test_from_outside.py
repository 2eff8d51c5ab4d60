"""J1939 devices of a running bench: `ctl`, `attach`, the feed, recordings, the page's faults."""

import csv
import json
from pathlib import Path

import pytest
from support.feed_loop import FeedLoop
from support.tables import from_text

import hil_bench
from hil_bench import ConfigError, VirtualBench, load_config
from hil_bench.abilities.live import attached, ctl
from hil_bench.abilities.live.view import hello_of
from hil_bench.abilities.panel.bench_link import fault_choices
from hil_bench.abilities.scenario.records import SetStep
from hil_bench.abilities.scenario.writing import JournalSteps
from hil_bench.cli import main
from hil_bench.cli.paced_run import node_lines

BENCH = Path(__file__).parents[3] / "examples" / "j1939_lever.toml"


@pytest.fixture
def loop(monkeypatch):
    loop = FeedLoop(load_config(BENCH))
    monkeypatch.setattr(ctl, "connect", loop.connect)
    monkeypatch.setattr(attached, "connect", loop.connect)
    return loop


def run(*words):
    return main(["ctl", *words])


def test_ctl_moves_the_lever_breaks_it_and_shows_it(loop, capsys):
    assert run("set", "joystick.x=40") == 0
    assert run("get", "joystick.x", "joystick.x_right") == 0
    assert run("fault", "indicate", "joystick.x", "shows=error") == 0
    loop.tick(5)
    loop.look_again()
    assert run("status") == 0

    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["joystick.x", "=", "40.0", "%"] in lines
    assert ["joystick.x_right", "=", "1.0"] in lines
    claimed = ["claimed,", "address", "19,", "SPN", "2660", "FMI", "2"]
    assert ["J1939", "joystick", *claimed] in lines


@pytest.mark.usefixtures("loop")
@from_text("word", "message")
def test_what_cannot_be_set_is_one_line(word, message, capsys):
    assert run("set", word) == 2

    (line,) = capsys.readouterr().err.splitlines()
    assert message in line


def test_a_script_attaches(loop):
    with hil_bench.attach() as bench:
        bench.ecus["joystick"]["x"] = -25
        with bench.faults.report("valve", spn=100, fmi=3):
            loop.tick(5)
            loop.look_again()
            ecus = bench.status()["state"]["ecus"]
        assert bench.ecus["joystick"]["x"] == -25.0
        with pytest.raises(ConfigError, match='no signal "y"'):
            bench.ecus["joystick"]["y"] = 1
    assert ecus["valve"] == {"state": "claimed", "address": 10, "codes": [[100, 3]]}
    assert ecus["joystick"]["codes"] == []


def test_what_is_set_by_hand_becomes_a_step_in_si(loop):
    bench = hil_bench.attach()
    bench.ecus["joystick"]["x"] = 40
    hello = hello_of("bench", load_config(BENCH), loop.session)
    maker = JournalSteps(hello, 0.0, 10.0)
    maker.add(bench.journal())

    (step,) = maker.steps
    assert isinstance(step, SetStep)
    assert (step.target, step.value) == ("joystick.x", pytest.approx(0.4))


def test_the_page_offers_the_faults_of_such_devices():
    with VirtualBench(load_config(BENCH)) as bench:
        choices = fault_choices(hello_of("bench", bench.config, bench.session))

    assert list(choices["indicate"]) == ["joystick.x", "joystick.x_left", "joystick.x_right"]
    assert list(choices["report"]) == list(choices["readdress"]) == ["valve", "joystick"]
    assert list(choices["silence"]) == ["valve", "joystick"]
    assert not choices["bus_off"]  # this bus takes no time
    offset = {target: [key["name"] for key in keys] for target, keys in choices["offset"].items()}
    assert offset["joystick.x"] == ["offset_percent", "for_s"]


def test_their_signals_are_recorded_in_si(tmp_path):
    path = tmp_path / "run.csv"
    with VirtualBench(load_config(BENCH), record=path) as bench:
        bench.ecus["joystick"]["x"] = 40
        bench.run(0.1)
    rows = list(
        csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#"))
    )

    (name,) = (each for each in rows[-1] if each.startswith("joystick.x.measured"))
    assert float(rows[-1][name]) == pytest.approx(0.4)
    assert any(each.startswith("valve.flow.measured") for each in rows[-1])


def test_the_hello_has_what_each_can_be_asked(loop):
    hello = json.loads(json.dumps(hello_of("bench", load_config(BENCH), loop.session)))

    assert hello["ecus"]["joystick"]["signals"]["x"] == {"unit": "%", "is_settable": True}
    assert hello["ecus"]["valve"]["axis"] == "axis1"
    assert hello["nodes"] == []


def test_the_summary_of_a_run_has_a_line_each():
    with VirtualBench(load_config(BENCH)) as bench:
        bench.run(0.1)
        with bench.faults.report("valve", spn=100, fmi=3):
            bench.run(0.01)
            lines = node_lines(bench.config, bench.bench)

    assert lines == [
        "J1939     valve: claimed, address 10, SPN 100 FMI 3",
        "J1939     joystick: claimed, address 19",
    ]
