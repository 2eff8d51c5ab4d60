"""The worked machines: by hand within 1 %, and scenarios that pass and can fail."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.run import PlayOptions, play, prepare
from hil_bench.bench.configuration import load_config
from hil_bench.bench.configuration.plausibility import find_doubts
from hil_bench.cli import main
from hil_bench.cli.check import facts_of
from hil_bench.cli.exit_codes import ExitCode

MACHINES = Path(__file__).parents[2] / "examples" / "machines"

# docs/machines.md, worked out with a pocket calculator from the data in the files
BY_HAND = {
    "press": {
        "eigenfrequency, mid-stroke": 35.3,
        "largest push": 65.46,
        "pressure A at rest": 78.9,
        "top speed retracting": 296.5,
        "moving mass": 305.7,
    },
    "servo": {
        "eigenfrequency, mid-stroke": 75.1,
        "largest push": 72.16,
        "pressure A at rest": 105.0,
        "top speed extending": 334.7,
        "moving mass": 262.4,
    },
    "boom": {
        "eigenfrequency, mid-stroke": 5.75,
        "largest push": 164.9,
        "pressure A at rest": 49.94,
        "pressure A retracting": 83.7,
        "pressure B retracting": 69.8,
        "top speed extending": 127.3,
        "top speed retracting": 127.3,
        "speed in the cushion extending": 54.0,
        "moving mass": 16027.0,
    },
    "drum": {
        "eigenfrequency": 16.78,
        "stall torque": 93.58,
        "damping ratio": 0.207,
        "top speed forwards": 2834.0,
        "moving inertia": 0.053,
    },
}
VARIANTS = {
    "press": ("sag_bar=120", "PR-1"),
    "servo": ("band_percent=12", "SV-1"),
    "boom": ("leak_l_min_bar=0.1", "BO-1"),
    "drum": ("leak_l_min_bar=0.1", "DR-2"),
    "crane": ("jib_share=1.0", "CR-1"),
    "tail_lift": ("blocked_percent=95", "TL-4"),
}


def facts(name):
    config = load_config(MACHINES / f"{name}.toml")
    return {fact.name.strip(): fact.value for fact in facts_of(config, config.axes[0])}


@pytest.mark.parametrize("name", BY_HAND)
def test_the_summary_is_what_is_worked_out_by_hand(name):
    found = facts(name)
    assert {key: found[key] for key in BY_HAND[name]} == pytest.approx(BY_HAND[name], rel=0.01)


@pytest.mark.parametrize("name", BY_HAND)
def test_nothing_of_a_machine_is_doubted(name):
    assert find_doubts(load_config(MACHINES / f"{name}.toml")) == []


def test_the_damping_of_the_servo_axis_is_the_closed_form_of_a_symmetric_cylinder():
    """D = (sigma / m + 2 C_L E / V) / (2 omega), to first order in D."""
    axis = load_config(MACHINES / "servo.toml").axes[0]
    p = axis.parameters
    mass = p.m + 250.0
    omega = math.sqrt(2.0 * p.E * p.A_A**2 / p.V_A0 / mass)
    expected = (p.sigma / mass + 2.0 * p.C_L * p.E / p.V_A0) / (2.0 * omega)
    assert facts("servo")["damping ratio there"] == pytest.approx(expected, rel=1e-3)


def test_a_load_that_runs_ahead_of_a_small_pump_cavitates():
    """Floor A_A + F - f(v) = v² A_B³ / K²: the edge that drains holds the press' ram."""
    axis = load_config(MACHINES / "press.toml").axes[0]
    p = axis.parameters
    found = facts("press")
    speed = found["top speed extending"] * 1e-3
    force = -101325.0 * p.A_A + 300.0 * 9.80665
    held = speed**2 * p.A_B**3 / (p.K * p.alpha) ** 2
    assert force - p.F_c - p.sigma * speed == pytest.approx(held, rel=1e-3)
    assert found["pressure A extending"] == pytest.approx(-1.01325)


@pytest.mark.long  # five seconds of bench time
def test_the_boom_of_the_crane_gets_what_the_jib_leaves():
    """docs/machines.md: 74.5 l/min less 40 l/min of the jib and 0.7 l/min that the pump leaks."""
    scenario = load_scenario(MACHINES / "crane.scenario.toml")
    options = PlayOptions(keeps_evidence=True)
    signals = play(prepare(scenario, {"jib_share": 1.0}), options).evidence.signals
    at = int(np.searchsorted(signals["time"], 4.1))
    leaked = 0.012 * signals["boom.P_S"][at] * 1e-5
    left = 45e-3 * 1800 * 0.92 - 40.0 - leaked
    assert signals["jib.Q_S"][at] * 6e4 == pytest.approx(40.0, rel=1e-3)
    assert signals["boom.Q_S"][at] * 6e4 == pytest.approx(left, rel=5e-3)
    assert leaked == pytest.approx(0.72, abs=0.01)


@pytest.mark.long  # a minute of bench time
def test_the_cold_oil_of_the_tail_lift_warms_as_by_hand():
    """docs/machines.md, worked out with a pocket calculator."""
    scenario = load_scenario(MACHINES / "tail_lift.scenario.toml")
    signals = play(prepare(scenario), PlayOptions(keeps_evidence=True)).evidence.signals
    time, warm = signals["time"], signals["lift.T_oil"]
    for temperature, rate in ((-5.0, 0.341), (6.6, 0.300)):
        at = int(np.searchsorted(warm, temperature))
        found = (warm[at + 500] - warm[at - 500]) / (time[at + 500] - time[at - 500])
        assert found == pytest.approx(rate, rel=0.01)
    at = int(np.searchsorted(time, 63.0))
    assert signals["lift.filter_drop"][at] == pytest.approx(1.92e5, rel=0.01)


@pytest.mark.long  # ten seconds of bench time for each machine
@pytest.mark.parametrize("name", VARIANTS)
def test_a_scenario_passes_and_its_variant_fails(name, capsys):
    path = str(MACHINES / f"{name}.scenario.toml")
    assert main(["test", path]) == ExitCode.DONE, capsys.readouterr().out
    capsys.readouterr()
    given, found_out = VARIANTS[name]
    assert main(["test", path, "--set", given, "--json"]) == ExitCode.CHECK_FAILED
    (result,) = json.loads(capsys.readouterr().out).values()
    outcomes = {each["id"]: each["judgement"]["outcome"] for each in result["findings"]}
    assert outcomes[found_out] == "failed"
