import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import implicit_share

rates = st.floats(1e-3, 1e6)


def factor(secant, tangent):
    """y after a step of dy/dt = -secant y, from y = 1, with inertia 1."""
    return 1.0 - secant / (1.0 + implicit_share(secant, tangent, 1.0))


@given(rate=rates)
def test_linear_decay_never_overshoots(rate):
    assert 0.0 <= factor(rate, rate) < 1.0


@given(rate=rates)
def test_decay_by_a_root_hardly_overshoots(rate):
    # dy/dt = -b sqrt(y): the secant at y = 1 is b, the tangent b / 2.
    assert -0.06 < factor(rate, 0.5 * rate) < 1.0


@pytest.mark.parametrize(
    ("tangent_of", "exact"),
    [
        (1.0, lambda a: math.exp(-a)),  # dy/dt = -a y
        (0.5, lambda a: (1.0 - a / 2.0) ** 2),  # dy/dt = -a sqrt(y)
    ],
)
def test_one_step_is_right_to_second_order(tangent_of, exact):
    errors = [abs(factor(a, tangent_of * a) - exact(a)) for a in (0.04, 0.02, 0.01)]
    for coarse, fine in itertools.pairwise(errors):
        assert coarse / fine > 7.0  # third order in one step


def test_stiff_limit_is_backward_euler_on_the_secant():
    assert implicit_share(1e6, 5e5, 1.0) == 1e6
    assert factor(1e6, 1e6) == pytest.approx(1e-6, rel=1e-3)


def test_a_falling_curve_cannot_take_the_inertia_away():
    assert implicit_share(0.01, -4.0, 1.0) == -0.25
    assert implicit_share(0.01, -0.1, 1.0) == pytest.approx(-0.05 + 0.125e-4, rel=1e-12)
