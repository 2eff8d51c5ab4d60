import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.plants.hydraulic_cylinder.model.extended_oil import charge_supply, draw

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
