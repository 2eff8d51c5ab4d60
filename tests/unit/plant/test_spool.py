import cmath
import math

import pytest

from hil_bench.plants.hydraulic_cylinder.model.spool import (
    drive_spool,
    move_spool,
    orifice_state,
    spool_transition,
)

TABLE_I = (1e-3, 3e-4, 1e-3, 3e-4)  # alpha and beta, the same for both directions


def step_response(t, omega, xi):
    """Textbook step response of a second-order lag from rest."""
    root = cmath.sqrt(xi * xi - 1.0)
    fast, slow = -omega * (xi + root), -omega * (xi - root)
    value = 1.0 + (fast * cmath.exp(slow * t) - slow * cmath.exp(fast * t)) / (slow - fast)
    return value.real


@pytest.mark.parametrize("xi", [0.1, 0.7, 0.999, 1.001, 3.0])
@pytest.mark.parametrize("dt", [1e-5, 1e-4, 1e-3])
def test_is_exact_at_every_step_size(xi, dt):
    transition = spool_transition(1200.0, xi, dt)
    nu, nu_dot = 0.0, 0.0
    for step in range(1, 51):
        nu, nu_dot = move_spool(nu, nu_dot, 1.0, transition)
        assert nu == pytest.approx(step_response(step * dt, 1200.0, xi), abs=1e-10)


def test_critical_damping():
    # Step response 1 - exp(-omega t) (1 + omega t) at omega t = 1.2.
    nu, nu_dot = move_spool(0.0, 0.0, 1.0, spool_transition(1200.0, 1.0, 1e-3))
    assert nu == pytest.approx(1.0 - math.exp(-1.2) * 2.2, rel=1e-12)
    assert nu_dot == pytest.approx(1200.0 * 1.2 * math.exp(-1.2), rel=1e-12)


def test_the_speed_is_limited_and_small_steps_are_not():
    """A far set-point drives the spool at 50 mm/s; 2 um are within the reach of 2 xi v / omega."""
    free, limited = (spool_transition(1200.0, 0.7, 1e-4, speed) for speed in (None, 0.05))
    fast = slow = (0.0, 0.0)
    for _ in range(100):
        fast, slow = move_spool(*fast, 1e-3, free), move_spool(*slow, 1e-3, limited)

    assert slow[1] == pytest.approx(0.05, rel=2e-3)
    assert slow[0] < 0.6 * fast[0]
    assert move_spool(0.0, 0.0, 2e-6, limited) == move_spool(0.0, 0.0, 2e-6, free)


def test_the_acceleration_is_that_of_the_step():
    """Runge-Kutta and Euler integrate what the exact step does in a short time."""
    spool = (1200.0**2, 2.0 * 0.7 * 1200.0, 2.0 * 0.7 * 0.05 / 1200.0)
    for nu, nu_dot, u in ((0.0, 0.0, 1e-3), (1e-3, 0.01, 0.0), (0.0, 0.02, 1e-5)):
        _, after = move_spool(nu, nu_dot, u, spool_transition(1200.0, 0.7, 1e-8, 0.05))
        assert drive_spool(nu, nu_dot, u, spool) == pytest.approx((after - nu_dot) / 1e-8, rel=1e-4)


def test_stiff_overdamped_spool_stays_finite():
    nu, nu_dot = move_spool(0.0, 0.0, 1.0, spool_transition(1e6, 50.0, 1.0))
    assert nu == pytest.approx(1.0)
    assert nu_dot == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("nu", "z"),
    [  # eq. (2) with Table I
        (0.0, 0.0),
        (2.9e-4, 0.0),
        (-2.9e-4, 0.0),
        (3e-4, 0.0),
        (4e-4, 1e-4),
        (-4e-4, -1e-4),
        (1e-3, 0.7e-3),
        (1.3e-3, 1e-3),
        (-1.3e-3, -1e-3),
        (5.0, 1e-3),
        (-5.0, -1e-3),
    ],
)
def test_dead_zone_and_saturation(nu, z):
    assert orifice_state(nu, TABLE_I) == pytest.approx(z, rel=1e-12, abs=1e-18)


@pytest.mark.parametrize(
    ("nu", "z"),
    [  # eq. (2) with alpha 1.0 mm, beta 0.3 mm for nu > 0 and alpha 0.6 mm, beta 0.5 mm for nu < 0
        (3e-4, 0.0),
        (5e-4, 2e-4),
        (2e-3, 1e-3),
        (-3e-4, 0.0),
        (-5e-4, 0.0),
        (-7e-4, -2e-4),
        (-1.1e-3, -6e-4),
        (-2e-3, -6e-4),
    ],
)
def test_each_direction_may_have_its_own_dead_zone_and_saturation(nu, z):
    assert orifice_state(nu, (1e-3, 3e-4, 6e-4, 5e-4)) == pytest.approx(z, rel=1e-12, abs=1e-18)
