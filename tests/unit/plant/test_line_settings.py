"""Lines from the keys of a file, what they show, and what the summary says of them."""

import math

import pytest

from hil_bench import ConfigError, load_config
from hil_bench.plants.hydraulic_cylinder.model.state import PlantState
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion
from hil_bench.plants.hydraulic_cylinder.model.stepping import Solver
from hil_bench.plants.hydraulic_cylinder.model.waves import Line, line_drop

LINE_A = {
    "line_model": "waves",
    "bulk_modulus_mpa": 1000,
    "line_a_length_m": 6,
    "line_a_inner_mm": 12.5,
}
LINE_B = {"line_b_length_m": 2, "line_b_inner_mm": 10}
LONG = {"stroke_mm": 4000, "piston_side_volume_cm3": 12000, "rod_side_volume_cm3": 12000}
DATA_SHEET = {"bore_mm": 63, "rod_mm": 36, "stroke_mm": 500}


def axis_of(keys, **bench):
    return load_config(tables={"plant": {"axis1": keys}, "bench": bench}).axes[0]


def test_a_file_gives_length_diameter_modulus_and_the_oil_its_viscosity():
    options = axis_of(LINE_A | {"line_a_modulus_mpa": 850, "oil": "HLP 32"}).options
    assert options.line_b is None
    line = Line(length=6.0, inner=0.0125, bulk_modulus=850e6, viscosity=options.line_a.viscosity)
    assert options.line_a == line
    assert line.viscosity == pytest.approx(32e-6)


def test_a_rigid_line_has_the_oils_modulus_and_a_steel_wall_softens_it():
    assert axis_of(LINE_A).options.line_a.bulk_modulus == 1000e6
    found = axis_of(LINE_A | {"line_a_wall_mm": 2}).options.line_a.bulk_modulus
    assert found == pytest.approx(1.0 / (1.0 / 1000e6 + 12.5 / (2.0 * 206e9)))


def test_a_line_with_waves_is_no_volume_of_its_chamber_too():
    keys = DATA_SHEET | LINE_A
    waves, alone = axis_of(keys), axis_of(DATA_SHEET)
    volume = axis_of(keys | {"line_model": "volume"})
    assert waves.parameters.V_A0 == alone.parameters.V_A0
    held = volume.parameters.V_A0 - alone.parameters.V_A0
    assert held == pytest.approx(math.pi / 4 * 0.0125**2 * 6.0)
    assert not volume.options.has_lines


def test_the_pressures_at_the_valve_are_quantities_of_the_axis():
    axis = axis_of(LINE_A | LINE_B)
    assert list(axis.kind.by_name)[-2:] == ["P_A_valve", "P_B_valve"]
    plant = axis.kind.build(axis, 5e-5)
    for _ in range(40):
        seen = plant.drive(0.8e-3, 20)
    at = {name: axis.kind.by_name[name].output for name in ("P_A", "P_A_valve", "P_B_valve")}
    assert seen[at["P_A_valve"]] - seen[at["P_A"]] > 0.5e5
    assert tuple(plant.output) == tuple(seen)
    assert "P_A_valve" not in axis_of({}).kind.by_name
    assert list(axis_of(LINE_B | {"line_model": "waves"}).kind.by_name)[-1] == "P_B_valve"


@pytest.mark.parametrize("source", ["P_A", "P_A_valve"])
def test_a_sensor_sits_at_either_end(source):
    nodes = {"valve": {"profile": "valve_408", "node_id": 1}}
    nodes["pressure"] = {"profile": "pressure_404", "node_id": 2, "source": source}
    config = load_config(tables={"plant": {"axis1": LINE_A}, "nodes": nodes})
    assert [node.name for node in config.nodes] == ["valve", "pressure"]


def test_without_a_line_a_sensor_cannot_sit_at_its_end():
    nodes = {"valve": {"profile": "valve_408", "node_id": 1}}
    nodes["pressure"] = {"profile": "pressure_404", "node_id": 2, "source": "P_A_valve"}
    with pytest.raises(ConfigError, match="P_A_valve"):
        load_config(tables={"nodes": nodes})


