import dataclasses
import math

import pytest

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import (
    ConstantLoad,
    EndStop,
    EntrainedAir,
    LuGreFriction,
    PlantOptions,
    SupplyUnit,
    balanced_state,
)


def test_paper_is_as_printed_with_the_tanh_of_section_iv():
    options = PlantOptions.paper()
    assert options.tanh_gain == 400.0
    assert options.end_stop is None
    assert options.cavitation_floor is None
    assert options.laminar_transition == 0.0
    assert options.signed_root


def test_bench_keeps_piston_and_pressures_where_they_can_be():
    options = PlantOptions.bench()
    assert options.end_stop == EndStop()
    assert options.cavitation_floor == -101_325.0  # standard atmosphere, as gauge pressure
    assert options.laminar_transition > 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tanh_gain": 0.0}, "tanh_gain = 0 s/m: must be greater than 0"),
        ({"tanh_gain": math.nan}, "tanh_gain = nan s/m: must be finite"),
        ({"tanh_gain": -math.inf}, "tanh_gain = -inf s/m: must be finite"),
        ({"laminar_transition": -1.0}, "laminar_transition = -1 Pa: must be 0 or greater"),
        ({"alpha_negative": 0.0}, "alpha_negative = 0 m: must be greater than 0"),
        ({"beta_negative": -1e-4}, "beta_negative = -0.0001 m: must be 0 or greater"),
        ({"cavitation_floor": 1e5}, "cavitation_floor = 100000 Pa: must be 0 or less"),
        ({"cavitation_floor": -2e5}, "cavitation_floor = -200000 Pa: must be 0 or less"),
        ({"cavitation_floor": True}, "cavitation_floor = True: must be a number in Pa"),
        ({"signed_root": "no"}, "signed_root = 'no': must be bool"),
        ({"end_stop": True}, "end_stop = True: must be EndStop or None"),
        ({"air": 0.01}, "air = 0.01: must be EntrainedAir or None"),
        ({"bristles": EndStop()}, "bristles = EndStop(stiffness=200000000.0, "),
        ({"supply": 1e7}, "supply = 10000000.0: must be SupplyUnit or None"),
        ({"loads": ConstantLoad(1.0)}, "loads = ConstantLoad(load_force=1.0): must be tuple"),
        ({"loads": (1.0,)}, "loads = 1.0: must be ConstantLoad or SpringLoad or MassOnSlope or "),
        ({"cavitation_floor": -math.inf}, "cavitation_floor = -inf Pa: must be finite"),
    ],
)
def test_refuses_senseless_options(change, message):
    with pytest.raises(ParameterError) as refusal:
        dataclasses.replace(PlantOptions.bench(), **change)
    assert str(refusal.value).startswith(message)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"stiffness": 0.0}, "stiffness of the end stop = 0 N/m: must be greater than 0"),
        ({"damping": -1.0}, "damping of the end stop = -1 N s/m: must be 0 or greater"),
    ],
)
def test_refuses_a_senseless_end_stop(change, message):
    with pytest.raises(ParameterError) as refusal:
        EndStop(**change)
    assert str(refusal.value).startswith(message)


def test_the_ratio_of_air_to_oil():
    # 1 part in 100 of the mixture is 1 part to 99 of oil.
    assert EntrainedAir(air_fraction=0.01).ratio == pytest.approx(1.0 / 99.0, rel=1e-15)


@pytest.mark.parametrize(
    ("record", "change", "message"),
    [
        (EntrainedAir, {"air_fraction": 0.0}, "air_fraction = 0: must be greater than 0"),
        (EntrainedAir, {"air_fraction": 0.6}, "air_fraction = 0.6: must be at most 0.5"),
        (
            EntrainedAir,
            {"air_fraction": 0.01, "air_exponent": 0.9},
            "air_exponent = 0.9: must be 1 (isothermal) to 2; adiabatic is 1.4",
        ),
        (LuGreFriction, {"sigma_0": 0.0}, "sigma_0 = 0 N/m: must be greater than 0"),
        (LuGreFriction, {"sigma_1": -1.0}, "sigma_1 = -1 N s/m: must be 0 or greater"),
        (SupplyUnit, {"pump_flow": -1.0}, "pump_flow = -1 m³/s: must be 0 or greater"),
        (SupplyUnit, {"relief_gradient": 0.0}, "relief_gradient = 0 m³/(s Pa): must be greater"),
        (SupplyUnit, {"line_volume": 0.0}, "line_volume = 0 m³: must be greater than 0"),
        (SupplyUnit, {"accumulator_volume": -1.0}, "accumulator_volume = -1 m³: must be 0 or"),
        (SupplyUnit, {"gas_exponent": 2.1}, "gas_exponent = 2.1: must be 1 (isothermal) to 2"),
        (
            SupplyUnit,
            {"precharge_pressure": 1e7},
            "precharge_pressure = 1e+07 Pa: must be below relief_pressure = 1e+07 Pa",
        ),
    ],
)
def test_refuses_senseless_values(record, change, message):
    with pytest.raises(ParameterError) as refusal:
        record(**change)
    assert str(refusal.value).startswith(message)


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
