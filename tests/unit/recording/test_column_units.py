"""Units of columns: what a logger writes in its own unit is judged as the same in SI.

Factors and offsets are those of the definitions: 1 psi is 0.45359237 kg · 9.80665 m/s² on a square
of 25.4 mm, 1 US gallon is 231 cubic inches, 0 °C is 273.15 K and 32 °F.
"""

import json
import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from support.tables import from_text

from hil_bench.abilities.recording.quantities import find_doubts
from hil_bench.abilities.recording.reading import given_units, read_recording
from hil_bench.abilities.scenario.load import load_requirements
from hil_bench.abilities.scenario.recorded import judge_with_trace
from hil_bench.cli import main
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import recording_channels

POUND_FORCE = 0.45359237 * 9.80665
# The unit as a file spells it, the bench's, the value of one of it and of zero of it.
UNITS = [
    ("bar", "Pa", 1e5, 0.0),
    ("[bar]", "Pa", 1e5, 0.0),
    ("mbar", "Pa", 100.0, 0.0),
    ("MPa", "Pa", 1e6, 0.0),
    ("GPa", "Pa", 1e9, 0.0),
    ("cm", "m", 1e-2, 0.0),
    ("Seconds", "s", 1.0, 0.0),
    ("kPa", "Pa", 1e3, 0.0),
    ("hPa", "Pa", 100.0, 0.0),
    ("psi", "Pa", POUND_FORCE / 0.0254**2, 0.0),
    ("mm", "m", 1e-3, 0.0),
    ("µm", "m", 1e-6, 0.0),
    ("μm", "m", 1e-6, 0.0),
    ("in", "m", 0.0254, 0.0),
    ("mm/s", "m/s", 1e-3, 0.0),
    ("m3/s", "m³/s", 1.0, 0.0),
    ("m^3/h", "m³/s", 1.0 / 3600.0, 0.0),
    ("l/min", "m³/s", 1e-3 / 60.0, 0.0),
    ("L/min", "m³/s", 1e-3 / 60.0, 0.0),
    ("gpm", "m³/s", 231.0 * 0.0254**3 / 60.0, 0.0),
    ("kN", "N", 1e3, 0.0),
    ("lbf", "N", POUND_FORCE, 0.0),
    ("N/mm", "N/m", 1e3, 0.0),
    ("Nm", "N m", 1.0, 0.0),
    ("%", "-", 0.01, 0.0),
    ("°", "rad", math.pi / 180.0, 0.0),
    ("deg", "rad", math.pi / 180.0, 0.0),
    ("rpm", "rad/s", math.tau / 60.0, 0.0),
    ("cm³", "m³", 1e-6, 0.0),
    ("degC", "°C", 1.0, 0.0),
    ("K", "°C", 1.0, -273.15),
    ("°F", "°C", 5.0 / 9.0, -160.0 / 9.0),
]


def write(path, unit, values, name="x.y", time="s"):
    rows = "".join(f"{row / 1000!r},{value!r}\n" for row, value in enumerate(values))
    path.write_text(f"time,{name}\n{time},{unit}\n{rows}", encoding="utf-8")
    return path


def test_a_column_in_1_is_a_plain_number(tmp_path):
    assert judged(tmp_path, "1", [0.5, 0.75], "always x.y < 0.8", "x.y") == 0


@pytest.mark.parametrize(("unit", "own", "factor", "offset"), UNITS)
def test_a_column_is_read_in_the_units_of_the_bench(tmp_path, unit, own, factor, offset):
    found = read_recording(write(tmp_path / "r.csv", unit, [0.0, 1.0, -40.0]))

    assert recording_channels(found)[1] == ("x.y", own)
    expected = [value * factor + offset for value in (0.0, 1.0, -40.0)]
    assert found["x.y"] == pytest.approx(expected, rel=1e-12, abs=1e-12)


