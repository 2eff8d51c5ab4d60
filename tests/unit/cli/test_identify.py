"""`hil-bench identify`: what it prints, what it writes, what it refuses."""

import json

import numpy as np
import pytest
from support.machine_record import Machine, random_steps

from hil_bench import errors, load_config
from hil_bench.abilities.common.arguments import find_cylinder
from hil_bench.abilities.common.block_file import RecordingFile
from hil_bench.abilities.identification.against import Change, Comparison
from hil_bench.abilities.identification.verbs import identify
from hil_bench.abilities.identification.verbs.identify import name_sensors
from hil_bench.cli import main

# A coarse step, which makes this quick; the machine is the built-in bench's.
BENCH = """
[bench]
tick_us = 4000
step_us = 500

[plant.lift]
orifice_width_mm = 22.0

[nodes]
valve = { profile = "valve_408", node_id = 1 }
"""


LEAK = Change("leakage", "internal_leakage_l_min_bar", before=0.0, after=0.01, explains=1.0)


@pytest.fixture
def bench(make_file):
    return make_file("bench.toml", BENCH)


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "run.csv"
    machine = Machine(axis="lift", tick=4e-3, step=5e-4)
    with RecordingFile(path) as file:
        file.write(machine.record(random_steps(0.4e-3, 1e-3, count=34, rows=25)))
    return path


HELD = ("bulk_modulus_mpa", "moving_mass_kg", "spool_natural_frequency_rad_s")


@pytest.mark.long
def test_a_recording_becomes_a_bench_and_a_picture(bench, recording, tmp_path, cli):
    """The time is short on purpose: whatever was found by then is a bench that `check` takes."""
    output = tmp_path / "lift"
    arguments = [str(recording), str(bench), "--output", str(output), "--time-limit", "20"]

    result = json.loads(cli(["identify", *arguments, "--fix", *HELD, "--json"]).out)
    assert result["parameters"]["orifice_width_mm"]["value"] == pytest.approx(20.0, rel=0.05)
    assert not set(HELD) & set(result["parameters"])
    assert sorted(path.name for path in output.iterdir()) == [
        "bench.toml",
        "strokes.png",
        "strokes.svg",
    ]
    (axis,) = load_config(output / "bench.toml").axes
    found = result["keys"]["orifice_width_mm"]
    assert axis.parameters.w == pytest.approx(1e-3 * found, rel=1e-5)
    assert "identified from run.csv, +- " in (output / "bench.toml").read_text(encoding="utf-8")
    assert main(["check", "--quiet", str(output / "bench.toml")]) == 0


@pytest.mark.long
def test_a_limit_decides_the_exit_code(bench, recording, tmp_path, capsys):
    """Without the time to leave strokes out no error of prediction is known, and none passes."""
    arguments = [str(recording), str(bench), "--output", str(tmp_path / "o"), "--time-limit", "1"]

    assert main(["identify", *arguments, "--require", "position 1 mm"]) == 1

    assert "NOT as required: position 1 mm: no stroke" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("found", "code", "said"),
    [
        (Comparison(1.5, (), ()), 0, "nothing has changed: it fits as before (1.50 times)"),
        (Comparison(1.501, (), ()), 6, "undecided: it fits 1.50 times worse, and no known"),
        (Comparison(3.0, (), ()), 6, "undecided: it fits 3.00 times worse, and no known"),
        (Comparison(3.001, (), ()), 1, "the machine has changed: it fits 3.00 times worse"),
        (Comparison(1.2, (LEAK,), ()), 1, "the machine has changed: it fits 1.20 times"),
    ],
)
def test_what_has_changed_decides_the_exit_code(
    bench, recording, cli, monkeypatch, found, code, said
):
    monkeypatch.setattr(identify, "compare", lambda *_: found)
    words = ["identify", *map(str, (recording, bench, "--against", recording))]
    assert cli(words, code).out.startswith(said)
    assert json.loads(cli([*words, "--json"], code).out)["is_changed"] is {0: False, 1: True}.get(
        code
    )


