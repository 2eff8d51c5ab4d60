"""The full-order plant where it could go wrong: at rest, closed, in the stops, at any input."""

import dataclasses
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import (
    EndStop,
    FullOrderPlant,
    PlantInput,
    PlantOptions,
    PlantState,
    Solver,
    balanced_state,
    paper_parameters,
)
from hil_bench.plants.hydraulic_cylinder.model.full_order import largest_step

EULER = Solver.FORWARD_EULER
PAPER = PlantOptions.paper()
BENCH = PlantOptions.bench()


def run(plant, u, F_L=0.0, count=300):
    """The outputs after each of `count` milliseconds."""
    return [plant.step(PlantInput(u, F_L), round(1e-3 / plant.dt)) for _ in range(count)]


@pytest.mark.parametrize("solver", Solver)
def test_balanced_rest_stays_at_rest(paper, solver):
    plant = FullOrderPlant(paper, solver=solver)
    before = plant.state
    plant.step(PlantInput(0.0), 10_000)
    assert plant.state == pytest.approx(before, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("solver", Solver)
def test_spool_in_the_dead_zone_moves_nothing(paper, solver):
    # The spool overshoots by 4.6 % (xi = 0.7): 2.8e-4 * 1.046 < beta = 3e-4.
    plant = FullOrderPlant(paper, solver=solver)
    output = plant.step(PlantInput(2.8e-4), 1000)
    assert output.nu == pytest.approx(2.8e-4, rel=1e-6)
    assert output.z == output.Q_A == output.Q_B == 0.0
    assert output.x == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("solver", Solver)
def test_an_asymmetric_valve_saturates_each_way_by_itself(paper, solver):
    options = dataclasses.replace(PAPER, alpha_negative=5e-4, beta_negative=1e-4)
    plant = FullOrderPlant(paper, options=options, solver=solver)
    seen = [plant.step(PlantInput(u), 500).z for u in (2e-3, -2e-4, -2e-3)]
    assert seen == pytest.approx([1e-3, -1e-4, -5e-4], rel=1e-6)


@pytest.mark.parametrize("solver", Solver)
def test_equal_pressures_do_not_balance_a_single_rod(paper, solver):
    # 5 MPa (A_A - A_B) = 1500 N against 900 N of stiction: the rod moves out, and the oil's
    # stiffness of 4.0e6 N/m holds it where the force is back within the stiction.
    state = PlantState(0.0, 0.0, 5e6, 5e6, 0.0, 0.0)
    plant = FullOrderPlant(paper, solver=solver, state=state)
    assert 600.0 / 4.0e6 < plant.step(PlantInput(0.0), 100).x < 2400.0 / 4.0e6


def test_closed_chambers_keep_their_oil(paper):
    # With the valve closed and E constant, (8) integrates to P_A + E ln V_A = const.
    state = PlantState(0.0, 0.6, 5e6, 5e6, 0.0, 0.0)
    plant = FullOrderPlant(paper, options=PAPER, state=state, dt=1e-5)

    def oil(x, P_A, P_B):
        return (
            P_A / paper.E + math.log(paper.V_A0 + paper.A_A * x),
            P_B / paper.E + math.log(paper.V_B0 - paper.A_B * x),
        )

    before = oil(0.0, 5e6, 5e6)
    farthest = 0.0
    for _ in range(100):
        x, _, P_A, P_B, *_ = plant.step(PlantInput(0.0), 10)
        assert oil(x, P_A, P_B) == pytest.approx(before, abs=1e-9)
        farthest = max(farthest, x)
    assert farthest > 1e-3


def test_leakage_evens_the_pressures_out(paper):
    # Piston held by huge friction, valve closed: P_A - P_B decays with
    # C_L E (1 / V_A0 + 1 / V_B0) = 1.703 1/s for C_L = 1e-11.
    stuck = dataclasses.replace(paper, C_L=1e-11, F_c=1e9, F_s=1e9)
    state = PlantState(0.0, 0.0, 6e6, 4e6, 0.0, 0.0)
    output = FullOrderPlant(stuck, options=PAPER, state=state, dt=1e-4).step(
        PlantInput(0.0), 10_000
    )
    rate = 1e-11 * 1e8 * (1.0 / 1.2e-3 + 1.0 / 1.15e-3)
    assert output.P_A - output.P_B == pytest.approx(2e6 * math.exp(-rate), rel=1e-4)


def test_fast_leakage_is_the_midpoint_rule(paper):
    # As above with C_L = 1e-8: a step of the midpoint rule takes the difference of pressures by
    # (1 - r / 2) / (1 + r / 2) with r = 1703 1/s * 1e-4 s, and keeps P_A V_A + P_B V_B.
    stuck = dataclasses.replace(paper, C_L=1e-8, F_c=1e12, F_s=1e12)
    state = PlantState(0.0, 0.0, 6e6, 4e6, 0.0, 0.0)
    output = FullOrderPlant(stuck, options=PAPER, state=state, dt=1e-4).step(PlantInput(0.0))
    r = 1e-4 * 1e-8 * 1e8 * (1.0 / 1.2e-3 + 1.0 / 1.15e-3)
    assert output.P_A - output.P_B == pytest.approx(2e6 * (1 - r / 2) / (1 + r / 2), rel=1e-6)
    kept = 1.2e-3 * output.P_A + 1.15e-3 * output.P_B
    assert kept == pytest.approx(1.2e-3 * 6e6 + 1.15e-3 * 4e6, rel=1e-9)


@pytest.mark.parametrize("solver", Solver)
@pytest.mark.parametrize(
    ("signed_root", "velocity"),
    [(True, -0.0886), (False, 0.0)],  # -0.089 m/s signed; clamped, the oil carries the load
)
def test_overload(paper, solver, signed_root, velocity):
    options = dataclasses.replace(PAPER, signed_root=signed_root)
    plant = FullOrderPlant(paper, options=options, solver=solver)
    output = plant.step(PlantInput(1e-3, 6e4), 10_000)
    assert output.v == pytest.approx(velocity, abs=5e-4)
    assert output.P_A > paper.P_S


@pytest.mark.parametrize("solver", Solver)
def test_pull_below_vacuum_without_a_floor_and_with_one(paper, solver):
    # -60 kN pulls P_A below absolute zero, with every radicand positive.
    plant = FullOrderPlant(paper, options=PAPER, solver=solver)
    printed = plant.step(PlantInput(1e-3, -6e4), 1000)
    assert printed.P_A < -1e6
    assert printed.P_A < paper.P_S
    assert printed.P_B > paper.P_T
    plant = FullOrderPlant(paper, options=BENCH, solver=solver)
    assert min(output.P_A for output in run(plant, 1e-3, -6e4)) == -101_325.0
    plant = FullOrderPlant(paper, options=BENCH, solver=solver)
    assert min(output.P_B for output in run(plant, -1e-3, 6e4)) == -101_325.0


def test_a_chamber_at_the_floor_does_not_pull_deeper(paper):
    # Real oil, closed valve, hard pull: free pressure would fall by megapascals within each step.
    # At the floor the piston's acceleration is that of the floor's pressure and no lower.
    oil = dataclasses.replace(paper, E=1.5e9, F_c=0.0, F_s=0.0, sigma=0.0)
    floor = -101_325.0
    options = PlantOptions(cavitation_floor=floor)
    state = PlantState(0.0, 0.5, floor, 0.0, 0.0, 0.0)
    plant = FullOrderPlant(oil, options=options, state=state, dt=1e-4)
    output = plant.step(PlantInput(0.0, 0.0))
    # P_B rises by E A_B v dt / V_B; half of it acts during the step.
    P_B = 1.5e9 * 4.7e-3 * 0.5 * 1e-4 / 1.15e-3
    expected = 0.5 + 1e-4 / 20.0 * (floor * 5e-3 - 0.5 * P_B * 4.7e-3)
    assert output.P_A == floor
    assert output.v == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("solver", Solver)
@pytest.mark.parametrize("u", [1.3e-3, -1.3e-3])
def test_end_stop_holds_the_piston(paper, solver, u):
    plant = FullOrderPlant(paper, options=BENCH, solver=solver)
    outputs = run(plant, u, count=3000)
    # At rest the full supply pressure presses: P_S A / stiffness, 0.25 mm or less.
    area = paper.A_A if u > 0.0 else paper.A_B
    held_at = paper.h + paper.P_S * area / EndStop().stiffness
    assert abs(outputs[-1].x) == pytest.approx(held_at, abs=1e-6)
    assert outputs[-1].v == pytest.approx(0.0, abs=1e-9)
    assert max(abs(output.x) for output in outputs) < paper.h + 0.5e-3


@pytest.mark.parametrize("m", [5.0, 500.0])
def test_impact_depth_at_full_speed(paper, m):
    plant = FullOrderPlant(dataclasses.replace(paper, m=m), dt=1e-4)
    deepest = max(plant.step(PlantInput(1.3e-3)).x for _ in range(8000))
    assert paper.h < deepest < paper.h + 0.5e-3


def test_without_an_end_stop_the_piston_runs_on(paper):
    plant = FullOrderPlant(paper, options=PAPER, dt=1e-4)
    assert plant.step(PlantInput(1e-3), 20_000).x > 1.5 * paper.h


@pytest.mark.parametrize("E", [1e8, 1.5e9])
@pytest.mark.parametrize("laminar_transition", [0.0, 300.0])
def test_pressure_comes_to_rest_at_the_supply(paper, E, laminar_transition):
    # Pressed against the stop, P_A meets P_S with the orifice wide open: its rate there is 1e4 to
    # 1e6 1/s, where a midpoint rule rings on for good.
    oil = dataclasses.replace(paper, E=E)
    options = dataclasses.replace(BENCH, laminar_transition=laminar_transition)
    plant = FullOrderPlant(oil, options=options, state=balanced_state(oil, x=-oil.h))
    plant.step(PlantInput(-1.3e-3), 5_000)
    ripple = [plant.step(PlantInput(-1.3e-3)).P_B - oil.P_S for _ in range(100)]
    assert max(abs(value) for value in ripple) < 1.0


@pytest.mark.parametrize("m", [0.1, 5.0, 20.0, 500.0])
def test_piston_comes_to_rest_without_chatter(paper, m):
    # Standstill friction relaxes at (400 F_s + sigma) / m: 3.6e6 1/s for 0.1 kg.
    plant = FullOrderPlant(dataclasses.replace(paper, m=m), options=PAPER, dt=1e-4)
    plant.step(PlantInput(1e-3), 2000)
    plant.step(PlantInput(0.0), 10_000)
    velocities = [plant.step(PlantInput(0.0)).v for _ in range(100)]
    assert max(abs(v) for v in velocities) < 1e-5


finite = st.floats(allow_nan=False, allow_infinity=False)
inputs = st.tuples(finite | st.floats(-3e-3, 3e-3), finite | st.floats(-1e5, 1e5))
oils = st.builds(
    lambda E, m, area, gap: dataclasses.replace(
        paper_parameters(),
        E=E,
        m=m,
        A_A=area,
        V_A0=area * 0.2 + gap,
        V_B0=4.7e-3 * 0.2 + gap,
        C_L=1e-12,
    ),
    E=st.floats(1e7, 2e9),
    m=st.floats(0.5, 5000.0),
    area=st.floats(1e-3, 2e-2),
    gap=st.floats(1e-5, 1e-3),
)
option_sets = st.builds(
    PlantOptions,
    signed_root=st.booleans(),
    tanh_gain=st.floats(1.0, 1e6),
    end_stop=st.none() | st.builds(EndStop, stiffness=st.floats(1e5, 1e10)),
    cavitation_floor=st.none() | st.just(-101_325.0),
    laminar_transition=st.just(0.0) | st.floats(1.0, 1e5),
)


@settings(max_examples=200, deadline=None)
@given(parameters=oils, options=option_sets, history=st.lists(inputs, max_size=20))
def test_midpoint_stays_finite_for_any_finite_input(parameters, options, history):
    dt = min(1e-4, largest_step(parameters, options, Solver.LINEARLY_IMPLICIT_MIDPOINT))
    plant = FullOrderPlant(parameters, options=options, dt=dt)
    for u, F_L in history:
        output = plant.step(PlantInput(u, F_L), 50)
        assert all(math.isfinite(value) for value in (*plant.state, *output))
    assert 0 <= plant.extra_evaluations <= 84 * 50 * len(history)  # 64 + 16 + 4 + 1 a step


@settings(max_examples=200, deadline=None)
@given(history=st.lists(inputs, max_size=20), options=st.sampled_from([PAPER, BENCH]))
def test_forward_euler_stays_finite_or_says_so(history, options):
    plant = FullOrderPlant(paper_parameters(), options=options, solver=EULER)
    refusal = ""
    for u, F_L in history:
        try:
            output = plant.step(PlantInput(u, F_L), 50)
        except ParameterError as error:
            refusal = str(error)
            break
        assert all(math.isfinite(value) for value in output)
    assert not refusal or "has diverged" in refusal


@settings(max_examples=50, deadline=None)
@given(history=st.lists(st.floats(-2e-3, 2e-3), max_size=20), load=st.floats(-4e4, 4e4))
def test_bench_keeps_piston_and_pressures_where_they_can_be(history, load):
    parameters = paper_parameters()
    plant = FullOrderPlant(parameters)
    for u in history:
        output = plant.step(PlantInput(u, load), 500)
        assert abs(output.x) < parameters.h + 1e-3
        assert min(output.P_A, output.P_B) >= -101_325.0
