import pytest

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import EntrainedAir, LuGreFriction, SupplyUnit


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
