"""A cylinder whose sides A and B change places moves the other way, whatever they differ in.

No number comes from the model: the same axis looked at from the other end is what is right.
"""

from dataclasses import replace

import pytest

from hil_bench.plants.hydraulic_cylinder.model.extensions import (
    CounterbalanceValve,
    Cushion,
    EntrainedAir,
    LuGreFriction,
    MeteringLands,
    SupplyUnit,
    VariablePump,
)
from hil_bench.plants.hydraulic_cylinder.model.full_order import FullOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.options import EndStop, PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.state import PlantInput, PlantState
from hil_bench.plants.hydraulic_cylinder.model.stepping import Solver
from hil_bench.plants.hydraulic_cylinder.model.waves import Line

P = replace(
    paper_parameters(), P_S=200e5, E=1e9, h=0.2, A_A=5e-3, A_B=3e-3, V_A0=1.5e-3, V_B0=1.1e-3
)
BARE = replace(PlantOptions.bench(), C_LA=2e-12, C_LB=7e-12)
HOSE = Line(length=3.0, inner=0.0125, bulk_modulus=850e6, viscosity=46e-6)
SHORT = replace(HOSE, length=0.5, inner=0.01)
SENSING = SupplyUnit(
    relief_pressure=200e5,
    accumulator_volume=0.0,
    precharge_pressure=0.0,
    variable=VariablePump(senses_load=True),
)
LANDS = MeteringLands(
    gain_pa=0.9,
    gain_at=1.1,
    gain_pb=0.7,
    gain_bt=1.3,
    saturation=0.5,
    overlap_at=-0.1e-3,
    overlap_pb=0.2e-3,
)
HOLDING = CounterbalanceValve(
    in_line_a=True, setting=110e5, pilot_ratio=3.0, conductance=8e-7, time_constant=0.02
)
UNEQUAL = {
    "bare": {},
    "valve": {"alpha_negative": 2.0 * P.alpha, "beta_negative": 0.5 * P.beta},
    "air and bristles": {"air": EntrainedAir(air_fraction=0.01), "bristles": LuGreFriction()},
    "lands": {"lands": LANDS, "compensator_margin": 8e5},
    "cushion": {
        "cushion_a": Cushion(length=0.1, orifice=2e-3),
        "cushion_b": Cushion(length=0.15, orifice=1e-3),
        "end_stop": EndStop(),
    },
    "counterbalance valve": {"counterbalance": HOLDING},
    "load-sensing pump": {"supply": SENSING},
    "lines": {"line_a": HOSE, "line_b": SHORT},
    "line at A": {"line_a": HOSE, "supply": SENSING},
    "line at B": {"line_b": HOSE, "supply": SENSING, "counterbalance": HOLDING},
    "lines and pump": {"line_a": HOSE, "line_b": SHORT, "supply": SENSING, "lands": LANDS},
}
COURSE = ((1.5e-3, 2e4), (-0.8e-3, -1e4), (0.0, 3e4), (-2e-3, 1e4), (0.4e-3, -2e4))


def other_way(parameters, options):
    lands, holding = options.lands, options.counterbalance
    return (
        replace(
            parameters,
            A_A=parameters.A_B,
            A_B=parameters.A_A,
            V_A0=parameters.V_B0,
            V_B0=parameters.V_A0,
            alpha=options.alpha_negative or parameters.alpha,
            beta=options.beta_negative or parameters.beta,
        ),
        replace(
            options,
            C_LA=options.C_LB,
            C_LB=options.C_LA,
            alpha_negative=parameters.alpha,
            beta_negative=parameters.beta,
            line_a=options.line_b,
            line_b=options.line_a,
            cushion_a=options.cushion_b,
            cushion_b=options.cushion_a,
            counterbalance=holding
            and replace(holding, in_line_a=holding.in_line_b, in_line_b=holding.in_line_a),
            lands=lands
            and replace(
                lands,
                gain_pa=lands.gain_pb,
                gain_pb=lands.gain_pa,
                gain_at=lands.gain_bt,
                gain_bt=lands.gain_at,
                overlap_pa=lands.overlap_pb,
                overlap_pb=lands.overlap_pa,
                overlap_at=lands.overlap_bt,
                overlap_bt=lands.overlap_at,
            ),
        ),
    )


def course(parameters, options, solver, sign, parts=(8, 100)):
    start = (75e5, 45e5) if sign > 0.0 else (45e5, 75e5)
    state = PlantState(sign * 0.05, 0.0, *start, 0.0, 0.0)
    plant = FullOrderPlant(parameters, options=options, solver=solver, state=state, dt=2e-5)
    for u, load in COURSE:
        for _ in range(parts[0]):
            seen = plant.step(PlantInput(sign * u, sign * load), parts[1])
            ports = (seen.P_A, seen.P_B), (seen.Q_A, seen.Q_B), plant.valve_pressures
            a, b = (
                zip(*ports, strict=True) if sign > 0.0 else zip(*map(reversed, ports), strict=True)
            )
            yield (sign * seen.x, sign * seen.v, *a, *b, plant.extension.P_S)


def agree(options, solver):
    one = list(course(P, options, solver, 1.0))
    other = list(course(*other_way(P, options), solver, -1.0))
    assert max(row[1] for row in one) > 0.02
    assert min(row[1] for row in one) < -0.02
    for at, seen in zip(one, other, strict=True):
        assert at == pytest.approx(seen, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("name", UNEQUAL)
def test_an_axis_seen_from_its_other_end_moves_the_other_way(name):
    agree(replace(BARE, **UNEQUAL[name]), Solver.LINEARLY_IMPLICIT_MIDPOINT)


@pytest.mark.parametrize("solver", [Solver.FORWARD_EULER, Solver.RUNGE_KUTTA])
def test_so_it_does_with_the_explicit_solvers(solver):
    agree(replace(BARE, lands=LANDS, cushion_a=UNEQUAL["cushion"]["cushion_a"]), solver)


@pytest.mark.parametrize("name", UNEQUAL)
def test_so_it_does_from_step_to_step(name):
    """A course of 1.5 ms, in which waves go through the shorter line and back."""
    options, solver = replace(BARE, **UNEQUAL[name]), Solver.LINEARLY_IMPLICIT_MIDPOINT
    one = course(P, options, solver, 1.0, (15, 1))
    other = course(*other_way(P, options), solver, -1.0, (15, 1))
    for at, seen in zip(one, other, strict=True):
        assert at == pytest.approx(seen, rel=1e-7, abs=1e-9)
