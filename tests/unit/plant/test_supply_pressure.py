"""A plant whose supply pressure changes goes on as one that was made with the new one."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import (
    EntrainedAir,
    FullOrderPlant,
    PlantInput,
    PlantOptions,
    PlantState,
    ReducedOrderPlant,
    Solver,
    SupplyUnit,
    balanced_state,
    paper_parameters,
)
from hil_bench.plants.hydraulic_cylinder.model.reduced_order import balanced_reduced_state
from hil_bench.plants.hydraulic_cylinder.model.supply import relief_flow, supply_compliance

P = paper_parameters()
LOW = replace(P, P_S=6e6)
OPEN = PlantInput(8e-4)
BENCH = PlantOptions.bench()


@pytest.mark.parametrize("options", [BENCH, replace(BENCH, air=EntrainedAir(air_fraction=0.01))])
def test_the_full_order_plant_goes_on_at_the_new_pressure(options):
    state = balanced_state(LOW)
    changed = FullOrderPlant(P, options=options, state=state)
    assert changed.supply_pressure == P.P_S
    changed.supply_pressure = LOW.P_S
    assert changed.supply_pressure == LOW.P_S
    expected = FullOrderPlant(LOW, options=options, state=state)
    assert changed.step(OPEN, 500) == expected.step(OPEN, 500)


@pytest.mark.parametrize("u", [8e-4, -8e-4])
def test_the_reduced_plant_goes_on_at_the_new_pressure(u):
    low = balanced_reduced_state(LOW)
    start = balanced_reduced_state(P)
    changed = ReducedOrderPlant(P, state=start)
    assert changed.supply_pressure == P.P_S
    changed.supply_pressure = LOW.P_S
    assert changed.supply_pressure == LOW.P_S
    expected = ReducedOrderPlant(LOW, state=PlantState(*low))
    seen, right = (each.step(PlantInput(u), 500) for each in (changed, expected))
    np.testing.assert_allclose(seen, right, rtol=1e-9)


def test_a_supply_unit_fills_up_again():
    plant = FullOrderPlant(P, options=replace(BENCH, supply=SupplyUnit()))
    plant.supply_pressure = 3e6
    plant.step(PlantInput(0.0), 1)
    fallen = plant.supply_pressure
    assert fallen == pytest.approx(3e6, rel=0.05)
    plant.step(PlantInput(0.0), 30_000)  # 60 l/min for three seconds
    assert plant.supply_pressure > 9e6


@pytest.mark.parametrize("solver", Solver)
def test_a_pump_fills_a_line_as_its_oil_is_stiff(solver):
    """P' = Q E / V of the paper's oil, with the valve shut and no accumulator; then the relief."""
    unit = SupplyUnit(pump_flow=2e-4, line_volume=1e-3, accumulator_volume=0.0)
    plant = FullOrderPlant(P, options=replace(BENCH, supply=unit), solver=solver, dt=2e-5)
    plant.supply_pressure = 4e6
    plant.step(PlantInput(0.0), 100)
    assert plant.supply_pressure == pytest.approx(4e6 + 2e-4 * P.E / 1e-3 * 2e-3, rel=1e-6)
    plant.supply_pressure = 10.2e6  # 2 bar above: 4e-4 m³/s, twice what the pump gives
    plant.step(PlantInput(0.0), 1)
    fall = -2e-4 * P.E / 1e-3 * 2e-5
    assert plant.supply_pressure - 10.2e6 == pytest.approx(fall, rel=1e-2)


@pytest.mark.parametrize("pressure", [math.nan, math.inf])
def test_what_is_no_pressure_is_refused(pressure):
    for plant in (FullOrderPlant(P), ReducedOrderPlant(P)):
        with pytest.raises(ParameterError, match="supply_pressure"):
            plant.supply_pressure = pressure
        assert plant.supply_pressure == P.P_S


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
