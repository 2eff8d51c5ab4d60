"""A plant whose supply pressure changes goes on as one that was made with the new one."""

import math
from dataclasses import replace

import numpy as np
import pytest

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
