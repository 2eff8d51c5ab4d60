"""LuGre friction and loads in the plant, each against its closed form."""

import dataclasses
import math

import pytest

from hil_bench.plants.hydraulic_cylinder.model import (
    ConstantLoad,
    FullOrderPlant,
    LoadSeries,
    LuGreFriction,
    MassOnSlope,
    PlantInput,
    PlantOptions,
    Solver,
    SpringLoad,
    balanced_state,
)

UNDAMPED = [Solver.LINEARLY_IMPLICIT_MIDPOINT, Solver.RUNGE_KUTTA]  # forward Euler is unstable
MIDPOINT = Solver.LINEARLY_IMPLICIT_MIDPOINT
PAPER = PlantOptions.paper()
BENCH = PlantOptions.bench()


def free_mass(paper, m=20.0):
    """A piston that neither oil nor friction touches: E of a thousandth of a pascal."""
    return dataclasses.replace(paper, E=1e-3, F_c=0.0, F_s=0.0, sigma=0.0, m=m)


@pytest.mark.parametrize("solver", Solver)
def test_steady_motion_on_bristles_has_the_printed_friction(paper, solver):
    options = dataclasses.replace(PAPER, bristles=LuGreFriction(), tanh_gain=math.inf)
    start = balanced_state(paper, x=-0.19)
    plant = FullOrderPlant(paper, options=options, solver=solver, state=start)
    _, v, P_A, P_B, *_ = plant.step(PlantInput(1e-3), 17_000)
    friction = 600.0 + 300.0 * math.exp(-((v / 0.02) ** 0.8)) + 2000.0 * v  # eq. (13)
    assert P_A * paper.A_A - P_B * paper.A_B == pytest.approx(friction, rel=1e-4)


@pytest.mark.parametrize("solver", Solver)
def test_bristles_hold_a_load_at_rest_without_creep(paper, solver):
    # Without oil to help: 500 N bend the bristles by 0.05 mm, and there the piston stays. The
    # static curve with its tanh lets it creep at atanh(500/900) / 400 = 1.6 mm/s.
    dry = dataclasses.replace(paper, E=1e-3)
    options = dataclasses.replace(PAPER, bristles=LuGreFriction(), loads=(ConstantLoad(-500.0),))
    start = balanced_state(dry)
    plant = FullOrderPlant(dry, options=options, solver=solver, state=start)
    after_one = plant.step(PlantInput(0.0), 10_000).x
    after_ten = plant.step(PlantInput(0.0), 90_000).x
    assert plant.extension.z_f == pytest.approx(5e-5, rel=1e-3)
    assert after_ten == pytest.approx(after_one, abs=1e-12)
    static = dataclasses.replace(options, bristles=None)
    plant = FullOrderPlant(dry, options=static, solver=solver, state=start)
    assert plant.step(PlantInput(0.0), 10_000).v == pytest.approx(
        math.atanh(500.0 / 900.0) / 400.0, rel=0.15
    )


@pytest.mark.parametrize("solver", Solver)
def test_break_away_is_at_the_static_friction(paper, solver):
    # A slow ramp of 100 N/s: bristles give way between F_c and F_s, close to F_s.
    dry = dataclasses.replace(paper, E=1e-3)
    ramp = LoadSeries((0.0, 20.0), (0.0, -2000.0))
    options = dataclasses.replace(PAPER, bristles=LuGreFriction(), loads=(ramp,))
    plant = FullOrderPlant(dry, options=options, solver=solver, dt=1e-4)
    broke = next(step for step in range(2000) if plant.step(PlantInput(0.0), 100).v > 5e-3)
    assert 0.95 * 900.0 < broke * 1.0 < 1.01 * 900.0  # 1 N every 100 steps


