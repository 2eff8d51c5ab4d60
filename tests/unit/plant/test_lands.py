"""Metering edges with gains of their own and a flow that saturates."""

import math
from dataclasses import replace

import pytest

from hil_bench.abilities.analysis.operating_point import find_operating_point
from hil_bench.bench.configuration import load_config
from hil_bench.errors import ConfigError, ParameterError
from hil_bench.plants.hydraulic_cylinder.data_sheet.valve import saturation
from hil_bench.plants.hydraulic_cylinder.model.extensions import MeteringLands
from hil_bench.plants.hydraulic_cylinder.model.full_order import FullOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.reduced_order import ReducedOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.state import PlantInput, PlantState
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion
from hil_bench.plants.hydraulic_cylinder.model.stepping import Solver

LANDS = MeteringLands(gain_pa=1.1, gain_at=0.9, gain_pb=0.84, gain_bt=0.7, saturation=3.0)
TURBULENT = replace(PlantOptions.bench(), laminar_transition=0.0)


def plant(lands, *, solver=Solver.LINEARLY_IMPLICIT_MIDPOINT, dt=5e-5, **state):
    start = PlantState(-0.15, 0.0, 48e5, 51e5, 0.0, 0.0)._replace(**state)
    options = replace(TURBULENT, lands=lands)
    return FullOrderPlant(paper_parameters(), options=options, solver=solver, dt=dt, state=start)


def test_four_like_edges_give_the_bits_of_the_paper():
    alike, none = plant(MeteringLands()), plant(None)
    for opening in (1e-3, -0.8e-3, 0.0, 0.4e-3):
        assert alike.step(PlantInput(opening), 1500) == none.step(PlantInput(opening), 1500)


@pytest.mark.parametrize("a", [0.1, 0.5, 1.0])
def test_the_law_is_that_of_a_valve_that_saturates(a):
    """z / sqrt(1 + (z / z_s)²), scaled to 1 at alpha, with s = (alpha / z_s)²."""
    z_s = 1.0 / math.sqrt(3.0)
    law = a / math.sqrt(1.0 + (a / z_s) ** 2) * math.sqrt(1.0 + 3.0)
    assert LANDS.bend(a) == pytest.approx(law, rel=1e-12)


@pytest.mark.parametrize(("nu", "gain_a", "gain_b"), [(0.8e-3, 1.1, 0.7), (-0.8e-3, 0.9, 0.84)])
def test_each_port_has_the_flow_of_its_edge(nu, gain_a, gain_b):
    """Q = g K z b sqrt(drop) at z = 0.5 mm, half of alpha: b = sqrt(4 / 1.75)."""
    output = plant(LANDS, nu=nu).output
    p = paper_parameters()
    flow = p.K * 0.5e-3 * math.sqrt(4.0 / 1.75)
    drop_a, drop_b = (52e5, 51e5) if nu > 0 else (48e5, 49e5)
    sign = math.copysign(1.0, nu)
    assert output.Q_A == pytest.approx(sign * gain_a * flow * math.sqrt(drop_a), rel=1e-12)
    assert output.Q_B == pytest.approx(-sign * gain_b * flow * math.sqrt(drop_b), rel=1e-12)


@pytest.mark.parametrize("extends", [True, False])
def test_the_steady_motion_is_the_closed_form(extends):
    options = replace(TURBULENT, lands=LANDS)
    expected = steady_motion(paper_parameters(), options, extends=extends, z=0.5e-3)
    # The mean pressure settles with 8 per second only: it begins where it ends.
    pressures = {"P_A": expected.P_A, "P_B": expected.P_B}
    found = plant(LANDS, x=-0.15 if extends else 0.15, **pressures)
    output = found.step(PlantInput(0.8e-3 if extends else -0.8e-3), 24_000)
    assert abs(output.v) == pytest.approx(expected.speed, rel=1e-4)
    assert pytest.approx(expected.P_A, rel=1e-3) == output.P_A
    assert pytest.approx(expected.P_B, rel=1e-3) == output.P_B


def test_the_operating_point_of_the_analyses_is_that_motion():
    options = replace(PlantOptions.bench(), lands=LANDS, laminar_transition=0.0)
    expected = steady_motion(paper_parameters(), options, extends=True, z=0.5e-3)
    point = find_operating_point(paper_parameters(), options, spool_position=0.8e-3)
    assert point.velocity == pytest.approx(expected.speed, rel=1e-6)
    assert point.pressure_a == pytest.approx(expected.P_A, rel=1e-6)


@pytest.mark.parametrize("solver", [Solver.FORWARD_EULER, Solver.LINEARLY_IMPLICIT_MIDPOINT])
def test_all_solvers_step_the_same_edges(solver):
    reference = plant(LANDS, solver=Solver.RUNGE_KUTTA, dt=5e-6)
    other = plant(LANDS, solver=solver, dt=5e-6)
    for opening in (1e-3, -0.7e-3):
        wanted = reference.step(PlantInput(opening), 20_000)
        found = other.step(PlantInput(opening), 20_000)
        assert found.x == pytest.approx(wanted.x, abs=2e-5)
        assert found.v == pytest.approx(wanted.v, abs=2e-4)


def test_the_flow_at_half_opening_is_that_of_the_data_sheet():
    for half in (0.5, 0.6, 0.75):
        lands = MeteringLands(saturation=saturation(half))
        assert lands.bend(0.5) == pytest.approx(half, rel=1e-12)


def test_a_file_gives_them_by_data_sheet_or_one_by_one():
    keys = {"ratio_a_b": 2.0, "flow_at_half_opening_percent": 60.0, "rated_flow_l_min": 60}
    sheet = {"rated_pressure_drop_bar": 5, "overlap_percent": 10, "frequency_90deg_hz": 50}
    axis = load_config(tables={"plant": {"axis1": keys | sheet}}).axes[0]
    assert axis.options.lands == MeteringLands(gain_pb=0.5, gain_bt=0.5, saturation=saturation(0.6))
    assert saturation(0.6) == pytest.approx(0.44 / 0.64)  # (4 0.36 - 1) / (1 - 0.36)
    axis = load_config(tables={"plant": {"axis1": {"land_gain_pb": 0.84}}}).axes[0]
    assert axis.options.lands == MeteringLands(gain_pb=0.84)
    assert load_config().axes[0].options.lands is None


def test_what_makes_no_sense_is_refused():
    with pytest.raises(ParameterError, match="gain_at = 0"):
        MeteringLands(gain_at=0.0)
    with pytest.raises(ParameterError, match="no place for lands"):
        ReducedOrderPlant(paper_parameters(), options=PlantOptions(lands=LANDS))
    with pytest.raises(ConfigError, match="flow_saturation"):
        load_config(tables={"plant": {"axis1": {"flow_saturation": -1}}})
    sheet = {"rated_pressure_drop_bar": 5, "overlap_percent": 10, "frequency_90deg_hz": 50}
    keys = {"ratio_a_b": 2, "land_gain_pb": 0.5, "rated_flow_l_min": 60}
    with pytest.raises(ConfigError, match="land_gain_pb: given twice: ratio_a_b says it too"):
        load_config(tables={"plant": {"axis1": keys | sheet}})