@given(
    row=st.sampled_from([each for each in UNITS if each[1] not in {"N m", "rad"}]),
    values=st.lists(st.floats(-1e4, 1e4), min_size=2, max_size=4),
    limit=st.floats(-1e4, 1e4),
)
@example(row=("bar", "Pa", 1e5, 0.0), values=[5e-324, 0.0], limit=2.0)  # 5e-324 / 2e5 is 0
def test_a_verdict_does_not_depend_on_the_unit_of_the_file(tmp_path_factory, row, values, limit):
    """A limit in SI on the same motion, logged in SI and in a unit, gives one verdict."""
    unit, own, factor, offset = row
    bound = limit * factor + offset
    in_si = [value * factor + offset for value in values]
    if any(math.isclose(value, bound, rel_tol=1e-9, abs_tol=1e-9) for value in in_si):
        return  # rounding decides there
    symbol = {"-": "%"}.get(own, own)
    text = f"{bound * (100.0 if own == '-' else 1.0)!r} {symbol}"
    folder = tmp_path_factory.mktemp("unit")
    requirements = folder / "r.toml"
    requirements.write_text(
        f"[[expect]]\nid = 'R'\nthat = '''always x.y < {text}'''\n", encoding="utf-8"
    )
    file = load_requirements(requirements)
    outcomes = [
        judge_with_trace(file, read_recording(path), "r").findings[0].judgement.outcome
        for path in (write(folder / "u.csv", unit, values), write(folder / "s.csv", own, in_si))
    ]

    assert outcomes == ["passed" if max(in_si) < bound else "failed"] * 2


def judged(folder, unit, values, that, name):
    write(folder / "r.csv", unit, values, name)
    (folder / "r.toml").write_text(f'[[expect]]\nid = "R1"\nthat = "{that}"\n', encoding="utf-8")
    return main(["judge", str(folder / "r.toml"), str(folder / "r.csv"), "--json"])


def test_300_bar_are_more_than_250_bar(tmp_path, capsys):
    assert judged(tmp_path, "bar", [300.0] * 2, "always axis1.P_A < 250 bar", "axis1.P_A") == 1
    ((found,),) = json.loads(capsys.readouterr().out).values()
    assert found["judgement"]["margin"] == pytest.approx(-0.2)  # 50 bar of 250


@from_text("unit", "name", "that", "wrong")
def test_what_has_no_certain_unit_is_not_judged(tmp_path, capsys, unit, name, that, wrong):
    assert judged(tmp_path, unit, [1.0, 2.0], f"always {that}", name) == 2
    said = capsys.readouterr()
    assert wrong in said.err
    assert said.out == ""


@pytest.mark.parametrize(
    ("unit", "name", "values", "said"),
    [
        ("Pa", "axis1.P_A", [300.0, 290.0], "0.003 bar at most, less than 0.1 bar"),
        ("bar", "axis1.P_B", [1e7, 2e7], "2e+07 bar at most, more than 3000 bar"),
        ("m", "axis1.position", [200.0, -300.0], "3e+05 mm at most, more than 1e+05 mm"),
        ("-", "axis1.spool_position", [40.0, 50.0], "5000 % at most, more than 1000 %"),
        ("bar", "axis1.P_A", [0.0, 0.0], ""),  # the pump is off
        ("bar", "axis1.P_A", [math.nan, 210.0], ""),
    ],
)
def test_values_of_the_wrong_size_are_doubted_in_one_line(tmp_path, unit, name, values, said):
    recording = read_recording(write(tmp_path / "r.csv", unit, values, name))
    doubts = list(find_doubts(recording, [name]))
    assert doubts == ([f'{name} is {said}; check that its unit is "{unit}"'] if said else [])


def test_a_known_stroke_bounds_a_position(tmp_path):
    recording = read_recording(write(tmp_path / "r.csv", "mm", [0.0, 7e4], "axis1.position"))
    assert list(find_doubts(recording, ["axis1.position"])) == []
    (doubt,) = find_doubts(recording, ["axis1.position"], {"axis1.position": 0.1})
    assert "is 7e+04 mm at most, more than 100 mm" in doubt


def test_the_time_has_a_unit_of_time(tmp_path):
    found = read_recording(write(tmp_path / "r.csv", "m", [1.0, 2.0], time="ms"))
    assert found["time"] == pytest.approx([0.0, 1e-6], rel=1e-12)
    assert given_units(found) == {"time": "ms"}
    with pytest.raises(ConfigError, match='its time is in "bar"; give it in s'):
        read_recording(write(tmp_path / "r.csv", "m", [1.0, 2.0], time="bar"))
