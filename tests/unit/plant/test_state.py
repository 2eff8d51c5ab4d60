import math

import pytest

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import balanced_state


def test_balanced_state_holds_the_piston(paper):
    state = balanced_state(paper)
    P_A, P_B = state.P_A, state.P_B
    assert math.isclose(P_A * paper.A_A, P_B * paper.A_B, rel_tol=1e-14)
    assert math.isclose(P_A + P_B, paper.P_S, rel_tol=1e-14)
    assert state[:2] == (0.0, 0.0)
    assert state[4:] == (0.0, 0.0, 0.0, 0.0)


def test_balanced_state_at_another_place_and_pressure(paper):
    # P_A = 2 p A_B / (A_A + A_B) = 2 * 3e6 * 4.7 / 9.7
    state = balanced_state(paper, x=0.1, mean_pressure=3e6)
    assert state.x == 0.1
    assert state[2:4] == pytest.approx((2.907216e6, 3.092784e6), rel=1e-6)


def test_balanced_state_under_a_load(paper):
    state = balanced_state(paper, F_L=4e3)
    assert state.P_A * paper.A_A - state.P_B * paper.A_B == pytest.approx(4e3, rel=1e-9)
    assert state.P_A + state.P_B == pytest.approx(paper.P_S, rel=1e-12)


def test_balanced_state_refuses_nan(paper):
    with pytest.raises(ParameterError, match=r"^mean_pressure = nan Pa"):
        balanced_state(paper, mean_pressure=math.nan)
    with pytest.raises(ParameterError, match=r"^x = inf m"):
        balanced_state(paper, x=math.inf)
    with pytest.raises(ParameterError, match=r"^F_L = inf N"):
        balanced_state(paper, F_L=math.inf)
