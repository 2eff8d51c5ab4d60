# ruff: noqa: E501 - one message a line
"""What a file says wrongly of a motor: one line each, with what would be right."""

import pytest
from support.motors import LOSSLESS, VALVE, write_bench

from hil_bench import ConfigError, load_config
from hil_bench.bench.configuration.plausibility import find_doubts

RATED = {"rated_speed_rpm": 600, "rated_pressure_bar": 150}
ENCODER = '[nodes.e]\nprofile = "{}"\nnode_id = 4\n'


@pytest.mark.parametrize(
    ("keys", "rest", "message"),
    [
        ({"displacement_cm3_rev": None}, "", "plant.axis1.displacement_cm3_rev: missing; give for example displacement_cm3_rev = 28"),
        ({"inertia_kg_m2": 0}, "", "plant.axis1.inertia_kg_m2: 0 is out of range; give a number in kg m² from 1e-07 to 1e+06"),
        ({"static_friction_n_m": 1, "coulomb_friction_n_m": 2}, "", "plant.axis1.static_friction_n_m: 1 is below coulomb_friction_n_m = 2; give that or more"),
        (RATED, "", "plant.axis1.rated_speed_rpm: says nothing without an efficiency; give hydromechanical_efficiency_percent too"),
        ({"volumetric_efficiency_percent": 95}, "", "plant.axis1.rated_speed_rpm: missing; volumetric_efficiency_percent is given and needs it; give for example rated_speed_rpm = 1500"),
        (RATED | {"hydromechanical_efficiency_percent": 90}, "", "plant.axis1.coulomb_friction_n_m: given twice: hydromechanical_efficiency_percent, rated_speed_rpm and rated_pressure_bar says it too; leave it out, or leave out hydromechanical_efficiency_percent, rated_speed_rpm and rated_pressure_bar"),
        ({"line_a_length_m": 1}, "", "plant.axis1.line_a_length_m: does not say the line's volume by itself; give line_a_inner_mm too"),
        ({"rated_pressure_drop_bar": None}, "", "plant.axis1.rated_pressure_drop_bar: missing; rated_flow_l_min is given and needs it; give for example rated_pressure_drop_bar = 5"),
        ({"supply_pressure_bar": -1}, "", "plant.axis1.supply_pressure_bar: P_S = -100000 Pa; must be greater than 0"),
        ({"inertia_kg_m2": 1e-7}, "", "plant.axis1.inertia_kg_m2: its swing on the oil is too fast for step_us = 50; give bench.step_us = 10"),
        ({}, ENCODER.format("encoder_406"), "nodes.e.axis: the plant is a rotary and has no position; give the node another profile or another axis"),
        ({"kind": '"hydraulic_cylinder"', "bore_mm": 63}, "", "unknown key"),
    ],
)  # fmt: skip
def test_one_line_says_what_is_wrong(tmp_path, keys, rest, message):
    path = write_bench(tmp_path, LOSSLESS | keys, VALVE + rest)
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    lines = str(caught.value).removeprefix(f"{path}:").splitlines()
    assert message in lines[0]


def test_a_rotary_encoder_needs_a_shaft(make_file):
    path = make_file("bench.toml", VALVE + ENCODER.format("rotary_encoder_406"))
    with pytest.raises(ConfigError, match="is a hydraulic_cylinder and has no angle"):
        load_config(path)


def test_what_is_not_said_is_doubted(tmp_path):
    keys = {"kind": '"rotary"', "displacement_cm3_rev": 28, "inertia_kg_m2": 0.02}
    doubts = find_doubts(load_config(write_bench(tmp_path, keys)))
    assert [doubt.split(": ")[0].rpartition(".")[2] for doubt in doubts] == [
        "orifice_width_mm",
        "bulk_modulus_mpa",
        "supply_pressure_bar",
        "coulomb_friction_n_m",
    ]


def test_a_motor_of_litres_is_doubted(tmp_path):
    keys = {"displacement_cm3_rev": 62_000, "inertia_kg_m2": 1000}
    path = write_bench(tmp_path, LOSSLESS | keys)
    (doubt,) = find_doubts(load_config(path))
    assert "displacement_cm3_rev: 62000; 0.3 to 50000 is usual" in doubt
