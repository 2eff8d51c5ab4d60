"""Data sheets to parameters, against closed forms and against hand calculations of the document."""

import math

import numpy as np
import pytest

from hil_bench import ConfigError, load_config
from hil_bench.abilities.new.wording import CYLINDERS, VALVES, catalogue_lines, describe_cylinder
from hil_bench.bench.configuration.plausibility import find_doubts
from hil_bench.plants.hydraulic_cylinder.data_sheet.oil import OILS
from hil_bench.plants.hydraulic_cylinder.data_sheet.valve import natural_frequency, step_response
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion
from hil_bench.plants.hydraulic_cylinder.summary import damping_ratio, softest_position

PRESS = {
    "bore_mm": 63,
    "rod_mm": 36,
    "stroke_mm": 500,
    "rated_flow_l_min": 60,
    "rated_pressure_drop_bar": 5,
    "overlap_percent": 15,
    "frequency_90deg_hz": 40,
    "oil": "HLP 46",
    "supply_pressure_bar": 210,
    "load_mass_kg": 500,
}


def load(without=(), **keys):
    """Return the bench of the press with some keys changed or left out."""
    chosen = {key: value for key, value in (PRESS | keys).items() if key not in without}
    return load_config(tables={"plant": {"axis1": chosen}})


def axis(without=(), **keys):
    return load(without, **keys).axes[0]


def refusal(without=(), **keys):
    with pytest.raises(ConfigError) as error:
        load(without, **keys)
    return str(error.value).replace("built-in bench:plant.axis1.", "")


def facts(found):
    return {fact.name.strip(): fact.value for fact in found.kind.summarise(found, 1000, 50)}


def test_bore_and_rod_give_areas_and_volumes():
    p = axis().parameters
    # pi/4 63², pi/4 (63² - 36²) mm²; 0.55 of the swept volume with the typical dead volume
    assert pytest.approx(31.172e-4, rel=1e-4) == p.A_A
    assert pytest.approx(20.994e-4, rel=1e-4) == p.A_B
    assert p.V_A0 == pytest.approx(0.55 * 31.172e-4 * 0.5, rel=1e-4)
    assert p.h == 0.25


def test_the_catalogue_has_the_sizes_of_the_standards():
    """Bores and rods of ISO 3320; drops of an edge as ISO 10770-1 rates valves: 5 and 35 bar."""
    rods = {12, 14, 18, 22, 28, 32, 36, 40, 45, 50, 56, 63, 70, 80, 90, 100, 110, 125}
    rods |= {140, 160, 180, 200, 220}
    small, large = CYLINDERS["ISO 6020-2, 160 bar"], CYLINDERS["ISO 6022, 250 bar"]
    assert list(small) == [25, 32, 40, 50, 63, 80, 100, 125, 160, 200]
    assert list(large) == [50, 63, 80, 100, 125, 160, 200, 250, 320]
    for bores in (small, large):
        for bore, each in bores.items():
            assert rods.issuperset(each)
            # ISO 7181: the areas are as 1.25 to 2.5 is to 1, roughly.
            assert all(1.2 < bore**2 / (bore**2 - rod**2) < 2.6 for rod in each)
    lines = {each[:14].strip(): each for each in catalogue_lines()}
    for name, valve in VALVES.items():
        is_servo = name.startswith("servo")
        assert (valve.rated_drop, valve.overlap > 0.0) == ((35.0, False), (5.0, True))[not is_servo]
        assert f"{valve.rated_flow:g} l/min @ {valve.rated_drop:g} bar, " in lines[name]
    assert describe_cylinder(63, 36) == "ISO 6020-2, 160 bar"
    assert describe_cylinder(63, 45) == "ISO 6020-2, 160 bar and ISO 6022, 250 bar"
    assert describe_cylinder(63.5, 36) == describe_cylinder(63, 37) == ""


def test_a_second_rod_dead_volumes_and_lines_count():
    p = axis(
        second_rod_mm=36, dead_volume_a_cm3=40, line_b_length_m=2, line_b_inner_mm=13
    ).parameters
    assert p.A_A == p.A_B
    assert p.V_A0 == pytest.approx(20.994e-4 * 0.25 + 40e-6, rel=1e-4)
    # 2 m of 13 mm hold pi/4 1.3² 200 = 265.5 cm³.
    assert p.V_B0 == pytest.approx(20.994e-4 * 0.275 + 265.46e-6, rel=1e-4)


def test_the_rated_flow_at_its_drop_is_what_the_wide_open_edge_passes():
    p = axis().parameters
    assert p.K * p.alpha * math.sqrt(5e5) == pytest.approx(60e-3 / 60, rel=1e-12)
    assert p.beta / (p.alpha + p.beta) == pytest.approx(0.15)


def test_the_width_is_that_of_the_hand_calculation():
    """NG10, 60 l/min at 5 bar, alpha = 1 mm, 850 kg/m³: w = 44.85 mm by hand."""
    given = {"orifice_full_opening_mm": 1, "spool_overlap_mm": 0.3, "oil_density_kg_m3": 850}
    assert axis(["overlap_percent"], **given).parameters.w == pytest.approx(44.85e-3, rel=1e-4)