def test_recordings_of_other_rows_are_not_compared(bench, recording, tmp_path, capsys):
    """The same strokes each 2 ms: a machine that had not changed was said to have."""
    fine = tmp_path / "fine.csv"
    with RecordingFile(fine) as file:
        steps = random_steps(0.4e-3, 1e-3, count=34, rows=50)
        file.write(Machine(axis="lift", tick=2e-3, step=5e-4).record(steps))
    line = refusal(capsys, recording, bench, "--against", fine)
    assert line.endswith(
        "fine.csv: has rows each 2 ms, and the recording each 4 ms; thin the finer one"
    )


def refusal(capsys, *arguments):
    assert main(["identify", *map(str, arguments)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_a_wrong_axis_is_refused(bench, recording, capsys):
    assert "give lift" in refusal(capsys, recording, bench, "--axis", "swing")


def test_a_recording_of_another_axis_is_refused(recording, capsys):
    line = refusal(capsys, recording)

    assert str(recording) in line
    assert "lacks axis1.position" in line
    assert "it has lift" in line


def test_a_file_that_is_no_recording_is_refused(bench, capsys):
    assert "is no recording" in refusal(capsys, bench, bench)


@pytest.mark.parametrize(
    ("option", "value", "right"),
    [
        ("--jobs", "0", "give 1 to "),
        ("--time-limit", "0", "give 1 to "),
        ("--require", "position", '"position 1 mm"'),
        ("--fix", "moving_mas_kg", "moving_mass_kg"),
    ],
)
def test_a_senseless_option_is_refused(bench, recording, option, value, right, capsys):
    assert right in refusal(capsys, recording, bench, option, value)


def test_the_reduced_model_is_refused(recording, make_file, capsys):
    path = make_file("reduced.toml", '[plant.lift]\nmodel = "reduced"\n')

    assert 'model = "full-order"' in refusal(capsys, recording, path)


def test_without_scipy_the_way_to_install_it_is_told(recording, monkeypatch, capsys):
    monkeypatch.setattr(errors.importlib.util, "find_spec", lambda _: None)

    assert "pip install 'hil-bench[analysis]'" in refusal(capsys, recording)


def test_an_output_that_is_a_file_is_refused_before_the_work(bench, recording, capsys):
    assert "--output" in refusal(capsys, recording, bench, "--output", recording)


def test_a_refusal_leaves_no_empty_folder(recording, tmp_path, capsys):
    mine = tmp_path / "mine"
    mine.mkdir()

    for output in (tmp_path / "new" / "lift", mine):
        refusal(capsys, recording, "--output", output)

    assert not (tmp_path / "new").exists()
    assert mine.is_dir()


@pytest.mark.parametrize("column", ["spool_setpoint", "position"])
def test_a_wrong_polarity_is_refused_without_a_map_too(bench, tmp_path, column, capsys):
    path = tmp_path / "turned.csv"
    rows = Machine(axis="lift", tick=4e-3, step=5e-4).record(random_steps(0.4e-3, 1e-3, 34, 25))
    rows[f"lift.{column}"] *= -1.0
    with RecordingFile(path) as file:
        file.write(rows)

    assert "turn the polarity of" in refusal(capsys, path, bench)


def test_a_recording_full_of_gaps_is_refused(bench, recording, tmp_path, capsys):
    lines = recording.read_text(encoding="utf-8").splitlines(keepends=True)
    path = tmp_path / "gap.csv"
    lost = [row for row in range(202, len(lines)) if (row - 202) % 60 < 10]  # 44 ms each 240 ms
    path.write_text("".join(np.delete(np.array(lines, dtype=object), lost)))

    assert "gaps in time, the first at 0.8 s" in refusal(capsys, path, bench)


def test_the_sensors_of_an_axis_are_those_of_the_bench():
    config = load_config()
    axis = find_cylinder(config, None, "identification")
    assert name_sensors(config, axis) == {
        "position": "position",  # the nodes of the built-in bench.toml
        "P_A": "pressure_a",
        "P_B": "pressure_b",
    }
