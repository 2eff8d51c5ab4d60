"""The bench.toml of an identified machine: `check`, `run` and `test` take it as it is."""

import tomllib
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest
from support.built_in_nodes import NODES
from support.machine_record import FULL_OPENING, Machine

from hil_bench.abilities.identification.bench_file import _toml, _without_table, write_bench
from hil_bench.abilities.identification.fit import Bench, Fit
from hil_bench.abilities.identification.identify import Estimate, Identification
from hil_bench.abilities.identification.ladder import PAPER, STEADY, SWIFT, Ladder, Rung
from hil_bench.abilities.identification.machine import DROOP, GAS, PUMP, Template
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.strokes import make_course
from hil_bench.bench.configuration import load_config
from hil_bench.cli import main
from hil_bench.cli.exit_codes import ExitCode

if TYPE_CHECKING:
    from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig

DATA_SHEET = """
[plant.axis1]
bore_mm = 50.0
rod_mm = 28.0
stroke_mm = 400.0
rated_flow_l_min = 40.0
rated_pressure_drop_bar = 70.0
frequency_90deg_hz = 60.0
overlap_percent = 5.0
oil = "HLP 46"
supply_pressure_bar = 100.0
moving_mass_kg = 60.0
"""
SCENARIO = """
title = "Moves"
duration_s = 0.8
bench = "found.toml"

[controller]
example = "position_control"

[parameters]
target_mm = 20.0

[[expect]]
id = "R1"
that = "always from 0.7 s to 0.8 s abs(axis1.position - target_mm) < 3 mm"
"""


def found_by(path):
    """Return the bench.toml of a machine whose every unknown has moved a little."""
    config = load_config(path)
    axis = cast("CylinderConfig", config.first_axis)
    settings = {one.key.name: one for one in config.settings if one.table == "plant.axis1"}
    openings = [part for sign in (1.0, -1.0) for part in (np.zeros(50), np.full(80, 0.5 * sign))]
    setpoints = FULL_OPENING * np.concatenate([*openings, np.zeros(50)])
    recording = Machine(tick=1e-2, step=5e-4).record(setpoints)
    record = AxisRecord.of(recording, "axis1", FULL_OPENING, "run.csv")
    bench = Bench(Template(axis, settings, 1), make_course(record, 1e-2), 1e-3)
    names = [*PAPER, *STEADY, *SWIFT, DROOP, PUMP, GAS]
    unknowns, begin = bench.template.begin(list(dict.fromkeys(names)), {})
    variables = begin + 0.01 * np.array([one.spread for one in unknowns])
    fit = Fit(tuple(unknowns), variables, 1.0, is_whole=True)
    estimates = tuple(
        Estimate(name, value, 0.1, (value, value), value, is_told=True)
        for name, value in fit.values.items()
    )
    ladder = Ladder(bench, (Rung("", fit, np.array([]), ()),), 0, True, ())
    found = Identification(
        bench=bench, ladder=ladder, fit=fit, estimates=estimates, is_refined=True
    )
    return write_bench(found, config, "run.csv", ())


def test_all_tables_but_that_of_the_axis_and_what_is_below_it_stay():
    ours = ["[plant.axis1]", "bore_mm = 50", "[ plant . 'axis1'.load ]", "n = 3"]
    others = [
        ["# by hand", "[bench]", "tick_us = 1000"],
        ["[plant.axis10]  # another", "bore_mm = 60"],
        ["[[faults.axis1]]", "[plant]", "[nodes.axis1]", "node_id = 3"],
    ]
    text = "\n".join([*others[0], *ours[:2], *others[1], *ours[2:], *others[2], *ours[:2]])
    assert _without_table(text, "axis1").splitlines() == [*others[0], *others[1], *others[2]]


@pytest.mark.parametrize("given", [None, DATA_SHEET + NODES], ids=["built-in", "data sheet"])
def test_a_written_bench_is_checked_run_and_tested(tmp_path, given, capsys):
    before = None if given is None else tmp_path / "before.toml"
    if before is not None:
        before.write_text(given or "", encoding="utf-8")
    path, scenario = tmp_path / "found.toml", tmp_path / "move.scenario.toml"
    path.write_text(found_by(before), encoding="utf-8")
    scenario.write_text(SCENARIO, encoding="utf-8")

    assert main(["check", str(path)]) == ExitCode.DONE, capsys.readouterr()
    on_bus = ["-i", "virtual", "-c", "found", "--duration", "0.1", "--speed", "max", "--no-feed"]
    assert main(["run", str(path), *on_bus]) == ExitCode.DONE, capsys.readouterr()
    assert main(["test", str(scenario)]) == ExitCode.DONE, capsys.readouterr()


@pytest.mark.parametrize(
    "value", [True, False, 3, 0.25, 1.5e-9, 'a "load"', [[0.0, 0.0], [2.0, 500.0]], []]
)
def test_a_value_is_read_as_it_was_written(value):
    assert tomllib.loads(f"key = {_toml(value)}") == {"key": value}
