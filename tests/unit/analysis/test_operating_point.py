"""The trim against the plant itself: what it calls steady, the plant must keep."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hil_bench.abilities.analysis.figures import draw_flow_pressure
from hil_bench.abilities.analysis.operating_point import find_operating_point, flow_pressure_curves
from hil_bench.abilities.analysis.steady_motion import OperatingPointError
from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import FullOrderPlant, PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.extensions import (
    CounterbalanceValve,
    LuGreFriction,
    SupplyUnit,
)
from hil_bench.plants.hydraulic_cylinder.model.load import ConstantLoad
from hil_bench.plants.hydraulic_cylinder.model.waves import Line

BENCH = PlantOptions.bench()


@pytest.mark.parametrize("options", [PlantOptions.paper(), BENCH])
@pytest.mark.parametrize("leakage", [0.0, 1e-12])
@pytest.mark.parametrize(
    "given",
    [
        {"velocity": 0.1},
        {"velocity": -0.12, "position": -0.15},
        {"spool_position": 9e-4, "load": 5000.0},
        {"spool_position": -1.2e-3, "load": 20_000.0, "position": 0.1},
        {"velocity": 0.2, "load": -8000.0},
    ],
)
def test_the_plant_stays_where_the_trim_puts_it(table_1, options, leakage, given):
    parameters = replace(table_1, C_L=leakage)
    point = find_operating_point(parameters, options, **given)
    plant = FullOrderPlant(parameters, options=options, state=point.state)

    seen = plant.step(point.plant_input, 1)

    for name, value in given.items():
        assert getattr(point, name) == pytest.approx(value)
    # Far off the steady motion, one step would change the pressures by some 1e5 Pa.
    assert seen.v == pytest.approx(point.velocity, abs=1e-9)
    assert seen.P_A == pytest.approx(point.pressure_a, abs=1.0)
    assert seen.P_B == pytest.approx(point.pressure_b, abs=1.0)
    assert seen.z == pytest.approx(point.orifice_state)


@pytest.mark.parametrize(("spool", "velocity"), [(1.5e-3, 0.29126), (-1.5e-3, -0.28223)])
def test_the_fully_open_valve_gives_the_velocity_of_the_closed_form(table_1, spool, velocity):
    # (A_A³ + A_B³) (v / (alpha K))² + 2000 v + 600 = P_S A, beyond the Stribeck range, with
    # A_A³ + A_B³ = 2.28823e-7, alpha K = 6.3059e-7: 575447 v² + 2000 v = 49400 or 46400.
    point = find_operating_point(table_1, spool_position=spool)

    assert point.velocity == pytest.approx(velocity, abs=1e-5)


def test_steady_velocities_are_those_of_an_independent_integration(table_1):
    # u = +-1e-3 m: about +0.204 and -0.198 m/s, from a high-accuracy integration to steady state
    out = find_operating_point(table_1, spool_position=1e-3)
    back = find_operating_point(table_1, spool_position=-1e-3)

    assert out.velocity == pytest.approx(0.204, abs=5e-4)
    assert back.velocity == pytest.approx(-0.198, abs=5e-4)


def test_at_rest_the_pressures_hold_the_load(table_1):
    point = find_operating_point(table_1, velocity=0.0, load=3000.0, mean_pressure=4e6)

    force = point.pressure_a * table_1.A_A - point.pressure_b * table_1.A_B
    assert force == pytest.approx(3000.0)
    assert point.pressure_a + point.pressure_b == pytest.approx(8e6)
    assert point.orifice_state == 0.0
    assert point.load_pressure == point.pressure_a - point.pressure_b


def test_a_spool_inside_the_dead_zone_holds_the_piston(table_1):
    point = find_operating_point(table_1, spool_position=2.9e-4)

    assert point.velocity == 0.0
    assert point.spool_position == 2.9e-4


def test_each_direction_may_have_its_own_valve(table_1):
    options = PlantOptions(alpha_negative=5e-4, beta_negative=1e-4)
    point = find_operating_point(table_1, options, velocity=-0.1)
    same = find_operating_point(table_1, velocity=-0.1)

    assert point.orifice_state == pytest.approx(same.orifice_state)
    assert point.spool_position == pytest.approx(same.spool_position + 2e-4)
    with pytest.raises(OperatingPointError, match=r"opens to 0\.5 mm"):
        find_operating_point(table_1, options, velocity=-0.2)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        # 50 kN - 600 N - 2000 * 0.1 N - 60 kN
        ({"velocity": 0.1, "load": 60_000.0}, "exceed the supply's force by 108"),
        ({"velocity": -0.1, "load": -60_000.0}, "exceed the supply's force"),
        ({"velocity": 0.5}, "needs an orifice of .* and the valve opens to 1 mm"),
        ({"spool_position": 1e-3, "load": 60_000.0}, "by 10000 N and pushes the piston back"),
    ],
)
def test_a_point_that_does_not_exist_is_refused_by_name(table_1, given, message):
    with pytest.raises(OperatingPointError, match=message):
        find_operating_point(table_1, **given)


def test_an_overrunning_load_that_would_cavitate_is_refused(table_1):
    with pytest.raises(OperatingPointError, match=r"chamber A would be at .* below the cavitation"):
        find_operating_point(table_1, BENCH, spool_position=1e-3, load=-60_000.0)


def test_a_leaking_cylinder_has_no_rest(table_1):
    with pytest.raises(OperatingPointError, match="leakage lets the pressures creep"):
        find_operating_point(replace(table_1, C_L=1e-12), velocity=0.0)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "give a velocity or a spool position"),
        ({"velocity": 0.1, "spool_position": 1e-3}, "give a velocity or a spool position"),
        ({"velocity": 0.1, "position": 0.2}, "must lie within the stroke"),
        ({"velocity": math.nan}, "must be finite"),
        ({"spool_position": math.inf}, "must be finite"),
        ({"velocity": 0.1, "load": math.nan}, "F_L = nan N: must be finite"),
        ({"velocity": 0.1, "position": math.nan}, "x = nan m: must be finite"),
        ({"velocity": 0.0, "mean_pressure": math.nan}, "mean_pressure = nan Pa: must be finite"),
    ],
)
def test_senseless_conditions_are_refused(table_1, given, message):
    with pytest.raises(ParameterError, match=message):
        find_operating_point(table_1, **given)


# What the trim does not know, it refuses.


@pytest.mark.parametrize(
    "options",
    [
        PlantOptions(bristles=LuGreFriction()),
        PlantOptions(supply=SupplyUnit()),
        PlantOptions(
            counterbalance=CounterbalanceValve(
                in_line_a=True, setting=1e7, pilot_ratio=3.0, conductance=1e-6
            )
        ),
        PlantOptions(line_b=Line(length=1.0, inner=0.01, bulk_modulus=1e9)),
        PlantOptions(loads=(ConstantLoad(10.0),)),
    ],
)
def test_options_with_states_or_loads_of_their_own_are_refused(table_1, options):
    with pytest.raises(OperatingPointError, match="give what acts on the rod as the load F_L"):
        find_operating_point(table_1, options, velocity=0.1)


# Eq. (14) at points worked by hand.


def test_a_curve_starts_at_no_load_and_ends_at_the_supply_pressure(table_1):
    curves = flow_pressure_curves(table_1, orifice_states=[0.0, 1e-3], points=11)

    # K = 0.65 * 0.02 sqrt(2 / 850) = 6.3059e-4; Q = 1e-3 K sqrt(1e7 / 2) = 1.41e-3 m³/s
    assert curves.load_pressure[[0, -1]] == pytest.approx([0.0, 1e7])
    assert curves.flow[1, 0] == pytest.approx(6.3059e-7 * math.sqrt(5e6), rel=1e-5)
    assert curves.flow[1, -1] == 0.0
    assert not curves.flow[0].any()


def test_half_the_flow_is_left_at_three_quarters_of_the_supply(table_1):
    curves = flow_pressure_curves(table_1, orifice_states=[5e-4], points=3)

    assert curves.load_pressure[1] == pytest.approx(7.5e6)
    assert curves.flow[0, 1] == pytest.approx(0.5 * curves.flow[0, 0])


def test_a_negative_opening_is_helped_by_a_positive_load(table_1):
    curves = flow_pressure_curves(table_1, orifice_states=[-1e-3], points=2)

    assert curves.flow[0] == pytest.approx(-6.3059e-7 * np.sqrt([5e6, 1e7]), rel=1e-5)


def test_by_default_the_curves_go_from_closed_to_fully_open(table_1):
    assert flow_pressure_curves(table_1).orifice_states[[0, -1]] == pytest.approx([0.0, 1e-3])


def test_a_figure_of_curves_is_in_bar_and_litres_per_minute(table_1):
    curves = flow_pressure_curves(table_1, orifice_states=[0.0, 1e-3], points=11)
    (place,) = draw_flow_pressure(curves).axes
    assert (place.get_xlabel()[-5:], place.get_ylabel()[-7:]) == ("[bar]", "[l/min]")
    for line, flow in zip(place.lines, curves.flow, strict=False):
        assert line.get_xdata() == pytest.approx(curves.load_pressure / 1e5)
        assert line.get_ydata() == pytest.approx(flow * 60_000.0)


@pytest.mark.parametrize(
    ("states", "points", "message"),
    [
        ([1.1e-3], 10, "within the valve's"),
        ([math.nan], 10, "within the valve's"),
        ([[1e-3]], 10, "in a row"),
        ([1e-3], 1, "needs 2 or more"),
    ],
)
def test_senseless_curves_are_refused(table_1, states, points, message):
    with pytest.raises(ParameterError, match=message):
        flow_pressure_curves(table_1, orifice_states=states, points=points)
