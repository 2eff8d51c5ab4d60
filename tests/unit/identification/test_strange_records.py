"""`hil-bench identify` and records that cannot serve: one line each, about this record."""

import numpy as np
import pytest
from support.strange_logger import joined
from support.strange_machines import Sheet, write_sheet
from support.strange_plant import Machine, rest_state, run_stroke

from hil_bench.cli import main

SHEET = Sheet(
    bore=50, rod=28, stroke=100, flow=40, overlap=2, frequency=80, supply=140, mass=120, slope=0
)
COLUMNS = {
    "time": ("t", "s"),
    "spool_setpoint": ("u", "%"),
    "position": ("s", "mm"),
    "P_A": ("pA", "bar"),
    "P_B": ("pB", "bar"),
}
STEP = 2e-3


@pytest.fixture(scope="module")
def good():
    """Columns of a plain machine that goes out and in at three openings."""
    machine, runs = Machine(stroke=0.1), []
    state = rest_state(machine, -0.04)
    for amplitude in (0.4, -0.4, 0.6, -0.6, 0.9, -0.9):
        runs.append(run_stroke(machine, state, amplitude, limit=0.04))
        state = runs[-1].end
    rows = joined(runs)
    every = round(STEP / (rows["time"][1] - rows["time"][0]))
    rows = {name: values[::every] for name, values in rows.items()}
    noise = np.random.default_rng(7).standard_normal((3, len(rows["time"])))
    return {
        "t": rows["time"],
        "u": 100.0 * rows["command"],
        "s": 1e3 * rows["x"] + 5e-3 * noise[0],
        "pA": rows["pressure_a"] / 1e5 + 0.1 * noise[1],
        "pB": rows["pressure_b"] / 1e5 + 0.1 * noise[2],
    }


@pytest.fixture
def refusal(tmp_path, capsys):
    """What the verb says of columns that it refuses, in its one line."""

    def say(columns):
        path, bench, rig = (tmp_path / name for name in ("run.csv", "bench.toml", "rig.toml"))
        if isinstance(columns, str):
            path.write_text(columns, encoding="utf-8")
        else:
            table = np.column_stack(list(columns.values()))
            np.savetxt(
                path, table, fmt="%.7g", delimiter=",", header=",".join(columns), comments=""
            )
        bench.write_text(write_sheet(SHEET), encoding="utf-8")
        tables = [f'[{q}]\ncolumn = "{c}"\nunit = "{u}"\n' for q, (c, u) in COLUMNS.items()]
        rig.write_text("\n".join(tables), encoding="utf-8")
        words = [str(path), str(bench), "--columns", str(rig), "--output", str(tmp_path / "out")]
        assert main(["identify", *words]) == 2
        assert not (tmp_path / "out").exists()
        lines = [one for one in capsys.readouterr().err.splitlines() if "warning:" not in one]
        (line,) = lines
        assert line.startswith("hil-bench: error: ")
        return line.removeprefix("hil-bench: error: ").removeprefix(f"{path}: ")

    return say


def test_no_rows(refusal):
    assert refusal("") == "is no recording: it has no row of numbers"
    assert refusal("t,u,s,pA,pB\n") == "is no recording: it has no row of numbers"


@pytest.mark.parametrize("other", ["u", "pA"])
def test_columns_that_are_swapped(refusal, good, other):
    swapped = good | {"s": good[other], other: good["s"]}
    assert "of position" in refusal(swapped)


@pytest.mark.parametrize(
    ("column", "factor", "words"),
    [
        ("s", 1e3, "the position changes by"),  # in um
        ("s", 1e-3, "mm in this recording; 1 mm or more are needed"),  # in m
        ("u", 1e-2, "full_scale"),  # a share
        ("u", 10.0, "spool_setpoint goes to 900 %; check its unit, or full_scale"),  # of +-100 V
        ("pA", 1e5, "at a supply pressure of 140 bar; check its unit"),  # in Pa
    ],
)
def test_units_that_are_wrong(refusal, good, column, factor, words):
    assert words in refusal(good | {column: factor * good[column]})


def test_both_pressures_in_another_unit(refusal, good):
    share = {side: 1e-5 * good[side] for side in ("pA", "pB")}  # in Pa, given as bar
    highest = max(share["pA"])
    assert refusal(good | share) == (
        f"P_A is {highest:.4g} bar at most, at a supply pressure of 140 bar; check its unit and "
        "gain, or supply_pressure_bar"
    )


def test_a_piston_in_its_stop(refusal, good):
    still = 50.0 + 5e-3 * np.random.default_rng(8).standard_normal(len(good["s"]))
    assert "1 mm or more are needed" in refusal(good | {"s": still})


def test_a_valve_without_command(refusal, good):
    assert "spool_setpoint is constant at 0" in refusal(good | {"u": 0.0 * good["u"]})


@pytest.mark.parametrize("column", ["u", "s"])
def test_a_polarity_that_is_wrong(refusal, good, column):
    assert "turn the polarity of spool_setpoint or of position" in refusal(
        good | {column: -good[column]}
    )


def test_one_sensor_in_both_columns_of_pressure(refusal, good):
    assert refusal(good | {"pB": good["pA"]}) == (
        "P_A and P_B are equal in each row; give the column of each, or only one"
    )


def test_a_clock_that_goes_back(refusal, good):
    times = good["t"].copy()
    times[len(times) // 2 :] -= 1.0
    assert "give rows in the order of time" in refusal(good | {"t": times})


def test_an_offset_of_the_position(refusal, good):
    assert "mid-stroke is 0" in refusal(good | {"s": good["s"] + 50.0})