@pytest.mark.parametrize("damping", [0.4, 0.7, 1.0, 1.8])
def test_a_lag_of_the_frequency_found_reaches_90_percent_in_time(damping):
    """Against the lag integrated by small steps."""
    omega = natural_frequency(0.02, damping)
    position = speed = 0.0
    dt = 1e-6
    for _ in range(20_000):
        speed += dt * (omega**2 * (1.0 - position) - 2.0 * damping * omega * speed)
        position += dt * speed
    assert position == pytest.approx(0.9, abs=1e-3)
    assert step_response(omega * 0.01, damping) < 0.9


def test_the_frequency_at_minus_90_degrees_is_the_natural_one():
    p = axis().parameters
    lag = 1.0 / (1.0 - 1.0 + 2j * p.xi)  # of (3) at omega = omega_0: its phase is -90 degrees
    assert math.degrees(math.atan2(lag.imag, lag.real)) == pytest.approx(-90.0)
    assert p.omega_0 == pytest.approx(2.0 * math.pi * 40.0)


def test_the_viscosity_is_that_of_the_grade_at_both_temperatures():
    oil = OILS["HLP 46"]
    assert oil.viscosity_at(40.0) == pytest.approx(46.0)
    assert oil.viscosity_at(100.0) == pytest.approx(6.8)
    # On the straight line of ASTM D341 through them, by hand with a pocket calculator.
    assert oil.viscosity_at(60.0) == pytest.approx(20.4, rel=0.02)
    assert axis().parameters.rho == pytest.approx(875.0 / 1.0175)
    assert pytest.approx(1400e6) == axis().parameters.E


def test_a_pump_gives_displacement_times_speed_times_efficiency():
    unit = {"supply": "unit", "relief_pressure_bar": 210}
    pump = {"pump_displacement_cm3": 28, "pump_speed_rpm": 1450}
    found = axis(**unit, **pump, pump_volumetric_efficiency_percent=90).options.supply
    assert found.pump_flow == pytest.approx(28e-6 * 1450 / 60 * 0.9)
    assert "supply = " in refusal(**pump)
    assert "relief_pressure_bar: missing" in refusal(**pump, supply="unit")


def test_every_value_says_where_it_comes_from():
    settings = {each.key.name: each for each in load().settings if each.table == "plant.axis1"}
    assert (
        settings["orifice_width_mm"].reason == "from rated_flow_l_min and rated_pressure_drop_bar"
    )
    assert settings["bulk_modulus_mpa"].reason.startswith("from oil; typical: ")
    assert settings["stribeck_exponent"].reason == ""


def test_a_value_is_typical_until_its_datum_is_given():
    pump = {"pump_displacement_cm3": 28, "pump_speed_rpm": 1450, "relief_pressure_bar": 210}
    pump["supply"] = "unit"
    measured = pump | {"pump_volumetric_efficiency_percent": 93, "breakaway_pressure_bar": 2}

    def reasons(keys):
        each = {one.key.name: one for one in load(**keys).settings if one.table == "plant.axis1"}
        return each["pump_flow_l_min"].reason, each["static_friction_n"].reason

    flow = "from pump_displacement_cm3 and pump_speed_rpm"
    friction = "from bore_mm; typical: breakaway at 1.8 bar"
    assert reasons(pump) == (f"{flow}; typical: volumetric efficiency 92 %", friction)
    flow = flow.replace(" and", ",") + " and pump_volumetric_efficiency_percent"
    assert reasons(measured) == (flow, "from breakaway_pressure_bar and bore_mm")


@pytest.mark.parametrize(
    ("without", "keys", "said"),
    [
        ([], {"rod_mm": 63}, "rod_mm: 63 is not thinner than bore_mm = 63; give less than 63"),
        ([], {"second_rod_mm": 70}, "second_rod_mm: 70 is not thinner than bore_mm = 63"),
        (["rated_pressure_drop_bar"], {}, "rated_pressure_drop_bar: missing; rated_flow_l_min is"),
        (["stroke_mm"], {}, "stroke_mm: missing; bore_mm is given and needs it; give"),
        (["overlap_percent"], {}, "overlap_percent: missing; rated_flow_l_min is given and needs"),
        (["frequency_90deg_hz"], {}, "frequency_90deg_hz: missing; rated_flow_l_min is given"),
        ([], {"step_response_ms": 12}, "step_response_ms: given twice: frequency_90deg_hz says it"),
        ([], {"piston_area_cm2": 31}, "piston_area_cm2: given twice: bore_mm says it too; leave"),
        ([], {"orifice_width_mm": 40}, "orifice_width_mm: given twice: rated_flow_l_min and rated"),
        ([], {"oil": "olive"}, 'oil: "olive" is unknown; give one of "HLP 22", '),
        (["oil"], {"oil_temperature_c": 50}, "oil_temperature_c: says nothing without an oil"),
        ([], {"line_a_length_m": 2}, "line_a_length_m: does not say the line's volume by itself"),
        ([], {"stroke_mm": 0}, "stroke_mm: 0 is no stroke; give more than 0"),
    ],
)
def test_what_makes_no_sense_is_one_line(without, keys, said):
    assert refusal(without, **keys).startswith(said)
    assert "\n" not in refusal(without, **keys)


