"""Cushions at the ends of the stroke."""

import math
from dataclasses import replace

import pytest
from scipy.optimize import brentq

from hil_bench.bench.configuration import load_config
from hil_bench.errors import ConfigError, ParameterError
from hil_bench.plants.hydraulic_cylinder.model.extensions import Cushion
from hil_bench.plants.hydraulic_cylinder.model.full_order import FullOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.orifice import (
    TAPER,
    cushion_resistance,
    cushion_resistances,
)
from hil_bench.plants.hydraulic_cylinder.model.parameters import paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.reduced_order import ReducedOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.state import PlantInput, PlantState
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion
from hil_bench.plants.hydraulic_cylinder.model.stepping import Solver

BOTH = {
    "cushion_a": Cushion(length=0.1, orifice=1e-3),
    "cushion_b": Cushion(length=0.12, orifice=1.2e-3),
}
TURBULENT = replace(PlantOptions.bench(), laminar_transition=0.0, **BOTH)
# No falling Stribeck curve: so slow a piston would stick and slip.
SMOOTH = replace(paper_parameters(), F_s=600.0, E=1e9)
WITHOUT = replace(TURBULENT, cushion_a=None, cushion_b=None)


def plant(x, options=TURBULENT, solver=Solver.LINEARLY_IMPLICIT_MIDPOINT, dt=5e-5):
    state = PlantState(x, 0.0, 48e5, 51e5, 0.0, 0.0)
    return FullOrderPlant(SMOOTH, options=options, state=state, solver=solver, dt=dt)


def steady_speed(extends):
    """Eqs. (5), (6) with 1/z² + (w / area)² in place of 1/z² for the chamber that empties."""
    p = SMOOTH
    fed, other, orifice = (p.A_A, p.A_B, 1.2e-3) if extends else (p.A_B, p.A_A, 1e-3)
    throttle = p.w / (math.pi / 4.0 * orifice**2)
    resistance = fed**3 / p.alpha**2 + other**3 * (1.0 / p.alpha**2 + throttle**2)

    def excess(v):
        drive = p.P_S * fed - math.tanh(400.0 * v) * p.F_c - p.sigma * v
        return drive * p.K**2 - v * v * resistance

    return brentq(excess, 1e-4, 1.0)


@pytest.mark.parametrize("extends", [True, False])
def test_the_steady_speed_in_the_cushion_is_that_of_the_orifice_law(extends):
    sign = 1.0 if extends else -1.0
    speed = steady_speed(extends)
    assert 0.01 < speed < 0.04  # 0.3 m/s and more without a cushion
    moving = plant(sign * 0.13)
    for _ in range(40_000):
        output = moving.step(PlantInput(sign * 2e-3), 10)
        if sign * output.x > 0.19:
            break
    assert sign * output.v == pytest.approx(speed, rel=1e-3)
    told = steady_motion(SMOOTH, TURBULENT, extends=extends, cushioned=True)
    assert told.speed == pytest.approx(speed, rel=1e-3)


def test_leaving_the_cushion_is_as_free_as_anywhere():
    """Oil flows in through the check valve: the same bits as without, but for the kernels'."""
    with_it, without = plant(-0.19), plant(-0.19, WITHOUT)
    for _ in range(20):
        found = with_it.step(PlantInput(1e-3), 100)
        wanted = without.step(PlantInput(1e-3), 100)
        assert found.x == pytest.approx(wanted.x, abs=1e-9)


def test_the_plug_closes_the_port_over_the_first_fifth():
    assert TAPER == 0.2
    assert cushion_resistance(0.1, 0.1, 3e4) == 0.0
    assert cushion_resistance(0.09, 0.1, 3e4) == pytest.approx(1.5e4)
    assert cushion_resistance(0.08, 0.1, 3e4) == pytest.approx(3e4)
    assert cushion_resistance(-1e-4, 0.1, 3e4) == 3e4
    assert cushion_resistance(-1e-4, 0.0, 0.0) == 0.0


@pytest.mark.parametrize(
    ("x", "expected"),
    # A's end is at -0.2: 0.1 long, closed after 0.02. B's is at 0.2: 0.05 long, closed after 0.01.
    [
        (-0.11, (1.5e4, 0.0)),
        (-0.19, (3e4, 0.0)),
        (0.0, (0.0, 0.0)),
        (0.155, (0.0, 3.5e4)),
        (0.19, (0.0, 7e4)),
    ],
)
def test_each_end_has_a_cushion_of_its_own(x, expected):
    assert cushion_resistances(x, 0.2, (0.1, 3e4, 0.05, 7e4)) == pytest.approx(expected)


def test_the_impact_on_the_end_stop_is_that_of_the_cushion():
    def fastest_at_the_stop(options):
        moving, fastest = plant(0.1, options), 0.0
        for _ in range(20_000):
            output = moving.step(PlantInput(2e-3), 2)
            fastest = max(fastest, abs(output.v) if output.x > 0.2 else 0.0)
        return fastest

    assert fastest_at_the_stop(WITHOUT) > 0.25
    assert fastest_at_the_stop(TURBULENT) < 0.03


@pytest.mark.parametrize(
    ("solver", "tolerance"),
    [(Solver.FORWARD_EULER, 1e-3), (Solver.LINEARLY_IMPLICIT_MIDPOINT, 1e-4)],
)
def test_all_solvers_step_the_same_cushion(solver, tolerance):
    reference = plant(0.05, solver=Solver.RUNGE_KUTTA, dt=5e-6)
    other = plant(0.05, solver=solver, dt=5e-6)
    for _ in range(4):
        wanted = reference.step(PlantInput(1e-3), 10_000)
        found = other.step(PlantInput(1e-3), 10_000)
        assert found.x == pytest.approx(wanted.x, abs=2e-5)
        assert found.v == pytest.approx(wanted.v, abs=tolerance)


def test_a_file_gives_it_by_length_and_orifice():
    keys = {"cushion_b_length_mm": 30, "cushion_b_orifice_mm": 1.5}
    options = load_config(tables={"plant": {"axis1": keys}}).axes[0].options
    assert options.cushion_a is None
    assert options.cushion_b == Cushion(length=0.03, orifice=1.5e-3)


def test_what_makes_no_sense_is_refused():
    with pytest.raises(ParameterError, match="length of the cushion = 0 m"):
        Cushion(length=0.0, orifice=1e-3)
    with pytest.raises(ParameterError, match="must be shorter than the stroke"):
        plant(0.0, replace(TURBULENT, cushion_a=Cushion(length=0.5, orifice=1e-3)))
    with pytest.raises(ParameterError, match="no place for cushion"):
        ReducedOrderPlant(paper_parameters(), options=PlantOptions(**BOTH))
    with pytest.raises(ConfigError, match="give cushion_a_orifice_mm too"):
        load_config(tables={"plant": {"axis1": {"cushion_a_length_mm": 30}}})
    keys = {"cushion_a_length_mm": 0, "cushion_a_orifice_mm": 1}
    with pytest.raises(ConfigError, match=r"cushion_a_length_mm: .* = 0 m; must be greater than 0"):
        load_config(tables={"plant": {"axis1": keys}})
    keys = {"cushion_b_length_mm": 30, "cushion_b_orifice_mm": 0}
    with pytest.raises(ConfigError, match=r"cushion_b_orifice_mm: .* = 0 m; must be greater"):
        load_config(tables={"plant": {"axis1": keys}})
