import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.plants.hydraulic_cylinder.model.friction import (
    bend,
    friction_force,
    linearise_friction,
    resist,
    settle,
    slip_rate,
)

# (F_c, F_s - F_c, sigma, log chi, delta, gain), Table I and section IV-B
PAPER = (600.0, 300.0, 2000.0, math.log(0.02), 0.8, 400.0)
SIGN = (*PAPER[:5], math.inf)


def as_printed(v):
    """Eq. (13) with tanh(400 v) for the sign."""
    stribeck = 600.0 + 300.0 * math.exp(-((abs(v) / 0.02) ** 0.8))
    return math.tanh(400.0 * v) * stribeck + 2000.0 * v


@given(v=st.floats(-10.0, 10.0))
def test_is_the_printed_curve(v):
    assert friction_force(v, PAPER) == pytest.approx(as_printed(v), rel=1e-9, abs=1e-9)


def test_points_by_hand():
    # At |v| = chi the Stribeck part is down to 1/e; tanh(8) = 0.99999977.
    assert friction_force(0.02, PAPER) == pytest.approx(600.0 + 300.0 / math.e + 40.0, rel=1e-6)
    assert friction_force(1.0, PAPER) == pytest.approx(2600.0, rel=1e-6)
    assert friction_force(0.0, PAPER) == 0.0


def test_slope_at_rest():
    # 400 F_s + sigma = 3.62e5 N s/m
    secant, tangent = linearise_friction(0.0, PAPER)
    assert secant == pytest.approx(3.62e5, rel=1e-6)
    assert tangent == pytest.approx(3.62e5, rel=1e-6)


def test_stribeck_curve_falls_between_6_and_38_mm_per_s():
    # The known range of stick-slip at Table I: from 6.3 mm/s up to 37 mm/s and a fraction.
    slopes = {mm: linearise_friction(mm * 1e-3, PAPER)[1] for mm in (6.2, 6.4, 37.0, 38.0)}
    assert slopes[6.2] > 0.0 > slopes[6.4]
    assert slopes[37.0] < 0.0 < slopes[38.0]


@given(v=st.floats(1e-5, 10.0), delta=st.floats(0.3, 3.0))
def test_tangent_is_the_derivative(v, delta):
    curve = (*PAPER[:4], delta, 400.0)
    step = 1e-5 * v
    slope = (friction_force(v + step, curve) - friction_force(v - step, curve)) / (2.0 * step)
    secant, tangent = linearise_friction(v, curve)
    # forces known to 1e-13 N or so, over 2e-5 v; the curve bends over lengths of v and 1 / 400
    assert slope == pytest.approx(tangent, rel=1e-5, abs=1e-6 * secant)
    assert tangent <= secant * (1.0 + 1e-9)


@given(v=st.floats(-1e6, 1e6))
def test_is_odd_and_never_drives(v):
    assert friction_force(-v, PAPER) == -friction_force(v, PAPER)
    assert friction_force(v, PAPER) * v >= 0.0


@given(v=st.floats(allow_nan=False, allow_infinity=False), delta=st.floats(1e-3, 1e3))
def test_never_raises_and_never_gives_nan(v, delta):
    secant, tangent = linearise_friction(v, (*PAPER[:4], delta, 400.0))
    assert math.isfinite(secant)
    assert math.isfinite(tangent)


def test_printed_sign():
    # Infinite gain: eq. (13) as printed, sign(0) = 0.
    assert friction_force(0.0, SIGN) == 0.0
    assert friction_force(1e-9, SIGN) == pytest.approx(900.0, rel=1e-5)
    assert friction_force(-0.02, SIGN) == pytest.approx(-(640.0 + 300.0 / math.e), rel=1e-12)
    assert math.isfinite(linearise_friction(0.0, SIGN)[1])


# (F_c, F_s - F_c, sigma, log chi, delta, gain), Table I; the gain is for the static curve alone.
FLAT = (900.0, 0.0, 0.0, math.log(0.02), 0.8, 400.0)
BRISTLES = (1e7, 2e3)
DT = 1e-4


