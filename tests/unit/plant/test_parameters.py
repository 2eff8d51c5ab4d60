import dataclasses
import math

import pytest

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import PlantParameters, paper_parameters

# Ruderman 2017, Table I.
TABLE_I = {
    "alpha": 1e-3,
    "beta": 3e-4,
    "omega_0": 1200.0,
    "xi": 0.7,
    "C_d": 0.65,
    "w": 0.02,
    "rho": 850.0,
    "E": 1e8,
    "P_S": 1e7,
    "P_T": 0.0,
    "C_L": 0.0,
    "A_A": 5e-3,
    "A_B": 4.7e-3,
    "V_A0": 1.2e-3,
    "V_B0": 1.15e-3,
    "m": 20.0,
    "F_c": 600.0,
    "F_s": 900.0,
    "sigma": 2000.0,
    "chi": 0.02,
    "delta": 0.8,
    "h": 0.2,
}


def test_paper_parameters_are_table_i():
    assert dataclasses.asdict(paper_parameters()) == TABLE_I


def test_derived_constants(paper):
    # By hand: 0.65 * 0.02 * sqrt(2 / 850); (5 + 4.7) / 2; 1.2 + 1.15; eqs. (19), (20).
    flow_coefficient = paper.K
    assert flow_coefficient == pytest.approx(6.3059e-4, rel=1e-5)
    assert paper.mean_area == pytest.approx(4.85e-3, rel=1e-15)
    assert paper.total_volume == pytest.approx(2.35e-3, rel=1e-15)
    assert paper.omega_c == pytest.approx(447.43, rel=1e-5)
    assert paper.zeta == pytest.approx(0.11175, rel=1e-4)
    assert paper.full_opening == pytest.approx(1.3e-3, rel=1e-15)


def test_poles_of_the_linear_cylinder(paper):
    # zeta omega_c = sigma / (2 m) = 50 1/s; the poles are -50 +- j 444.6 rad/s.
    assert paper.zeta * paper.omega_c == pytest.approx(50.0, rel=1e-12)
    assert paper.omega_c * math.sqrt(1.0 - paper.zeta**2) == pytest.approx(444.6, rel=1e-4)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e16, True, "1", None])
def test_refuses_what_is_no_sane_number(value):
    for symbol in TABLE_I:
        with pytest.raises(ParameterError, match=rf"^{symbol} = "):
            PlantParameters(**{**TABLE_I, symbol: value})


NOT_POSITIVE = {"beta", "P_T", "C_L", "F_c", "F_s", "sigma"}


@pytest.mark.parametrize("value", [0.0, -1.0, 1e-16])
def test_refuses_what_must_be_positive(value):
    for symbol in TABLE_I.keys() - NOT_POSITIVE:
        with pytest.raises(ParameterError, match=rf"^{symbol} = .*must be greater than 0"):
            PlantParameters(**{**TABLE_I, symbol: value})


@pytest.mark.parametrize("symbol", ["beta", "C_L", "F_c", "F_s", "sigma"])
def test_refuses_what_must_not_be_negative(symbol):
    with pytest.raises(ParameterError, match=rf"^{symbol} = -1 .*must be 0 or greater"):
        PlantParameters(**{**TABLE_I, symbol: -1.0})


@pytest.mark.parametrize("symbol", ["beta", "C_L", "F_c", "sigma"])
def test_accepts_zero_where_zero_makes_sense(symbol):
    assert getattr(PlantParameters(**{**TABLE_I, symbol: 0.0}), symbol) == 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"F_s": 599.0}, "F_s = 599 N: must be at least F_c = 600 N"),
        ({"P_T": -2e5}, "P_T = -200000 Pa: must be at least -101325 Pa, absolute vacuum"),
        ({"P_T": 1e7}, "P_S = 1e+07 Pa: must be greater than P_T = 1e+07 Pa"),
        ({"V_A0": 1e-3}, "V_A0 = 0.001 m³: must be greater than A_A h = 0.001 m³"),
        ({"V_B0": 9e-4}, "V_B0 = 0.0009 m³: must be greater than A_B h = 0.00094 m³"),
    ],
)
def test_refuses_contradictions(change, message):
    with pytest.raises(ParameterError) as refusal:
        PlantParameters(**{**TABLE_I, **change})
    assert str(refusal.value).startswith(message)


def test_message_names_symbol_value_unit_and_what_would_be_right():
    with pytest.raises(ParameterError) as refusal:
        PlantParameters(**{**TABLE_I, "m": -20})
    assert str(refusal.value) == "m = -20 kg: must be greater than 0"


def test_a_larger_rod_side_is_accepted():
    swapped = {**TABLE_I, "A_A": 4.7e-3, "A_B": 5e-3, "V_B0": 1.2e-3}
    assert PlantParameters(**swapped).A_B == 5e-3


def test_is_frozen(paper):
    with pytest.raises(dataclasses.FrozenInstanceError):
        paper.m = 1.0