@pytest.mark.parametrize("extends", [True, False])
def test_the_summarys_top_speed_is_what_the_plant_does(extends):
    axis = axis_of(LINE_A | LINE_B | LONG)
    expected = steady_motion(axis.parameters, axis.options, extends=extends)
    without = steady_motion(axis_of({}).parameters, axis_of({}).options, extends=extends)
    assert expected.speed < 0.95 * without.speed
    plant = axis.kind.build(axis, 5e-5, {"position": -1.0 if extends else 1.0})
    for _ in range(40):
        outputs = plant.drive(2e-3 if extends else -2e-3, 1000)
    seen = PlantState(*outputs[:6])
    assert abs(seen.v) == pytest.approx(expected.speed, rel=5e-3)
    assert pytest.approx(expected.P_A, rel=1e-2) == seen.P_A
    assert pytest.approx(expected.P_B, rel=1e-2) == seen.P_B
    p, options = axis.parameters, axis.options
    by_name = axis.kind.by_name
    at_a, at_b = (outputs[by_name[name].output] for name in ("P_A_valve", "P_B_valve"))
    drop_a = line_drop(options.line_a, p.rho, p.A_A * seen.v)
    drop_b = line_drop(options.line_b, p.rho, p.A_B * seen.v)
    assert at_a - seen.P_A == pytest.approx(drop_a, rel=1e-2)
    assert seen.P_B - at_b == pytest.approx(drop_b, rel=1e-2)


def test_the_summary_says_wave_time_eigenfrequency_drop_and_surge():
    axis = axis_of(LINE_A | {"oil_density_kg_m3": 1000})
    facts = {fact.name: fact for fact in axis.kind.summarise(axis, 1000, 50)}
    # c = 1000 m/s; between a quarter and half a wave: 1 / 24 ms to 1 / 12 ms
    assert facts["wave time of line A"].value == pytest.approx(6.0)
    assert facts["wave time of line A"].note == "at 1000 m/s; 120 steps"
    assert 1000 / 24 < facts["  its eigenfrequency"].value < 1000 / 12
    top = facts["top speed extending"].value * 1e-3
    flow = top * axis.parameters.A_A
    speed = flow / axis.options.line_a.area
    assert facts["  surge of a valve that shuts"].value == pytest.approx(1000 * 1000 * speed / 1e5)
    drop = line_drop(axis.options.line_a, 1000.0, flow) / 1e5
    assert facts["  its pressure drop"].value == pytest.approx(drop)
    lowest = facts["eigenfrequency, lowest"].value
    assert lowest < facts["  its eigenfrequency"].value


def test_a_step_that_misses_the_wave_time_is_doubted():
    axis = axis_of(LINE_A | {"line_a_length_m": 0.2}, step_us=125)  # 1084.6 m/s: 184 us
    doubts = [each for each in axis.kind.find_doubts(axis, 1000, 125) if "wave" in each]
    right = "18 us or less is within 5% of it"
    assert doubts == [f"a wave passes line A in 184 us, 1 steps of step_us = 125; {right}"]
    axis = axis_of(LINE_A)
    assert not [each for each in axis.kind.find_doubts(axis, 1000, 50) if "wave" in each]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"line_model": "waves"}, "line_model: waves need a line; give line_a_length_m"),
        ({"line_model": "pipes"}, "line_model"),
        (
            {"line_model": "waves", "line_a_length_m": 2},
            "line_a_length_m: a line has a length and an inner diameter; give line_a_inner_mm too",
        ),
        (
            LINE_A | {"line_a_wall_mm": 2, "line_a_modulus_mpa": 800},
            "line_a_modulus_mpa: given twice",
        ),
        (LINE_A | {"line_a_wall_mm": 13}, "line_a_wall_mm: wall = 0.013 m"),
        ({"line_a_wall_mm": 2}, "line_a_wall_mm: without waves it says nothing"),
        (LINE_A | {"line_a_length_m": 0}, "line_a_length_m: length of the line = 0 m"),
        (LINE_A | {"line_a_modulus_mpa": -1}, "line_a_modulus_mpa: bulk_modulus of the line"),
        (LINE_A | {"oil_viscosity_mm2_s": 0}, "oil_viscosity_mm2_s: viscosity of the line = 0"),
        (LINE_A | {"line_a_length_m": 0.04}, "line_a_length_m: .* within one step of 50 us"),
        (LINE_A | {"solver": Solver.RUNGE_KUTTA.value}, "line_a_length_m: runge-kutta has no"),
        (LINE_A | {"model": "reduced"}, "line_model: the reduced model has no place for lines"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(keys, message):
    with pytest.raises(ConfigError, match=message):
        axis_of(keys)