def slide(z_f, v, time, friction, dt=DT):
    """Return z_f after some time at constant velocity."""
    for _ in range(round(time / dt)):
        bending = bend(slip_rate(v, friction, BRISTLES), dt)
        z_f = settle(z_f, v, bending, 9e-5)
    return z_f


@pytest.mark.parametrize("v", [1e-3, 0.02, -0.02, 0.3, -2.0])
def test_steady_friction_is_the_stribeck_curve_with_the_true_sign(v):
    z_f = slide(0.0, v, 5.0, PAPER)
    held, slope = resist(z_f, bend(slip_rate(v, PAPER, BRISTLES), DT), 2000.0, DT, BRISTLES)
    level = 600.0 + 300.0 * math.exp(-((abs(v) / 0.02) ** 0.8))  # eq. (13)
    assert z_f == pytest.approx(math.copysign(level / 1e7, v), rel=1e-9)
    assert held + slope * v == pytest.approx(math.copysign(level, v) + 2000.0 * v, rel=1e-9)


@pytest.mark.parametrize("dt", [1e-5, 1e-4, 1e-2])
def test_presliding_follows_the_closed_form_and_its_hysteresis(dt):
    # With a flat level F_s, dz/dx = 1 - sigma_0 z sign(v) / F_s: from rest
    # z = F_s / sigma_0 (1 - exp(-sigma_0 x / F_s)), and after turning round at z_1 by a way y
    # z = -F_s / sigma_0 + (z_1 + F_s / sigma_0) exp(-sigma_0 y / F_s), whatever the speed and dt.
    limit = 9e-5
    forth = slide(0.0, 1e-4, 0.5, FLAT, dt)
    assert forth == pytest.approx(limit * (1.0 - math.exp(-5e-5 / limit)), rel=1e-9)
    back = slide(forth, -2e-4, 0.25, FLAT, dt)
    assert back == pytest.approx(-limit + (forth + limit) * math.exp(-5e-5 / limit), rel=1e-9)
    assert back < -1e-6  # a loop: the way back does not lead through the origin


def test_bristles_at_rest_keep_their_deflection():
    assert slide(5e-5, 0.0, 100.0, PAPER, 0.1) == 5e-5
    held, _ = resist(5e-5, bend(0.0, DT), 2000.0, DT, BRISTLES)
    assert held == pytest.approx(500.0, rel=1e-12)  # 1e7 N/m * 0.05 mm


@given(rate=st.floats(0.0, 1e9), dt=st.floats(1e-6, 1e-2))
def test_bending_is_the_exact_solution(rate, dt):
    decay, reach, lag = bend(rate, dt)
    r = rate * dt
    assert decay == pytest.approx(math.exp(-r), rel=1e-12, abs=1e-300)
    if r > 1e-5:
        # From dz/dt = v - rate z with v = 1: z(dt) = (1 - exp(-r)) / rate, its mean is
        # (dt - z(dt)) / r, in which subtraction loses 1e-16 / r².
        assert reach == pytest.approx((1.0 - math.exp(-r)) / rate, rel=1e-9)
        assert lag == pytest.approx((dt - reach) / r, rel=1e-9, abs=1e-15 * dt / r**2)
    assert 0.0 <= reach <= dt * (1.0 + 1e-12)
    assert 0.0 <= lag <= 0.5 * dt * (1.0 + 1e-12)


def test_the_series_meets_the_closed_form():
    below, above = bend(99.99999, DT), bend(100.00001, DT)
    assert below == pytest.approx(above, rel=2e-7)


@given(z_f=st.floats(-9e-5, 9e-5), v=st.floats(-1e3, 1e3), other=st.floats(-1e3, 1e3))
def test_never_beyond_the_break_away(z_f, v, other):
    # Even where the bending belongs to another velocity, as at a reversal.
    bending = bend(slip_rate(other, PAPER, BRISTLES), DT)
    assert abs(settle(z_f, v, bending, 9e-5)) <= 9e-5
    held, slope = resist(z_f, bending, 2000.0, DT, BRISTLES)
    assert math.isfinite(held)
    assert slope > 0.0
