import cmath
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.plants.hydraulic_cylinder.model.orifice import linearise_flow, port_flow
from hil_bench.plants.hydraulic_cylinder.model.spool import (
    drive_spool,
    move_spool,
    orifice_state,
    spool_transition,
)

K, P_S, P_T = 6.3059e-4, 1e7, 2e5
PRINTED = (K, P_S, P_T, 0.0, 1.0)
CLAMPED = (K, P_S, P_T, 0.0, 0.0)
LAMINAR = (K, P_S, P_T, 300.0**2, 1.0)

openings = st.floats(1e-6, 1e-3)
pressures = st.floats(-1e7, 3e7)


@pytest.mark.parametrize(
    ("z", "P_A", "P_B", "Q_A", "Q_B"),
    [
        # z > 0: z K sqrt(P_S - P_A) into A, z K sqrt(P_B - P_T) out of B
        (1e-3, 6e6, 4.2e6, 1e-3 * K * 2000.0, -1e-3 * K * 2000.0),
        # z < 0: out of A to the tank, from the supply into B
        (-1e-3, 4.2e6, 6e6, -1e-3 * K * 2000.0, 1e-3 * K * 2000.0),
        (0.0, 4.2e6, 6e6, 0.0, 0.0),
        # overload: the pressure drop is negative and the flow turns round
        (1e-3, P_S + 4e6, P_T - 4e6, -1e-3 * K * 2000.0, 1e-3 * K * 2000.0),
        (-1e-3, P_T - 4e6, P_S + 4e6, 1e-3 * K * 2000.0, -1e-3 * K * 2000.0),
    ],
)
def test_flows_as_printed(z, P_A, P_B, Q_A, Q_B):
    assert port_flow(z, P_A, PRINTED) == pytest.approx(Q_A, rel=1e-12)
    assert port_flow(-z, P_B, PRINTED) == pytest.approx(Q_B, rel=1e-12)


def test_clamped_root_stops_the_flow():
    assert port_flow(1e-3, P_S + 1.0, CLAMPED) == 0.0
    assert port_flow(-1e-3, P_T - 1.0, CLAMPED) == 0.0
    assert port_flow(1e-3, P_S - 4e6, CLAMPED) == port_flow(1e-3, P_S - 4e6, PRINTED)


@pytest.mark.parametrize("orifice", [PRINTED, CLAMPED, LAMINAR])
def test_no_drop_no_flow(orifice):
    assert port_flow(1e-3, P_S, orifice) == 0.0


def test_laminar_transition():
    # dp / (dp² + p_tr²)^(1/4): linear with 1 / sqrt(p_tr) well below, the root well above.
    small = port_flow(1e-3, P_S - 0.3, LAMINAR)
    assert small == pytest.approx(1e-3 * K * 0.3 / math.sqrt(300.0), rel=1e-6)
    large = port_flow(1e-3, P_S - 1e6, LAMINAR)
    assert large == pytest.approx(1e-3 * K * 1e3, rel=1e-7)


@given(opening=openings, pressure=pressures, sign=st.sampled_from([-1.0, 1.0]))
def test_tangent_and_secant(opening, pressure, sign):
    opening *= sign
    flow, secant, tangent = linearise_flow(opening, pressure, LAMINAR)
    step = 1e-2
    rise = port_flow(opening, pressure + step, LAMINAR) - port_flow(
        opening, pressure - step, LAMINAR
    )
    drop = P_S - pressure if opening > 0.0 else pressure - P_T
    # A central difference over 2e-2 Pa of flows known to 1e-16 of the largest, 2e-3 m³/s.
    assert -rise / (2.0 * step) == pytest.approx(tangent, rel=1e-5, abs=1e-16)
    assert abs(flow) == pytest.approx(secant * abs(drop), rel=1e-12)
    assert 0.0 <= tangent <= secant * (1.0 + 1e-12)


@given(opening=openings, drop=st.floats(0.0, 1e7))
def test_flow_turns_round_with_the_drop(opening, drop):
    forward = port_flow(opening, P_S - drop, LAMINAR)
    backward = port_flow(opening, P_S + drop, LAMINAR)
    assert forward == pytest.approx(-backward, rel=1e-6, abs=1e-18)
    assert forward >= 0.0


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


def test_dead_zone_and_saturation():
    expected = {  # eq. (2) with Table I
        0.0: 0.0,
        2.9e-4: 0.0,
        -2.9e-4: 0.0,
        3e-4: 0.0,
        4e-4: 1e-4,
        -4e-4: -1e-4,
        1e-3: 0.7e-3,
        1.3e-3: 1e-3,
        -1.3e-3: -1e-3,
        5.0: 1e-3,
        -5.0: -1e-3,
    }
    assert {nu: orifice_state(nu, TABLE_I) for nu in expected} == pytest.approx(
        expected, rel=1e-12, abs=1e-18
    )


def test_each_direction_may_have_its_own_dead_zone_and_saturation():
    # eq. (2) with alpha 1.0 mm, beta 0.3 mm for nu > 0 and alpha 0.6 mm, beta 0.5 mm for nu < 0
    expected = {
        3e-4: 0.0,
        5e-4: 2e-4,
        2e-3: 1e-3,
        -3e-4: 0.0,
        -5e-4: 0.0,
        -7e-4: -2e-4,
        -1.1e-3: -6e-4,
        -2e-3: -6e-4,
    }
    assert {nu: orifice_state(nu, (1e-3, 3e-4, 6e-4, 5e-4)) for nu in expected} == pytest.approx(
        expected, rel=1e-12, abs=1e-18
    )
