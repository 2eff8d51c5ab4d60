import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.plants.hydraulic_cylinder.model.supply import relief_flow, supply_compliance

# 0.5 l of oil of 1e8 Pa; 1e-3 m³/s; opens at 100 bar, 2e-9 m³/(s Pa); 1 l of gas at 61 bar absolute
UNIT = (5e-12, 1e-3, 1e7, 2e-9, 1e-3, 6.101325e6, 1.4)


@given(P_S=st.floats(6.1e6, 4e7), n=st.floats(1.0, 2.0))
def test_compliance_is_the_slope_of_the_gas_volume(P_S, n):
    unit = (*UNIT[:6], n)

    def gas(P_S):
        return 1e-3 * (6.101325e6 / (P_S + 101_325.0)) ** (1.0 / n)

    slope = (gas(P_S - 100.0) - gas(P_S + 100.0)) / 200.0
    assert supply_compliance(P_S, unit) == pytest.approx(5e-12 + slope, rel=1e-6)


def test_an_empty_accumulator_leaves_the_line():
    assert supply_compliance(5.9e6, UNIT) == 5e-12
    assert supply_compliance(-1e9, UNIT) == 5e-12
    assert supply_compliance(6.1e6, UNIT) > 1e-10


def test_relief_valve():
    assert relief_flow(9.9e6, UNIT) == 0.0
    assert relief_flow(1e7, UNIT) == 0.0
    assert relief_flow(1.05e7, UNIT) == pytest.approx(1e-3, rel=1e-12)  # 5 bar * 2e-9


@given(P_S=st.floats(-1e15, 1e15))
def test_is_positive_and_finite_everywhere(P_S):
    assert 5e-12 <= supply_compliance(P_S, UNIT) < 1e-9
    assert math.isfinite(relief_flow(P_S, UNIT))
