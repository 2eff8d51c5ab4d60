"""The balances of oil and of energy with edges, cushions, counterbalance valve and pump.

The flows that the plant reports are those of the instant: summed up by the trapezoidal rule they
meet the balances as the square of the step, whatever stands between valve and cylinder.
"""

from dataclasses import replace
from itertools import pairwise

import pytest

from hil_bench.plants.hydraulic_cylinder.model.extensions import (
    CounterbalanceValve,
    Cushion,
    Filter,
    MeteringLands,
    SupplyUnit,
    VariablePump,
)
from hil_bench.plants.hydraulic_cylinder.model.full_order import FullOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.state import PlantInput, PlantState

P = replace(
    paper_parameters(), P_S=200e5, E=1e9, h=1.0, V_A0=6e-3, V_B0=6e-3, m=500.0, sigma=4e4, F_s=600.0
)
LOAD = 30e3
VALVE = CounterbalanceValve(
    in_line_a=True,
    in_line_b=True,
    setting=110e5,
    pilot_ratio=1.0,
    span=100e5,
    conductance=8e-7,
    time_constant=0.05,
)
PUMP = VariablePump(senses_load=True)
SENSING = SupplyUnit(
    relief_pressure=200e5, accumulator_volume=0.0, precharge_pressure=0.0, variable=PUMP
)
COMPONENTS = {
    "null leakage and underlap": {
        "lands": MeteringLands(null_opening=3e-5, overlap_at=-0.1e-3, overlap_pb=0.2e-3)
    },
    "compensator": {"compensator_margin": 8e5},
    "cushion": {"cushion_a": Cushion(length=0.3, orifice=5e-3)},
    "counterbalance valve": {"counterbalance": VALVE},
    "load-sensing pump": {"supply": SENSING},
    "filter": {"supply": replace(SENSING, filter=Filter(resistance=8e8, bypass=1.5e6))},
}
COMPONENTS["all"] = {key: value for each in COMPONENTS.values() for key, value in each.items()}
SMOOTH = replace(PlantOptions.bench(), laminar_transition=0.0)


def imbalances(options, dt, start):
    """Oil in A, in B and in the supply line [m³], energy in the cylinder [J]: each over its own."""
    state, extension = start
    plant = FullOrderPlant(P, options=options, dt=dt, state=state, extension=extension)
    lost, turned = [0.0] * 4, [0.0] * 4
    for _ in range(round(0.1 / dt)):
        before, P_S, Q_P = plant.output, plant.extension.P_S, plant.extension.Q_P
        void_A, void_B = plant.state[6:]
        after = plant.step(PlantInput(-0.7e-3, LOAD))
        x = 0.5 * (before.x + after.x)
        V_A, V_B = (P.V_A0 + P.A_A * x) / P.E, (P.V_B0 - P.A_B * x) / P.E
        moved = after.x - before.x
        opened_A, opened_B = plant.state.V_CA - void_A, plant.state.V_CB - void_B
        rows = [
            (
                0.5 * dt * (before.Q_A + after.Q_A),
                P.A_A * moved,
                V_A * (after.P_A - before.P_A),
                -opened_A,
            ),
            (
                0.5 * dt * (before.Q_B + after.Q_B),
                -P.A_B * moved,
                V_B * (after.P_B - before.P_B),
                -opened_B,
            ),
            supply_row(plant, options, (before, after), (P_S, Q_P), dt),
            (*energy_row(before, after, dt, (V_A, V_B)), 101_325.0 * (opened_A + opened_B)),
        ]
        for place, (entered, *went) in enumerate(rows):
            lost[place] += entered - sum(went)
            turned[place] += abs(entered) + sum(map(abs, went))
    return [abs(one) / max(all_of_it, 1e-12) for one, all_of_it in zip(lost, turned, strict=True)]


def supply_row(plant, options, outputs, earlier, dt):
    """The pump's flow is drawn by B, leaks or compresses; the leaking valve's is not told."""
    if options.supply is None or options.lands is not None:
        return (0.0,)
    (before, after), (P_S, Q_P) = outputs, earlier
    now = plant.extension
    given = 0.5 * dt * (Q_P + now.Q_P)
    drawn = 0.5 * dt * (before.Q_B + after.Q_B)
    leaked = 0.5 * dt * PUMP.leakage * (P_S + now.P_S)
    return given, drawn, leaked, SENSING.line_volume / P.E * (now.P_S - P_S)


def energy_row(before, after, dt, per_E):
    """What the ports bring is motion, compression, friction and load."""

    def rates(y):
        friction = P.F_c if y.v > 0.0 else -P.F_c
        return y.P_A * y.Q_A + y.P_B * y.Q_B, (friction + P.sigma * y.v + LOAD) * y.v

    (brought, spent), (brought_now, spent_now) = rates(before), rates(after)
    oil = 0.5 * per_E[0] * (after.P_A**2 - before.P_A**2)
    oil += 0.5 * per_E[1] * (after.P_B**2 - before.P_B**2)
    motion = 0.5 * P.m * (after.v**2 - before.v**2)
    return 0.5 * dt * (brought + brought_now), motion, oil, 0.5 * dt * (spent + spent_now)


@pytest.mark.parametrize("name", COMPONENTS)
def test_oil_and_energy_are_neither_made_nor_lost(name):
    options = replace(SMOOTH, **COMPONENTS[name])
    state = PlantState(-0.7, 0.0, 75e5, 15e5, 0.0, 0.0)
    start = FullOrderPlant(P, options=options, state=state, dt=1e-5)
    start.step(PlantInput(-0.6e-3, LOAD), 40_000)
    at = (start.state, start.extension)
    assert start.output.v < -0.02
    found = [imbalances(options, dt, at) for dt in (4e-4, 2e-4, 1e-4)]
    assert max(found[-1]) < 2e-5
    for coarse, fine in pairwise(found):
        assert all(b <= max(0.4 * a, 1e-9) for a, b in zip(coarse, fine, strict=True))
