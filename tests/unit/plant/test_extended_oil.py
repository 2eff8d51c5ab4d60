"""Leakage, entrained air and the supply unit in the plant, each against its closed form."""

import dataclasses
import itertools
import math

import pytest

from hil_bench.plants.hydraulic_cylinder.model import (
    EntrainedAir,
    FullOrderPlant,
    PlantInput,
    PlantOptions,
    PlantState,
    Solver,
    SupplyUnit,
    balanced_state,
)
from hil_bench.plants.hydraulic_cylinder.model.chamber import bulk_modulus

PAPER = PlantOptions.paper()
BENCH = PlantOptions.bench()
AIR = EntrainedAir(air_fraction=0.01)


def stuck(paper, **change):
    """A piston that nothing moves."""
    return dataclasses.replace(paper, F_c=1e9, F_s=1e9, m=1e8, **change)


@pytest.mark.parametrize("solver", Solver)
def test_external_leakage_lets_a_chamber_down_to_the_tank(paper, solver):
    # P - P_T decays with C_LA E / V_A0 = 1/1.2 1/s for C_LA = 1e-11, and half of it in B.
    held = stuck(paper, P_T=1e5)
    options = dataclasses.replace(PAPER, C_LA=1e-11, C_LB=0.5e-11)
    start = PlantState(0.0, 0.0, 6e6, 4e6, 0.0, 0.0)
    output = FullOrderPlant(held, options=options, solver=solver, state=start, dt=1e-4).step(
        PlantInput(0.0), 10_000
    )
    assert output.P_A - 1e5 == pytest.approx(5.9e6 * math.exp(-1.0 / 1.2), rel=1e-4)
    assert output.P_B - 1e5 == pytest.approx(3.9e6 * math.exp(-0.5 / 1.15), rel=1e-4)


@pytest.mark.parametrize("E", [1e8, 1.5e9])
def test_closed_chambers_with_air_keep_their_content(paper, E):
    # (8) without flow: d ln V = -dP / E(P), so ln V + integral of dP / E(P) stays.
    oil = dataclasses.replace(paper, E=E)

    def drift(dt):
        start = PlantState(0.0, 0.6, 1e6, 1e6, 0.0, 0.0)
        options = dataclasses.replace(PAPER, air=AIR)
        plant = FullOrderPlant(oil, options=options, state=start, dt=dt)
        before, content, farthest = start, 0.0, 0.0
        for _ in range(round(0.02 / dt)):
            plant.step(PlantInput(0.0))
            after = plant.state
            middle, rise = 0.5 * (before.P_A + after.P_A), after.P_A - before.P_A
            softness = [
                1.0 / bulk_modulus(middle + part * rise, E, (AIR.ratio, 1.4))
                for part in (-0.5, 0.0, 0.5)
            ]
            content += rise * (softness[0] + 4.0 * softness[1] + softness[2]) / 6.0  # Simpson
            before = after
            farthest = max(farthest, oil.A_A * abs(after.x) / oil.V_A0)
        volume = math.log((oil.V_A0 + oil.A_A * before.x) / oil.V_A0)
        assert farthest > 1e-3
        return abs(volume + content) / farthest

    coarse, fine = drift(1e-4), drift(5e-5)
    assert coarse < 1e-2
    assert 3.0 < coarse / fine < 5.0  # second order


def test_air_makes_the_cylinder_softer(paper):
    # A frictionless piston on closed chambers at 5 bar: w² = (E_A A_A²/V_A + E_B A_B²/V_B) / m.
    oil = dataclasses.replace(paper, E=1.5e9, F_c=0.0, F_s=0.0, sigma=0.0)
    start = balanced_state(oil, mean_pressure=5e5)._replace(v=1e-4)
    plant = FullOrderPlant(oil, options=dataclasses.replace(PAPER, air=AIR), state=start, dt=1e-5)
    velocities = [plant.step(PlantInput(0.0)).v for _ in range(20_000)]
    turns = [i for i, (a, b) in enumerate(itertools.pairwise(velocities)) if a > 0.0 >= b]
    period = (turns[-1] - turns[0]) / (len(turns) - 1) * 1e-5
    air = (AIR.ratio, 1.4)
    stiffness = (
        bulk_modulus(start.P_A, 1.5e9, air) * oil.A_A**2 / oil.V_A0
        + bulk_modulus(start.P_B, 1.5e9, air) * oil.A_B**2 / oil.V_B0
    )
    assert 2.0 * math.pi / period == pytest.approx(math.sqrt(stiffness / oil.m), rel=2e-3)


@pytest.mark.parametrize("solver", Solver)
def test_with_air_a_pull_stays_above_vacuum(paper, solver):
    options = dataclasses.replace(BENCH, air=EntrainedAir(air_fraction=0.05))
    plant = FullOrderPlant(paper, options=options, solver=solver)
    pressures = [plant.step(PlantInput(1e-3, -6e4), 10).P_A for _ in range(300)]
    assert -101_325.0 < min(pressures) < -1e4
    plant = FullOrderPlant(paper, options=options, solver=solver)
    pressures = [plant.step(PlantInput(-1e-3, 6e4), 10).P_B for _ in range(300)]
    assert -101_325.0 < min(pressures) < -1e4


