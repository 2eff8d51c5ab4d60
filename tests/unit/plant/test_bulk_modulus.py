import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.plants.hydraulic_cylinder.model.chamber import (
    bulk_modulus,
    chamber_volumes,
    net_flows,
)

E = 1.5e9
ATMOSPHERE = 101_325.0
ratios = st.floats(1e-6, 1.0)
exponents = st.floats(1.0, 2.0)


def volume(p, at, ratio, n):
    """Volume at absolute pressure p of oil that has the volume 1 at `at`, and of its air."""
    return 1.0 - (p - at) / E + ratio * (ATMOSPHERE / p) ** (1.0 / n)


@given(p=st.floats(2e3, 5e7), ratio=ratios, n=exponents)
def test_is_minus_v_dp_dv_of_oil_beside_gas(p, ratio, n):
    step = 1e-3 * p
    fall = (volume(p - step, p, ratio, n) - volume(p + step, p, ratio, n)) / (2.0 * step)
    assert bulk_modulus(p - ATMOSPHERE, E, (ratio, n)) == pytest.approx(
        volume(p, p, ratio, n) / fall, rel=1e-5
    )


def test_one_percent_of_air_by_hand():
    # At atmospheric pressure r = 1/99, n = 1.4: 1.5e9 (100/99) / (1 + 1.5e9 / (99 * 141855))
    expected = 1.5e9 * (100 / 99) / (1.0 + 1.5e9 / (99.0 * 1.4 * 101_325.0))
    assert expected == pytest.approx(1.4053e7, rel=1e-4)
    assert bulk_modulus(0.0, E, (1.0 / 99.0, 1.4)) == pytest.approx(expected, rel=1e-12)


def test_no_air_no_change():
    assert bulk_modulus(-1e9, E, (0.0, 1.4)) == E


def test_high_pressure_squeezes_the_air_away():
    assert bulk_modulus(1e12, E, (0.01, 1.0)) == pytest.approx(E, rel=1e-5)


def test_near_vacuum_it_is_the_modulus_of_the_gas():
    # n p at 2 kPa absolute, with r = 0.5 * 101.325 / 2 = 25 times as much gas as oil
    p = 2000.0
    r = 0.5 * ATMOSPHERE / p
    assert bulk_modulus(p - ATMOSPHERE, E, (0.5, 1.0)) == pytest.approx(p * (1 + r) / r, rel=1e-5)


@given(pressure=st.floats(-1e12, 1e12), ratio=ratios, n=exponents)
def test_is_finite_and_positive_everywhere(pressure, ratio, n):
    value = bulk_modulus(pressure, E, (ratio, n))
    assert math.isfinite(value)
    assert 0.0 < value <= E * (1.0 + ratio)


@given(pressure=st.floats(-101e3, 1e8), ratio=ratios, n=exponents)
def test_rises_with_the_pressure(pressure, ratio, n):
    lower = bulk_modulus(pressure, E, (ratio, n))
    assert bulk_modulus(pressure + 1e4, E, (ratio, n)) >= lower * (1.0 - 1e-12)


TABLE_I = (1e8, 0.0, 5e-3, 4.7e-3, 1.2e-3, 1.15e-3, 0.2)


@pytest.mark.parametrize(
    ("x", "V_A", "V_B"),
    [  # eqs. (10), (11) by hand
        (0.0, 1.2e-3, 1.15e-3),
        (0.1, 1.7e-3, 0.68e-3),
        (0.2, 2.2e-3, 0.21e-3),
        (0.5, 2.2e-3, 0.21e-3),
        (-0.2, 0.2e-3, 2.09e-3),
        (-9.0, 0.2e-3, 2.09e-3),
    ],
)
def test_volumes(x, V_A, V_B):
    assert chamber_volumes(x, TABLE_I) == pytest.approx((V_A, V_B), rel=1e-12)


def test_net_flows():
    # Brackets of eqs. (8), (9): 3e-4 - 5e-3 * 0.02 - 1e-5 and -2e-4 + 4.7e-3 * 0.02 + 1e-5
    net = net_flows(3e-4, -2e-4, 0.02, 1e-5, TABLE_I)
    assert net == pytest.approx((1.9e-4, -9.6e-5), rel=1e-12)
