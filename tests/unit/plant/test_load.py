import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.plants.hydraulic_cylinder.model.load import (
    find_point,
    series_force,
    step_loads,
    stop_force,
    stop_velocity_change,
)

STOP = (0.2, 2e8, 2e4)
NO_STOP = (math.inf, 0.0, 0.0)


@pytest.mark.parametrize(
    ("x", "v", "force"),
    [
        (0.0, 1.0, 0.0),
        (0.2, 1.0, 0.0),
        (0.2001, 0.0, -2e4),  # 2e8 N/m * 0.1 mm
        (0.2001, 0.1, -2.2e4),  # and 2e4 N s/m * 0.1 m/s more on the way in
        (0.2001, -0.1, -1.8e4),
        (0.2001, -2.0, 0.0),  # moving out faster than the spring follows: no pull
        (-0.2001, 0.0, 2e4),
        (-0.2001, -0.1, 2.2e4),
        (-0.2001, 2.0, 0.0),
    ],
)
def test_contact_pushes_and_never_pulls(x, v, force):
    assert stop_force(x, v, STOP) == pytest.approx(force, rel=1e-9)


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
