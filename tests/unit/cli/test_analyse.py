"""`hil-bench analyse`: what it prints, what it writes, what it refuses."""

import json

import pytest
from support.tables import from_text

from hil_bench import errors
from hil_bench.abilities.analysis import verbs
from hil_bench.cli import main

NAMES = (
    "linearisation",
    "root-locus",
    "flow-pressure",
    "frequency-response",
    "trajectories",
    "paper",
)
BENCH = """
[plant.lift]
moving_mass_kg = 80.0

[plant.swing]
moving_mass_kg = 20.0

[nodes]
lift_valve = { profile = "valve_408", node_id = 1, axis = "lift" }
swing_valve = { profile = "valve_408", node_id = 2, axis = "swing" }
"""


@pytest.fixture
def bench(make_file):
    return make_file("bench.toml", BENCH)


def facts(capsys, *arguments):
    assert main(["analyse", *arguments, "--json"]) == 0
    return {fact["name"]: fact["value"] for fact in json.loads(capsys.readouterr().out)["facts"]}


@pytest.mark.parametrize("name", NAMES)
def test_each_analysis_has_a_help_that_ends_with_examples(name, cli):
    examples = cli(["analyse", name, "--help"]).out.rpartition("\nexamples:\n")[2]
    assert examples.startswith(f"  hil-bench analyse {name}")


def test_without_a_bench_table_1_is_analysed(capsys):
    # sigma A / m = 2000 * 4.85e-3 / 20
    assert facts(capsys, "root-locus")["critical gain"] == pytest.approx(0.485)


def test_the_first_axis_of_a_bench_is_analysed_or_the_one_that_is_named(bench, capsys):
    assert facts(capsys, "root-locus", str(bench))["critical gain"] == pytest.approx(0.485 / 4.0)
    named = facts(capsys, "root-locus", str(bench), "--axis", "swing")
    assert named["critical gain"] == pytest.approx(0.485)


def test_the_operating_point_is_that_of_the_arguments(capsys):
    arguments = ("--velocity-mm-s", "-80", "--position-mm", "50", "--load-n", "-2000")
    found = facts(capsys, "linearisation", *arguments)

    assert found["full-order: velocity"] == pytest.approx(-0.08)
    assert found["full-order: position"] == pytest.approx(0.05)
    found = facts(capsys, "linearisation", "--spool-position-mm", "1")
    assert found["full-order: spool position"] == pytest.approx(1e-3)
    # An independent high-accuracy integration: about +0.204 m/s
    assert found["full-order: velocity"] == pytest.approx(0.204, abs=5e-4)
    assert facts(capsys, "linearisation")["full-order: velocity"] == pytest.approx(0.1)


def test_the_text_has_a_line_a_fact_and_the_files(tmp_path, capsys):
    assert main(["analyse", "flow-pressure", "--output", str(tmp_path / "new"), "-v"]) == 0

    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "Static flow-pressure curves"
    # K = 0.65 * 0.02 sqrt(2 / 850)
    assert lines[2] == "valve flow coefficient K    0.000630593 m²/(s sqrt(Pa))"
    written = [f"flow-pressure.{suffix}" for suffix in ("csv", "png", "svg")]
    assert lines[-3:] == [f"wrote {tmp_path / 'new' / name}" for name in written]
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == written


@pytest.mark.long
def test_a_chirp_and_a_sine_follow_the_arguments(tmp_path, capsys):
    response = facts(
        capsys, "frequency-response", "--amplitude-mm", "0.8", "--duration", "5", "--to-hz", "20"
    )
    assert "reduced, 0.8 mm: peak, at" in response
    trajectory = facts(
        capsys,
        *("trajectories", "--amplitude-mm", "0.7", "--frequency-hz", "2", "--duration", "0.5"),
        *("--output", str(tmp_path)),
    )
    assert "u = 0.7 mm sin(2π · 2 Hz · t), full-order: largest velocity" in trajectory
    assert (tmp_path / "trajectories-1-reduced.csv").is_file()


@pytest.mark.long
def test_dead_zone_and_saturation_stay_in_where_it_is_told(capsys):
    # An amplitude within the dead-zone of 0.3 mm.
    arguments = ("frequency-response", "--amplitude-mm", "0.25", "--duration", "5")

    name = "full-order, 0.25 mm: largest position"
    assert facts(capsys, *arguments, "--with-valve")[name] == pytest.approx(0.0, abs=1e-9)
    assert facts(capsys, *arguments)[name] != pytest.approx(0.0, abs=1e-4)


@pytest.mark.long
def test_the_papers_report_is_written_and_its_verdicts_printed(tmp_path, cli, monkeypatch):
    run = verbs.run_paper
    monkeypatch.setattr(verbs, "run_paper", lambda: run(chirp_duration=5.0))
    monkeypatch.setattr("hil_bench.abilities.analysis.paper.paper_studies", lambda _runs: [])

    lines = cli(["analyse", "paper", "--output", str(tmp_path)]).out.splitlines()
    assert lines[0].startswith("holds with a correction")
    assert lines[-1] == f"report    {tmp_path / 'paper-report.md'}"
    assert (tmp_path / "paper-report.md").is_file()

    content = json.loads(cli(["analyse", "paper", "--output", str(tmp_path), "--json"]).out)
    assert content["statements"][0].keys() == {"place", "claim", "found", "verdict"}


@from_text("arguments", "message")
def test_a_mistake_is_one_line_and_exit_code_2(arguments, message, cli):
    (line,) = cli(["analyse", *arguments.split()], 2).err.splitlines()
    assert line.startswith(f"hil-bench: error: {message}")


@pytest.mark.parametrize(
    "arguments",
    [[], ["magic"], ["linearisation", "--velocity-mm-s", "1", "--spool-position-mm", "1"]],
)
def test_wrong_usage_is_exit_code_2(arguments):
    assert main(["analyse", *arguments]) == 2


def test_an_output_that_cannot_be_is_refused(tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert main(["analyse", "root-locus", "--output", str(tmp_path / "file")]) == 2
    assert "cannot be made: File exists; give a directory of yours" in capsys.readouterr().err


def test_a_missing_extra_is_one_line_that_names_it(monkeypatch, cli):
    monkeypatch.setattr(errors.importlib.util, "find_spec", lambda _name: None)

    assert cli("analyse root-locus", 2).err == (
        "hil-bench: error: hil-bench analyse needs scipy; install it with: "
        "pip install 'hil-bench[analysis]'\n"
    )
