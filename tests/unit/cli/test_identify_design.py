"""`hil-bench identify --design`: the scenario that it writes, and what it refuses."""

import json

import numpy as np
import pytest

from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.run import play, prepare
from hil_bench.cli import main

# A coarse step, which makes this quick.
BENCH = """
[bench]
tick_us = 2000
step_us = 500

[nodes]
valve = { profile = "valve_408", node_id = 1 }
[nodes.pressure_a]
profile = "pressure_404"
node_id = 2
source = "P_A"
chain.noise_rms_bar = 0.04

[nodes.pressure_b]
profile = "pressure_404"
node_id = 3
source = "P_B"

[nodes.position]
profile = "encoder_406"
node_id = 4
chain.noise_rms_um = 3.0
"""
PLAN = """[plan]
period_ms = 2
[limits]
position_mm = [-60, 60]
speed_mm_s = 200
pressure_bar = [-1, 120]
[communication]
"""


@pytest.fixture
def bench(make_file):
    return make_file("bench.toml", BENCH)


@pytest.fixture
def plan(make_file):
    return make_file("plan.toml", PLAN)


@pytest.mark.long
def test_the_run_is_a_scenario_that_the_bench_plays_within_the_limits(bench, plan, tmp_path, cli):
    words = ["--plan", plan, "--output", tmp_path / "out", "--duration", 30, "--json"]

    found = json.loads(cli(["identify", "--design", *map(str, (bench, *words))]).out)
    path = tmp_path / "out" / "design.scenario.toml"
    assert str(path) in found["files"]
    scenario = load_scenario(path)
    assert scenario.bench == "../bench.toml"
    result = play(prepare(scenario))
    # The machine is the twin here, so that all limits hold.
    assert [each.judgement.outcome for each in result.findings] == ["passed"] * 4
    assert {each.requirement.id for each in result.findings} == {
        "position",
        "speed",
        "pressure A",
        "pressure B",
    }
    assert len(found["design"]["openings"]) == 3
    times = np.loadtxt(path.parent / "design.csv", delimiter=",", skiprows=1)[:, 0]
    assert 3.0 < times[-1] < 31.0


def refusal(capsys, *arguments):
    assert main(["identify", *map(str, arguments)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_options_of_a_design_without_one_are_refused(bench, plan, capsys):
    assert "--plan: belongs to --design" in refusal(capsys, "x.csv", bench, "--plan", plan)
    assert "--duration: belongs to --design" in refusal(capsys, "x.csv", bench, "--duration", 9)


@pytest.mark.parametrize("duration", ["0", "1", "nan", "1e9"])
def test_a_senseless_duration_is_refused(bench, duration, capsys):
    assert "give 2 to 600" in refusal(capsys, "--design", bench, "--duration", duration)


def test_without_a_design_a_recording_is_needed(capsys):
    assert "give .csv, .mf4 or .mat" in refusal(capsys)


def test_a_design_takes_no_recording(bench, capsys):
    assert "--design takes a bench.toml" in refusal(capsys, "--design", "run.csv", bench)


def test_an_axis_without_its_devices_is_refused(tmp_path, make_file, capsys):
    path = make_file("bare.toml", '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n')

    assert "axis1: no node is its encoder_406" in refusal(
        capsys, "--design", path, "--output", tmp_path / "o"
    )
