import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import (
    ConstantLoad,
    FullOrderPlant,
    LoadSeries,
    MassOnSlope,
    PlantInput,
    PlantOptions,
    ReducedOrderPlant,
    Solver,
    SpringLoad,
    paper_parameters,
)
from hil_bench.plants.hydraulic_cylinder.model.load import (
    find_point,
    series_force,
    step_loads,
    stop_force,
    stop_velocity_change,
)
from hil_bench.plants.hydraulic_cylinder.model.waves import Line


def test_weight_on_a_slope():
    expected = {  # 100 kg * 9.80665 m/s² * sin(slope)
        0.0: 0.0,
        30.0: 490.3325,
        90.0: 980.665,
        -90.0: -980.665,
    }
    assert {
        slope_deg: MassOnSlope(100.0, math.radians(slope_deg)).weight for slope_deg in expected
    } == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: ConstantLoad(math.nan), "load_force = nan N: must be finite"),
        (lambda: SpringLoad(0.0), "spring_stiffness = 0 N/m: must be greater than 0"),
        (lambda: SpringLoad(1.0, math.inf), "spring_rest = inf m: must be finite"),
        (lambda: MassOnSlope(-1.0), "load_mass = -1 kg: must be 0 or greater"),
        (lambda: MassOnSlope(1.0, 1.6), "slope = 1.6 rad: must lie between -pi/2 and pi/2"),
        (lambda: LoadSeries((), ()), "load_series = 0 times and 0 forces: must be one force"),
        (lambda: LoadSeries((0.0,), (1.0, 2.0)), "load_series = 1 times and 2 forces: must be"),
        (
            lambda: LoadSeries((1.0, 0.5), (0.0, 0.0)),
            "load_series = 0.5 s after 1 s: its times must not decrease",
        ),
        (lambda: LoadSeries(0.0, 1.0), "times of load_series = 0.0: must be tuple or list"),
        (lambda: LoadSeries((0.0,), "1"), "forces of load_series = '1': must be tuple or list"),
        (lambda: LoadSeries((0.0,), (math.nan,)), "force of load_series = nan N: must be finite"),
        (lambda: LoadSeries((math.inf,), (0.0,)), "time of load_series = inf s: must be finite"),
    ],
)
def test_refuses_a_senseless_load(build, message):
    with pytest.raises(ParameterError) as refusal:
        build()
    assert str(refusal.value).startswith(message)


def test_force_of_each_load_at_a_place_and_a_time():
    loads = (
        ConstantLoad(100.0),
        SpringLoad(1e3, 0.1),
        MassOnSlope(10.0, math.radians(90.0)),
        LoadSeries((1.0, 2.0), (0.0, 50.0)),
    )
    forces = [load.force_at(0.3, 1.5) for load in loads]
    assert forces == pytest.approx([100.0, 200.0, 98.0665, 25.0])
    assert PlantOptions(loads=loads).load_at(0.3, 1.5) == pytest.approx(423.0665)


HOSE = Line(length=0.1, inner=0.0125, bulk_modulus=850e6, viscosity=46e-6)
LINED = {"line_a": HOSE, "line_b": replace(HOSE, length=0.2)}
STEP = 5e-5


def plant(kind, solver, *loads):
    options = replace(PlantOptions.bench(), loads=loads)
    if kind == "reduced":
        return ReducedOrderPlant(paper_parameters(), options=options, solver=solver, dt=STEP)
    extra = LINED if kind == "lined" else {"C_LA": 1e-13}
    options = replace(options, **extra)
    return FullOrderPlant(paper_parameters(), options=options, solver=solver, dt=STEP)


CASES = [("lined", Solver.LINEARLY_IMPLICIT_MIDPOINT)]
CASES += [(kind, solver) for kind in ("reduced", "extended") for solver in Solver]


@pytest.mark.parametrize(("kind", "solver"), CASES)
def test_a_load_of_the_options_acts_as_one_from_outside(kind, solver):
    inside, free = plant(kind, solver, ConstantLoad(4e3)), plant(kind, solver)
    outside = type(free)(
        paper_parameters(), options=free.options, solver=solver, state=inside.state, dt=STEP
    )
    for _ in range(10):
        assert inside.step(PlantInput(6e-4), 4) == outside.step(PlantInput(6e-4, 4e3), 4)