@pytest.mark.parametrize("solver", Solver)
def test_a_pump_fills_the_accumulator(paper, solver):
    # Isothermal, from precharge: oil Q t in the accumulator leaves V_0 - Q t to the gas, so
    # p = p_0 V_0 / (V_0 - Q t); a line of 1 cm³ hardly counts.
    unit = SupplyUnit(
        pump_flow=1e-4,
        relief_pressure=3e7,
        line_volume=1e-6,
        gas_exponent=1.0,
        precharge_pressure=6e6 - 101_325.0,
    )
    weak = dataclasses.replace(paper, P_S=6e6 - 101_325.0 + 1.0)  # not empty
    plant = FullOrderPlant(
        weak, options=dataclasses.replace(PAPER, supply=unit), solver=solver, dt=1e-4
    )
    plant.step(PlantInput(0.0), 40_000)
    assert plant.extension.P_S + 101_325.0 == pytest.approx(6e6 / (1.0 - 0.4), rel=1e-3)


@pytest.mark.parametrize("solver", Solver)
def test_an_idle_pump_runs_over_the_relief_valve(paper, solver):
    # 1e-3 m³/s through 2e-9 m³/(s Pa): 5 bar above the 100 bar at which it opens.
    options = dataclasses.replace(BENCH, supply=SupplyUnit())
    plant = FullOrderPlant(paper, options=options, solver=solver)
    plant.step(PlantInput(0.0), 20_000)
    assert plant.extension.P_S == pytest.approx(1.05e7, rel=1e-6)


@pytest.mark.parametrize("solver", Solver)
def test_the_pump_limits_the_speed(paper, solver):
    # A third of the flow that this opening wants: v = Q_P / A_A = 0.0667 m/s out, Q_P / A_B in.
    unit = SupplyUnit(pump_flow=1e-3 / 3.0, accumulator_volume=0.0)
    options = dataclasses.replace(BENCH, supply=unit)
    for u, area, x in ((1e-3, paper.A_A, -0.1), (-1e-3, paper.A_B, 0.1)):
        start = balanced_state(paper, x=x)
        plant = FullOrderPlant(paper, options=options, solver=solver, state=start, dt=1e-4)
        output = plant.step(PlantInput(u), 20_000)
        assert abs(output.v) == pytest.approx(unit.pump_flow / area, rel=1e-3)
        assert plant.extension.P_S < 0.3 * paper.P_S


def test_the_pumps_oil_is_all_somewhere(paper):
    # Pump, relief valve and cylinder against what line and accumulator hold, to second order.
    unit = SupplyUnit(gas_exponent=1.0)
    options = dataclasses.replace(BENCH, supply=unit)

    def held(P_S):
        gas = unit.accumulator_volume * (unit.precharge_pressure + 101_325.0) / (P_S + 101_325.0)
        return unit.line_volume * P_S / paper.E + unit.accumulator_volume - gas

    def lost(dt):
        plant = FullOrderPlant(paper, options=options, dt=dt)
        balance, drawn = -held(plant.extension.P_S), 0.0
        for step in range(round(0.4 / dt)):
            before = (plant.output, plant.extension.P_S)
            plant.step(PlantInput(1.2e-3 if step * dt < 0.2 else -1.2e-3))
            for output, P_S in (before, (plant.output, plant.extension.P_S)):
                flow = output.Q_A if output.z > 0.0 else output.Q_B
                drawn += 0.5 * dt * flow
                relief = unit.relief_gradient * max(P_S - unit.relief_pressure, 0.0)
                balance += 0.5 * dt * (flow + relief - unit.pump_flow)
        return abs(balance + held(plant.extension.P_S)) / drawn

    coarse, fine = lost(1e-4), lost(5e-5)
    assert coarse < 1e-4
    assert coarse / fine > 3.0


@pytest.mark.parametrize("E", [1e8, 2e9])
@pytest.mark.parametrize("line", [1e-9, 1e-6, 1e-3])
def test_a_stiff_supply_line_does_not_ring(paper, E, line):
    unit = SupplyUnit(line_volume=line, accumulator_volume=0.0, relief_gradient=1e-7)
    oil = dataclasses.replace(paper, E=E)
    plant = FullOrderPlant(oil, options=dataclasses.replace(BENCH, supply=unit))
    plant.step(PlantInput(1e-3), 5_000)
    pressures = []
    for _ in range(100):
        plant.step(PlantInput(1e-3))
        pressures.append(plant.extension.P_S)
    bends = [
        c - 2.0 * b + a for a, b, c in zip(pressures, pressures[1:], pressures[2:], strict=False)
    ]
    assert max(map(abs, bends)) < 10.0
    plant.step(PlantInput(0.0), 2_000)
    assert plant.extension.P_S == pytest.approx(1e7 + 1e-3 / 1e-7, rel=1e-6)
