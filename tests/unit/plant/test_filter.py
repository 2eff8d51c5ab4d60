"""The filter of a supply unit against the equation of its node, and steady states by hand."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model.constants import filter_constants, supply_constants
from hil_bench.plants.hydraulic_cylinder.model.extensions import Filter, SupplyUnit, VariablePump
from hil_bench.plants.hydraulic_cylinder.model.full_order import FullOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.state import PlantInput
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion
from hil_bench.plants.hydraulic_cylinder.model.stepping import Solver
from hil_bench.plants.hydraulic_cylinder.model.supply import behind_filter, relief_flow

P = replace(paper_parameters(), E=1.4e9, m=200.0)
R = 5e8
"""[Pa s/m³]: 5 bar at 60 l/min."""
UNIT = SupplyUnit(accumulator_volume=0.0, precharge_pressure=0.0, filter=Filter(resistance=R))
"""60 l/min, relief valve at 100 bar with 2e-9 m³/(s Pa), 0.5 l of line."""


def moved(unit, *, opening=1.0e-3, load=0.0, solver=Solver.LINEARLY_IMPLICIT_MIDPOINT, dt=5e-5):
    """Return a plant in steady motion."""
    options = replace(PlantOptions.bench(), supply=unit)
    plant = FullOrderPlant(P, options=options, solver=solver, dt=dt)
    plant.step(PlantInput(opening, load), round(0.5 / dt))
    return plant


@given(
    P_S=st.floats(-1e5, 2e7),
    flow=st.floats(0.0, 5e-3),
    resistance=st.floats(1e6, 1e13),
    bypass=st.one_of(st.just(math.inf), st.floats(1e4, 1e7)),
)
def test_the_line_is_charged_by_what_the_node_at_the_pump_lets_through(
    P_S, flow, resistance, bypass
):
    """Q = Q_P - G max(P_S + D(Q) - P_R, 0) with D(Q) = min(R Q, P_by)."""
    supply = supply_constants(UNIT, P.E)
    unit, drop = behind_filter(P_S, flow, supply, (resistance, bypass))
    Q = flow - relief_flow(P_S, unit)
    assert drop == pytest.approx(min(resistance * Q, bypass), rel=1e-6, abs=1.0)
    relieved = 2e-9 * max(P_S + drop - 1e7, 0.0)
    assert pytest.approx(flow - relieved, rel=1e-6, abs=1e-9) == Q


def test_a_unit_without_a_filter_keeps_its_bits():
    supply = supply_constants(replace(UNIT, filter=None), P.E)
    element = filter_constants(replace(UNIT, filter=None))
    assert behind_filter(1.01e7, supply[1], supply, element) == (supply, 0.0)


def test_at_rest_nothing_drops():
    """No flow, no drop: P_R + Q_P / G = 105 bar, as without a filter."""
    assert moved(UNIT, opening=0.0).supply_pressure == pytest.approx(105e5, rel=1e-6)


def test_in_motion_the_line_lacks_the_drop():
    """P_S = P_R + (Q_P - Q) / G - R Q with the flow Q that the valve draws."""
    plant = moved(UNIT, opening=0.6e-3)
    Q = plant.output.Q_A
    assert 2e-4 < Q < 8e-4
    expected = 1e7 + (1e-3 - Q) / 2e-9 - R * Q
    assert plant.supply_pressure == pytest.approx(expected, rel=1e-5)
    motion = steady_motion(
        replace(P, P_S=plant.supply_pressure), PlantOptions.bench(), extends=True, z=0.3e-3
    )
    assert plant.output.v == pytest.approx(motion.speed, rel=1e-3)


def test_a_clogged_filter_without_a_bypass_starves_the_axis():
    """What passes is (P_R + (Q_P - Q) / G - P_S) / R: 20 times R of a clean one, 10 l/min."""
    unit = replace(UNIT, filter=Filter(resistance=R).clogged(0.95))
    plant = moved(unit, opening=1.3e-3)
    Q = plant.output.Q_A
    passed = (1e7 + (1e-3 - Q) / 2e-9 - plant.supply_pressure) / (20.0 * R)
    assert passed == pytest.approx(Q, rel=1e-5)
    assert Q < 0.99e-3 < moved(UNIT, opening=1.3e-3).output.Q_A * 1.01


def test_a_bypass_holds_the_drop_of_a_clogged_one():
    """P_S = P_R + (Q_P - Q) / G - P_by, however clogged."""
    element = Filter(resistance=R, bypass=6e5).clogged(1.0)
    plant = moved(replace(UNIT, filter=element), opening=0.6e-3)
    expected = 1e7 + (1e-3 - plant.output.Q_A) / 2e-9 - 6e5
    assert plant.supply_pressure == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("solver", [Solver.FORWARD_EULER, Solver.RUNGE_KUTTA])
def test_all_solvers_have_the_same_filter(solver):
    implicit = moved(UNIT, opening=0.6e-3)
    other = moved(UNIT, opening=0.6e-3, solver=solver, dt=2e-6)
    assert other.output.v == pytest.approx(implicit.output.v, rel=1e-6)
    assert other.supply_pressure == pytest.approx(implicit.supply_pressure, rel=1e-6)


@pytest.mark.parametrize("bypass", [math.inf, 3e5])
def test_a_load_sensing_pump_leaves_the_edge_what_the_filter_leaves(bypass):
    """The edge has margin - D(Q): Q² / (K a)² + R Q = margin, or margin - P_by."""
    pump = VariablePump(senses_load=True, leakage=1e-15)
    unit = replace(UNIT, pump_flow=2e-3, variable=pump)
    unit = replace(unit, filter=Filter(resistance=2.0 * R, bypass=bypass))
    plant = moved(unit, opening=0.8e-3, load=20e3)
    Q, per_flow = plant.output.Q_A, P.K * 0.5e-3
    drop = min(2.0 * R * Q, bypass)
    assert drop == (bypass if bypass < math.inf else pytest.approx(2.0 * R * Q))
    assert (Q / per_flow) ** 2 + drop == pytest.approx(2e6, rel=1e-3)
    options = replace(PlantOptions.bench(), supply=unit)
    motion = steady_motion(P, options, extends=True, z=0.5e-3, load=20e3)
    assert plant.output.v == pytest.approx(motion.speed, rel=1e-3)
    assert motion.is_compensated


def test_its_drop_goes_with_what_is_open():
    element = Filter(resistance=R)
    assert element.clogged(0.75).drop(1e-3) == pytest.approx(4.0 * R * 1e-3)


@pytest.mark.parametrize("wrong", [{"resistance": 0.0}, {"resistance": R, "bypass": -1e5}])
def test_what_is_no_filter_is_refused(wrong):
    with pytest.raises(ParameterError, match="the filter"):
        Filter(**wrong)


def through(P_S, element):
    """Q of Q = Q_P - G max(P_S + D(Q) - P_R, 0), by halving."""
    low, high = -1e-2, 1e-3
    for _ in range(60):
        Q = 0.5 * (low + high)
        drop = 0.0 if element is None else element.drop(Q)
        if Q + 2e-9 * max(P_S + drop - 1e7, 0.0) > 1e-3:
            high = Q
        else:
            low = Q
    return Q


def imbalance(element, dt):
    """How far the oil of the line is open over a start and a stop, over what it turns over."""
    options = replace(PlantOptions.bench(), laminar_transition=0.0)
    options = replace(options, supply=replace(UNIT, filter=element))
    plant = FullOrderPlant(P, options=options, dt=dt)
    open_by = turned = 0.0
    for number in range(round(0.1 / dt)):
        before, P_S = plant.output, plant.supply_pressure
        after = plant.step(PlantInput(1.1e-3 if number * dt < 0.06 else 0.0))
        passed = through(P_S, element) + through(plant.supply_pressure, element)
        drawn = before.Q_A + after.Q_A
        stored = UNIT.line_volume / P.E * (plant.supply_pressure - P_S)
        open_by += 0.5 * dt * (passed - drawn) - stored
        turned += 0.5 * dt * (passed + drawn)
    return abs(open_by) / turned


@pytest.mark.parametrize("element", [Filter(resistance=4.0 * R), Filter(resistance=R, bypass=3e5)])
def test_the_line_holds_what_passes_the_filter_and_is_not_drawn(element):
    """By trapezoidal sums, closer than where the relief valve alone opens and shuts."""
    coarse, fine = imbalance(element, 1e-4), imbalance(element, 2.5e-5)
    assert coarse < 0.5 * imbalance(None, 1e-4)
    assert fine < 0.4 * coarse
    assert fine < 2e-5