@pytest.mark.parametrize(("kind", "solver"), CASES)
def test_a_series_acts_from_its_time_on(kind, solver):
    """Nothing for 10.5 steps, then a force at once; a step before that it has no effect."""
    jump = 10.5 * STEP
    series = plant(kind, solver, LoadSeries((jump, jump), (0.0, 9e3)))
    free = plant(kind, solver, LoadSeries((jump,), (0.0,)))
    for _ in range(10):
        assert series.step(PlantInput(6e-4)) == free.step(PlantInput(6e-4))
    later = series.step(PlantInput(6e-4), 3), free.step(PlantInput(6e-4), 3)
    assert later[0].v < later[1].v - 1e-3


STOP = (0.2, 2e8, 2e4)
NO_STOP = (math.inf, 0.0, 0.0)


def test_contact_pushes_and_never_pulls():
    expected = {
        (0.0, 1.0): 0.0,
        (0.2, 1.0): 0.0,
        (0.2001, 0.0): -2e4,  # 2e8 N/m * 0.1 mm
        (0.2001, 0.1): -2.2e4,  # and 2e4 N s/m * 0.1 m/s more on the way in
        (0.2001, -0.1): -1.8e4,
        (0.2001, -2.0): 0.0,  # moving out faster than the spring follows: no pull
        (-0.2001, 0.0): 2e4,
        (-0.2001, -0.1): 2.2e4,
        (-0.2001, 2.0): 0.0,
    }
    assert {(x, v): stop_force(x, v, STOP) for x, v in expected} == pytest.approx(
        expected, rel=1e-9
    )


def test_no_stop_no_force():
    assert stop_force(1e9, 1.0, NO_STOP) == 0.0
    assert stop_velocity_change(0.1, 2e5, 1e9, 1.0, 1e-4, NO_STOP) == (0.1, 2e5, 0.0)


@given(
    sunk_in=st.floats(-1e-3, 1e-3),
    v=st.floats(-2.0, 2.0),
    side=st.sampled_from([-1.0, 1.0]),
    m=st.floats(1.0, 1000.0),
    dt=st.floats(1e-5, 1e-3),
)
def test_a_free_mass_never_gains_energy_from_the_stop(sunk_in, v, side, m, dt):
    position, stiffness, _ = STOP
    x = side * (position + sunk_in)
    dv, _, _ = stop_velocity_change(0.0, m / dt, x, v, dt, STOP)
    x_after, v_after = x + dt * (v + 0.5 * dv), v + dv

    def energy(x, v):
        return 0.5 * m * v * v + 0.5 * stiffness * max(abs(x) - position, 0.0) ** 2

    assert energy(x_after, v_after) <= energy(x, v) * (1.0 + 1e-12) + 1e-12
    assert side * dv <= 0.0  # away from the stop, or nothing


points = st.lists(
    st.tuples(st.floats(0.0, 10.0), st.floats(-1e5, 1e5)), min_size=1, max_size=8
).map(lambda pairs: sorted(pairs, key=lambda pair: pair[0]))


@given(points=points, times=st.lists(st.floats(-1.0, 11.0), max_size=10).map(sorted))
def test_a_series_is_linear_between_its_points(points, times):
    row = np.array(points).ravel()
    point, last = 0, len(row) - 2
    for t in times:
        point = find_point(row, point, last, t)
        expected = float(np.interp(t, row[::2], row[1::2]))
        if np.all(np.diff(row[::2]) > 1e-6):
            assert series_force(row, point, last, t) == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_two_points_at_one_time_are_a_step():
    row = np.array([0.0, 10.0, 1.0, 10.0, 1.0, 50.0, 2.0, 70.0])

    def force(t):
        return series_force(row, find_point(row, 0, 6, t), 6, t)

    assert [force(t) for t in (-1.0, 0.5, 1.0, 1.5, 9.0)] == [10.0, 10.0, 50.0, 60.0, 70.0]
    assert force(1.0 - 1e-9) == pytest.approx(10.0)


def test_a_step_has_the_series_force_of_its_start_its_middle_and_its_end():
    # From 0 N up to 100 N in 1 s, and down to 0 N at once: 1 s lies in the middle of the step.
    row = np.array([0.0, 0.0, 1.0, 100.0, 1.0, 0.0])
    point, forces = step_loads(row, 0, 4, 0.9, 0.2)
    assert forces == pytest.approx((90.0, 0.0, 0.0), abs=1e-9)
    assert point == 4
