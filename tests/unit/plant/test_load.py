import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.plant.load import stop_force, stop_velocity_change

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
def test_contact_pushes_and_never_pulls(x: float, v: float, force: float) -> None:
    assert stop_force(x, v, STOP) == pytest.approx(force, rel=1e-9)


def test_no_stop_no_force() -> None:
    assert stop_force(1e9, 1.0, NO_STOP) == 0.0
    assert stop_velocity_change(0.1, 2e5, 1e9, 1.0, 1e-4, NO_STOP) == 0.1


@given(
    sunk_in=st.floats(-1e-3, 1e-3),
    v=st.floats(-2.0, 2.0),
    side=st.sampled_from([-1.0, 1.0]),
    m=st.floats(1.0, 1000.0),
    dt=st.floats(1e-5, 1e-3),
)
def test_a_free_mass_never_gains_energy_from_the_stop(
    sunk_in: float, v: float, side: float, m: float, dt: float
) -> None:
    position, stiffness, _ = STOP
    x = side * (position + sunk_in)
    dv = stop_velocity_change(0.0, m / dt, x, v, dt, STOP)
    x_after, v_after = x + dt * (v + 0.5 * dv), v + dv

    def energy(x: float, v: float) -> float:
        return 0.5 * m * v * v + 0.5 * stiffness * max(abs(x) - position, 0.0) ** 2

    assert energy(x_after, v_after) <= energy(x, v) * (1.0 + 1e-12) + 1e-12
    assert side * dv <= 0.0  # away from the stop, or nothing