def test_what_is_typical_gives_way_to_the_file():
    p = axis(moving_mass_kg=77, coulomb_friction_n=100, piston_side_volume_cm3=2000).parameters
    assert (p.m, p.F_c) == (77.0, 100.0)
    assert p.V_A0 == pytest.approx(2e-3)
    assert "given twice" in refusal(piston_side_volume_cm3=2000, dead_volume_a_cm3=40)


def test_a_part_that_is_still_table_one_is_doubted():
    valve = {"rated_flow_l_min", "rated_pressure_drop_bar", "overlap_percent", "frequency_90deg_hz"}
    (doubt,) = find_doubts(load(valve))
    assert "orifice_width_mm: 20 is Table I's, although bore_mm describes another machine" in doubt
    (doubt,) = find_doubts(load(["oil"]))
    assert "bulk_modulus_mpa: 100 is Table I's" in doubt
    assert find_doubts(load()) == []


def test_the_summary_agrees_with_the_hand_calculation_of_the_document():
    found = facts(axis())
    # docs/data-sheets.md, "By hand", within 1 %
    assert found["eigenfrequency, mid-stroke"] == pytest.approx(36.5, rel=0.01)
    assert found["top speed extending"] == pytest.approx(1783.0, rel=0.01)
    assert found["largest push"] == pytest.approx(210e5 * 31.172e-4 * 1e-3, rel=1e-4)


def test_the_speed_of_a_steady_motion_is_that_of_an_independent_integration():
    """u = +1e-3 m gives about +0.204 m/s, -1e-3 m about -0.198 m/s (z = 0.7 mm), no load."""
    p, options = paper_parameters(), PlantOptions.bench()
    extending = steady_motion(p, options, extends=True, z=0.7e-3)
    retracting = steady_motion(p, options, extends=False, z=0.7e-3)
    assert extending.speed == pytest.approx(0.204, abs=5e-4)
    assert retracting.speed == pytest.approx(0.198, abs=5e-4)
    force = extending.P_A * p.A_A - extending.P_B * p.A_B
    assert force == pytest.approx(600.0 + 2000.0 * extending.speed, rel=0.01)


def test_a_load_that_is_too_heavy_is_held_and_a_small_pump_limits():
    held = facts(axis(load_n=70_000))
    assert held["top speed extending"] == 0.0
    unit = {"supply": "unit", "relief_pressure_bar": 210, "pump_flow_l_min": 60}
    # 60 l/min into 31.172 cm² are 0.3208 m/s.
    assert facts(axis(**unit))["top speed extending"] == pytest.approx(320.8, rel=1e-3)


def test_the_softest_position_is_where_the_stiffness_is_least():
    p = axis().parameters

    def stiffness(x):
        return p.A_A**2 / (p.V_A0 + p.A_A * x) + p.A_B**2 / (p.V_B0 - p.A_B * x)

    x = softest_position(p)
    assert abs(x) < p.h
    assert stiffness(x) < min(stiffness(x - 1e-4), stiffness(x + 1e-4))


@pytest.mark.parametrize(
    "keys",
    [
        {},
        {"internal_leakage_l_min_bar": 0.02},
        {"viscous_friction_n_s_m": 0.0},
        {"viscous_friction_n_s_m": 0.0, "external_leakage_a_l_min_bar": 0.01},
        {"viscous_friction_n_s_m": 2e4, "internal_leakage_l_min_bar": 0.05},
        {"viscous_friction_n_s_m": 1e6, "external_leakage_b_l_min_bar": 0.01},  # nothing swings
    ],
)
@pytest.mark.parametrize("x", [-0.24, 0.0, 0.1])
def test_the_damping_ratio_is_that_of_the_eigenvalues(keys, x):
    found = axis(**keys)
    p, options = found.parameters, found.options
    mass = p.m + options.load_mass
    per_a, per_b = p.E / (p.V_A0 + p.A_A * x), p.E / (p.V_B0 - p.A_B * x)
    modes = np.linalg.eigvals(
        [
            [-p.sigma / mass, p.A_A / mass, -p.A_B / mass],
            [-p.A_A * per_a, -(p.C_L + options.C_LA) * per_a, p.C_L * per_a],
            [p.A_B * per_b, p.C_L * per_b, -(p.C_L + options.C_LB) * per_b],
        ]
    )
    swing = max(modes, key=lambda mode: mode.imag)
    expected = -swing.real / abs(swing) if swing.imag else 1.0
    assert (expected == 1.0) == (keys.get("viscous_friction_n_s_m") == 1e6)
    assert damping_ratio(found, x) == pytest.approx(expected, rel=1e-9, abs=1e-12)
