import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.plants.hydraulic_cylinder.model.friction import friction_force, linearise_friction

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