@pytest.mark.parametrize("solver", Solver)
def test_a_constant_load_is_a_load(paper, solver):
    options = dataclasses.replace(BENCH, loads=(ConstantLoad(3000.0),))
    by_option = FullOrderPlant(paper, options=options, solver=solver, state=balanced_state(paper))
    by_input = FullOrderPlant(paper, options=BENCH, solver=solver)
    assert by_option.step(PlantInput(1e-3), 3000) == by_input.step(PlantInput(1e-3, 3000.0), 3000)


@pytest.mark.parametrize("solver", Solver)
def test_starts_at_rest_under_its_loads(paper, solver):
    loads = (ConstantLoad(2e3), SpringLoad(1e4, -0.1), MassOnSlope(100.0, 1.0))
    plant = FullOrderPlant(paper, options=dataclasses.replace(BENCH, loads=loads), solver=solver)
    before = plant.state
    plant.step(PlantInput(0.0), 10_000)
    assert plant.state == pytest.approx(before, rel=1e-9, abs=1e-9)


def test_a_mass_on_a_spring_swings_at_its_frequency(paper):
    # x = 0.03 + 0.02 cos(w t), w = sqrt(k / m) = 31.6 rad/s; the midpoint rule keeps the amplitude
    # and stretches the period by (w dt)² / 12 = 8e-7.
    options = dataclasses.replace(PAPER, loads=(SpringLoad(1.5e4, 0.04), SpringLoad(0.5e4, 0.0)))
    start = balanced_state(paper, x=0.05)
    plant = FullOrderPlant(free_mass(paper), options=options, state=start, dt=1e-4)
    for step in range(1, 101):
        x = plant.step(PlantInput(0.0), 100).x
        assert x == pytest.approx(0.03 + 0.02 * math.cos(math.sqrt(1e3) * step * 1e-2), abs=2e-6)


@pytest.mark.parametrize("stiffness", [1e6, 1e9, 1e13])
def test_a_stiff_spring_creates_no_energy(paper, stiffness):
    options = dataclasses.replace(PAPER, loads=(SpringLoad(stiffness),))
    start = balanced_state(paper)._replace(v=0.5)
    plant = FullOrderPlant(free_mass(paper), options=options, state=start)
    for _ in range(1000):
        x, v, *_ = plant.step(PlantInput(0.0))
        assert 10.0 * v * v + 0.5 * stiffness * x * x <= 2.5 * (1.0 + 1e-9)


@pytest.mark.parametrize("solver", UNDAMPED)
def test_a_mass_slides_down_its_slope(paper, solver):
    # a = -g M sin(slope) / (m + M), with M = 60 kg beside m = 20 kg
    options = dataclasses.replace(PAPER, loads=(MassOnSlope(60.0, math.radians(30.0)),))
    start = balanced_state(paper)
    plant = FullOrderPlant(free_mass(paper), options=options, solver=solver, state=start, dt=1e-4)
    v = plant.step(PlantInput(0.0), 1000).v
    assert v == pytest.approx(-0.1 * 9.80665 * 0.5 * 60.0 / 80.0, rel=1e-9)


@pytest.mark.parametrize("solver", UNDAMPED)
def test_a_series_gives_its_impulse(paper, solver):
    # 100 N rising over 10 ms, held for 20 ms, then falling at once: 2.5 N s on 20 kg.
    series = LoadSeries((0.01, 0.02, 0.04, 0.04), (0.0, 100.0, 100.0, 0.0))
    options = dataclasses.replace(PAPER, loads=(series,))
    plant = FullOrderPlant(free_mass(paper), options=options, solver=solver, dt=1e-4)
    assert plant.step(PlantInput(0.0), 100).v == pytest.approx(0.0, abs=1e-9)
    v = plant.step(PlantInput(0.0), 900).v
    # Runge-Kutta counts a sixth of the step before the fall, 100 N * 0.1 ms, as fallen already.
    assert v == pytest.approx(-2.5 / 20.0, abs=1e-9 if solver is MIDPOINT else 1e-4)
    assert plant.extension.t == pytest.approx(0.1, rel=1e-12)
