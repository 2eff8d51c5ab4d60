import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.plants.hydraulic_cylinder.model.extended_oil import charge_supply, draw
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


# 1 cm³ of oil of 1e9 Pa without gas; 1e-3 m³/s; opens at 100 bar, 2e-9 m³/(s Pa)
STIFF = (1e-15, 1e-3, 1e7, 2e-9, 0.0, 6.1e6, 1.4)
compliances = st.floats(1e-12, 1e-6)
flows = st.floats(-1e-2, 1e-2, allow_subnormal=False)  # of whose ratios few bits are left


@given(chamber=compliances, supply=compliances, share=st.floats(0.0, 1e-6), net=flows, net_S=flows)
def test_eliminating_the_supply_solves_both_rows(chamber, supply, share, net, net_S):
    # [[C + s, -s], [-s, C_S + s]] (dP, dP_S) = (net, net_S), solved as it stands
    rows = np.array([[chamber + share, -share], [-share, supply + share]])
    dP, _ = np.linalg.solve(rows, [net, net_S])
    reduced_net, reduced_share = draw(net, share, (net_S, supply))
    size = (abs(net) + abs(net_S)) / min(chamber, supply)
    assert reduced_net / (chamber + reduced_share) == pytest.approx(dP, rel=1e-6, abs=1e-6 * size)


def test_a_constant_supply_changes_nothing():
    charge = charge_supply(1e7, 5e-4, 1e-4, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert draw(1e-4, 2e-9, charge) == (1e-4, 2e-9)


@given(below=st.floats(1.0, 5e6))
def test_a_relief_valve_that_opens_in_the_step_lets_nothing_overshoot(below):
    # A closed valve: the pump alone would raise the pressure by 1e8 Pa in a step of 1e-4 s.
    net, capacity = charge_supply(1e7 - below, 0.0, 1e-4, STIFF)
    assert 1e7 < 1e7 - below + net / capacity <= 1e7 + 1e-3 / 2e-9


def test_a_shut_relief_valve_leaves_the_pump_to_the_line():
    # 1e-3 m³/s less 9e-4 m³/s into 1e-15 m³/Pa over 1e-7 s: 1e4 Pa
    net, capacity = charge_supply(9e6, 9e-4, 1e-7, STIFF)
    assert net / capacity == pytest.approx(1e4, rel=1e-9)
