import io
import json
import shlex
import sys
import tomllib

import pytest
from support.tables import from_text

from hil_bench.abilities.new.wording import CYLINDERS, VALVES
from hil_bench.bench.configuration import load_config
from hil_bench.cli import main

PRESS = ["--cylinder", "63/36x500", "--valve", "60 l/min @ 5 bar", "--supply", "210"]
PRESS += ["--load", "500"]


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdin", io.StringIO())


def test_a_bench_is_written_with_the_origin_of_each_value(tmp_path, capsys):
    assert main(["new", *PRESS]) == 0
    text = (tmp_path / "bench.toml").read_text()
    axis = tomllib.loads(text)["plant"]["axis1"]
    assert (axis["bore_mm"], axis["rod_mm"], axis["stroke_mm"]) == (63, 36, 500)
    lines = [line for line in text.splitlines() if line.startswith("overlap_percent")]
    assert lines[0].endswith("# typical of NG10: look it up in the data sheet")
    assert "rated_flow_l_min = 60.0                   # command line\n" in text
    out, err = capsys.readouterr()
    assert out.startswith("wrote bench.toml\n\ntop speed extending ")
    assert err == ""
    # 210 bar make 210 / (1 - (36/63)²) = 312 bar in the rod's chamber.
    assert tomllib.loads(text)["nodes"]["pressure_b"]["span_bar"] == [0, 400]


@pytest.mark.parametrize(
    ("valve", "keys"),
    [
        ("NG16", {"rated_flow_l_min": 150, "overlap_percent": 15}),
        ("servo ng10", {"rated_pressure_drop_bar": 35, "overlap_percent": 0}),
        ("40 l/min @ 35 bar", {"rated_flow_l_min": 40, "overlap_percent": 0}),
        ("40 l/min@5bar, overlap 20 %, 25 ms", {"overlap_percent": 20, "step_response_ms": 25}),
        ("40 l/min @ 5 bar, 55 Hz", {"frequency_90deg_hz": 55, "overlap_percent": 15}),
    ],
)
def test_a_valve_is_a_size_or_its_data(tmp_path, valve, keys):
    options = [*PRESS]
    options[3] = valve
    assert main(["new", *options, "-q"]) == 0
    axis = tomllib.loads((tmp_path / "bench.toml").read_text())["plant"]["axis1"]
    assert keys.items() <= axis.items()


def test_a_double_rod_has_two_equal_areas():
    options = [*PRESS]
    options[1] = "80/45/45x300"
    assert main(["new", *options, "-q"]) == 0
    p = load_config("bench.toml").axes[0].parameters
    assert p.A_A == p.A_B


@from_text("options", "said")
def test_what_makes_no_sense_is_said_and_nothing_written(tmp_path, cli, options, said):
    (line,) = cli(["new", *PRESS, *shlex.split(options)], 2).err.splitlines()
    assert line.startswith(f"hil-bench: error: {said}")
    assert not (tmp_path / "bench.toml").exists()


def test_the_bench_of_the_environment_is_no_part_of_a_new_one(tmp_path, make_file, monkeypatch):
    other = make_file("other.toml", "[plant.axis1]\npiston_area_cm2 = 20\n")
    monkeypatch.setenv("HIL_BENCH_CONFIG", str(other))
    assert main(["new", *PRESS, "-q"]) == 0
    assert {each.name for each in tmp_path.iterdir()} == {"other.toml", "bench.toml"}


def test_what_is_missing_is_named(cli):
    lines = cli("new --valve NG10", 2).err.splitlines()
    assert [line.split()[2] for line in lines] == ["--cylinder:", "--supply:", "--load:"]


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_what_no_option_says_is_asked_until_it_makes_sense(tmp_path, monkeypatch, capsys):
    answers = "63/99x500\n63/36x500\nNG10\n210\n\n500\n\n\n"
    monkeypatch.setattr(sys, "stdin", Terminal(answers))
    assert main(["new"]) == 0
    axis = tomllib.loads((tmp_path / "bench.toml").read_text())["plant"]["axis1"]
    assert (axis["rod_mm"], axis["load_mass_kg"], axis["oil"]) == (36, 500, "HLP 46")
    err = capsys.readouterr().err
    assert "the rod of 99 mm fills the bore" in err
    assert "supply pressure in bar: " in err


def test_an_input_that_ends_writes_nothing(tmp_path, monkeypatch, cli):
    monkeypatch.setattr(sys, "stdin", Terminal("63/36x500\n"))
    said = cli("new", 2).err
    assert said.endswith("hil-bench: error: the input has ended; nothing was written\n")
    assert said.count("error: ") == 1
    assert not (tmp_path / "bench.toml").exists()


def test_a_file_that_is_there_is_kept(tmp_path, capsys):
    (tmp_path / "bench.toml").write_text("mine")
    assert main(["new", *PRESS]) == 2
    assert "bench.toml: is there already; give another name, or --force" in capsys.readouterr().err
    assert (tmp_path / "bench.toml").read_text() == "mine"
    assert main(["new", *PRESS, "--force", "-q"]) == 0


def test_json_has_the_summary_and_the_catalogue_is_printed(cli):
    found = json.loads(cli(["new", *PRESS, "--json"]).out)
    names = {fact["name"].strip(): fact["unit"] for fact in found["summary"]["axis1"]}
    assert names["eigenfrequency, lowest"] == "Hz"
    out = cli("new --catalogue").out
    assert all(name in out for name in (*VALVES, *CYLINDERS))


def test_what_check_prints_of_data_sheets_is_the_same_bench(make_file, cli):
    assert main(["new", *PRESS, "-q"]) == 0
    printed = make_file("printed.toml", cli("check bench.toml").out)
    assert load_config(printed).axes == load_config("bench.toml").axes
    text = printed.read_text()
    assert "# What axis1 can do:" in text
    assert "# piston_area_cm2 = 31.1725  " in text


def test_a_place_that_cannot_be_written_is_one_line(tmp_path, cli):
    assert cli(["new", str(tmp_path / "no/bench.toml"), *PRESS], 2).err == (
        f"hil-bench: error: {tmp_path}/no/bench.toml: "
        f"there is no folder {tmp_path}/no; make it first\n"
    )
