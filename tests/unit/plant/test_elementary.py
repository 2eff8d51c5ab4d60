"""exp, log and tanh against the C library's, which err by a unit of the last place at most."""

import math

import numpy as np
import pytest

from hil_bench.plants.hydraulic_cylinder.model import elementary

EPSILON = 2.0**-52


def largest_error(function, peer, points):
    """Return the largest relative error, in units of the last place."""
    return max(abs(function(x) / peer(x) - 1.0) / EPSILON for x in points)


def test_exp_is_right_to_two_units_of_the_last_place():
    points = [*np.linspace(-699.0, 709.0, 20_001), *np.linspace(-1.0, 1.0, 20_001)]
    assert largest_error(elementary.exp, math.exp, points) <= 2.0
    assert elementary.exp(0.0) == 1.0


def test_exp_of_what_is_too_small_is_all_but_nothing():
    for x in (-700.0, -1100.0, -1e300, -math.inf):
        assert elementary.exp(x) == pytest.approx(math.exp(-700.0))


def test_log_is_right_to_two_units_of_the_last_place():
    points = [*np.logspace(-300, 300, 20_001), *np.linspace(0.01, 4.0, 20_001)]
    points = [x for x in points if x != 1.0]
    assert largest_error(elementary.log, math.log, points) <= 2.0
    assert elementary.log(1.0) == 0.0


def test_tanh_is_right_to_four_units_of_the_last_place_down_to_zero():
    points = [*np.logspace(-15, 3, 40_001)]
    assert largest_error(elementary.tanh, math.tanh, points) <= 4.0
    assert elementary.tanh(0.0) == 0.0
    assert elementary.tanh(math.inf) == 1.0


@pytest.mark.parametrize("x", [5e-300, 0.5, math.sqrt(0.5), 0.7071067811865475, 1.0, 3.0, 1e300])
def test_split_loses_nothing(x):
    m, k = elementary.split(x)
    assert math.ldexp(m, int(k)) == x
    assert math.sqrt(0.5) <= m < math.sqrt(2.0) * (1.0 + EPSILON)


def test_what_is_no_number_stays_none():
    assert math.isnan(elementary.tanh(math.nan))
    assert math.isnan(elementary.exp(math.nan))
