"""Chambers at the cavitation floor: what is pulled open is filled first, and no oil is made."""

import dataclasses
import math
import random

import pytest
from hypothesis import assume, example, given, settings
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
from hil_bench.plants.hydraulic_cylinder.model.cavitation import compress, fill, hold, share_out
from hil_bench.plants.hydraulic_cylinder.model.constants import pack, unpack, unpack_extended
from hil_bench.plants.hydraulic_cylinder.model.coupling import (
    couple,
    eliminate_pressures,
    pressure_rises,
    velocity_change,
)
from hil_bench.plants.hydraulic_cylinder.model.kernel import make_row
from hil_bench.plants.hydraulic_cylinder.model.reduced_steps import (
    load_flow,
    pack_reduced,
    try_reduced,
)
from hil_bench.plants.hydraulic_cylinder.model.stepping import implicit_share
from tests.support.plant_parts import made_parts

BENCH = PlantOptions.bench()
FLOOR = -101_325.0
MIDPOINT = Solver.LINEARLY_IMPLICIT_MIDPOINT
DT = 5e-5
CHAMBERS = (1e8, 0.0, 5e-3, 4.7e-3, 1.2e-3, 1.15e-3, 0.2)
CONSTANTS = (
    *unpack(make_row(pack(paper_parameters(), PlantOptions.bench(), DT)))[:5],
    CHAMBERS,
    (600.0, 300.0, 0.0, -3.9, 0.8, 400.0),  # no viscous friction
    (math.inf, 0.0, 0.0),
)
EXTENSIONS = {
    "none": {},
    "air": {"air": EntrainedAir(air_fraction=0.01)},
    "supply unit": {"supply": SupplyUnit()},
}


def pull_and_release(plant, F_L, times=1):
    """Pull for half a second and let go for two, and return the state while pulled the last."""
    pulled = plant.state
    for _ in range(times):
        plant.step(PlantInput(0.0, F_L), round(0.5 / plant.dt))
        pulled = plant.state
        plant.step(PlantInput(0.0), round(2.0 / plant.dt))
    return pulled


@pytest.mark.parametrize("F_L", [-6e4, 6e4])
@pytest.mark.parametrize("solver", Solver)
def test_a_pulled_cylinder_comes_back(paper, solver, F_L):
    # The valve is closed and nothing leaks: the oil is the same, so is the place of rest.
    # Forward Euler's own error on the way, of order one, would be 12 um at 50 us.
    dt = 2e-5 if solver is Solver.FORWARD_EULER else DT
    plant = FullOrderPlant(paper, solver=solver, dt=dt)
    before = plant.state
    pulled = pull_and_release(plant, F_L)
    assert abs(pulled.x) > 0.015
    assert (pulled.V_CA if F_L < 0.0 else pulled.V_CB) > 1e-5
    assert plant.state.x == pytest.approx(0.0, abs=1e-5)
    # 0.01 mm more or less compress the oil by E A dx / V, at most 4.2 kPa.
    assert plant.state.P_A == pytest.approx(before.P_A, rel=5e-3)
    assert plant.state.P_B == pytest.approx(before.P_B, rel=5e-3)
    assert plant.state.V_CA == plant.state.V_CB == 0.0


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_twenty_pulls_make_no_oil(paper, extension):
    options = dataclasses.replace(BENCH, **EXTENSIONS[extension])
    plant = FullOrderPlant(paper, options=options, dt=DT)
    pull_and_release(plant, -6e4, times=20)
    limit = 2e-4 if extension == "air" else 1e-5
    assert plant.state.x == pytest.approx(0.0, abs=limit)


@pytest.mark.parametrize("solver", Solver)
def test_a_pulled_reduced_cylinder_comes_back(paper, solver):
    # P_L ends at P_S + 2 * 101325 Pa: 49.5 kN on the mean area, so 80 kN pull to the stop.
    for F_L in (-8e4, 8e4):
        plant = ReducedOrderPlant(paper, solver=solver, dt=DT)
        pulled = pull_and_release(plant, F_L)
        assert abs(pulled.x) > paper.h
        # Swept less compressed: V_t (P_S + 2 * 101325 Pa) / (4 E) = 59.9 cm³
        expected = 4.85e-3 * abs(pulled.x) - 2.35e-3 * (1e7 - 2.0 * FLOOR) / 4e8
        assert max(pulled.V_CA, pulled.V_CB) == pytest.approx(expected, rel=1e-5)
        assert plant.state.x == pytest.approx(0.0, abs=1e-5)


def motion_of(state):
    """What the reduced model's kernels move on."""
    return state.x, state.v, state.P_A - state.P_B, state.V_CB - state.V_CA


def reduced_parts(p, start, z, F_L):
    """State before and after, and duration, of each part of a step."""
    row = make_row(pack_reduced(p, PlantOptions.bench(), DT))
    loads = unpack_extended(row)[3]

    def attempt(motion, _spool, shortened):
        return try_reduced(motion, z, F_L, loads, shortened)

    parts = made_parts(attempt, start, (0.0, 0.0), unpack(row))
    return [(old, new, dt) for old, new, _, dt in parts]


@pytest.mark.parametrize("solver", [Solver.FORWARD_EULER, MIDPOINT])
def test_the_reduced_model_makes_no_oil(paper, solver):
    # (16) summed up: V_t / (4 E) dP_L + V_CB - V_CA = Q_L - A x - leakage, as each solver has it.
    leaky = dataclasses.replace(paper, C_L=2e-12)
    orifice = (paper.K, 5e6, -5e6, 300.0**2, 1.0)
    compliance = 2.35e-3 / 4e8
    source = random.Random(1)  # noqa: S311 - reproducible loads, not a secret
    plant = ReducedOrderPlant(leaky, solver=solver, dt=DT)
    missing = turned_over = largest = 0.0
    for _ in range(200):
        u, F_L = source.uniform(-1.3e-3, 1.3e-3), source.uniform(-9e4, 9e4)
        for _ in range(20):
            before = motion_of(plant.state)
            plant.step(PlantInput(u, F_L))
            parts = [(before, motion_of(plant.state), DT)]
            if solver is MIDPOINT:
                parts = reduced_parts(leaky, before, plant.output.z, F_L)
                assert parts[-1][1] == pytest.approx(motion_of(plant.state), rel=1e-9, abs=1e-9)
            for old, new, dt in parts:
                P_L, rise = old[2], new[2] - old[2]
                Q_L, secant, tangent = load_flow(plant.output.z, P_L, orifice)
                share = 0.0
                if solver is MIDPOINT:
                    share = implicit_share(secant, tangent, compliance / dt)
                    P_L += 0.5 * rise
                swept = 4.85e-3 * (new[0] - old[0])
                entered = dt * (Q_L - share * rise - 2e-12 * P_L)
                missing += entered - swept - compliance * rise - (new[3] - old[3])
                turned_over += abs(swept) + abs(compliance * rise)
                largest = max(largest, abs(new[3]))
    assert largest > 1e-5
    assert abs(missing) < 1e-9 * turned_over


@settings(max_examples=20)
@given(pulls=st.lists(st.floats(-9e4, 9e4), min_size=1, max_size=4))
def test_the_solver_for_references_keeps_the_oil(pulls):
    # Valve closed: (8) integrates to P_A + E ln(V_A - V_CA) = const, whatever the piston does.
    # Each step rounds x by up to half the distance of two doubles, which 5e-3 m² sweep.
    p = paper_parameters()
    plant = FullOrderPlant(p, solver=Solver.RUNGE_KUTTA, dt=2e-6)

    def oil(state):
        x, _, P_A, P_B, _, _, V_CA, V_CB = state
        x = min(max(x, -p.h), p.h)
        return (
            (p.V_A0 + p.A_A * x - V_CA) * math.exp(P_A / p.E),
            (p.V_B0 - p.A_B * x - V_CB) * math.exp(P_B / p.E),
        )

    before = oil(plant.state)
    swept = rounded = 0.0
    for F_L in [F_L for pull in pulls for F_L in (pull, 0.0)]:
        for _ in range(20):
            x = plant.state.x
            plant.step(PlantInput(0.0, F_L), 500)
            swept += 4.7e-3 * abs(plant.state.x - x)
            rounded += 500 * math.ulp(p.h) / 2.0 * 5e-3
        assert oil(plant.state) == pytest.approx(before, abs=1e-9 * swept + rounded)


@pytest.mark.parametrize("solver", Solver)
def test_a_cavity_takes_what_the_piston_sweeps(paper, solver):
    # From the floor on, at constant velocity: V_CA grows by A_A v; then a port fills it again.
    heavy = dataclasses.replace(paper, m=1e9)
    state = PlantState(0.0, 0.1, FLOOR, 5e6, 0.0, 0.0)
    plant = FullOrderPlant(heavy, solver=solver, dt=DT, state=state)
    plant.step(PlantInput(0.0), 200)
    assert plant.state.V_CA == pytest.approx(5e-3 * 0.1 * 0.01, rel=1e-5)
    assert plant.state.P_A == FLOOR


@pytest.mark.parametrize("options", [BENCH, dataclasses.replace(BENCH, C_LA=1e-18)])
@pytest.mark.parametrize("solver", Solver)
def test_a_cavity_is_filled_before_pressure_rises(paper, solver, options):
    # The piston is stuck; the port passes z K sqrt(P_S - floor) all the while.
    stuck = dataclasses.replace(paper, m=1e9)
    flow = 1e-3 * paper.K * math.sqrt(paper.P_S - FLOOR)
    state = PlantState(0.0, 0.0, FLOOR, 5e6, 1.3e-3, 0.0, V_CA=flow * 0.01)
    plant = FullOrderPlant(stuck, options=options, solver=solver, dt=DT, state=state)
    assert plant.step(PlantInput(1.3e-3), 199).P_A == FLOOR
    assert plant.state.V_CA == pytest.approx(flow * DT, rel=1e-3)
    assert plant.step(PlantInput(1.3e-3), 3).P_A > FLOOR
    assert plant.state.V_CA == 0.0


@pytest.mark.parametrize("solver", Solver)
def test_a_plant_goes_on_from_its_cavities(paper, solver):
    whole = FullOrderPlant(paper, solver=solver, dt=DT)
    whole.step(PlantInput(0.0, -6e4), 2_000)
    assert whole.state.V_CA > 1e-5
    given, restarted = (FullOrderPlant(paper, solver=solver, dt=DT) for _ in range(2))
    given = FullOrderPlant(paper, solver=solver, dt=DT, state=whole.state)
    restarted.restart(whole.state)
    ends = [plant.step(PlantInput(1e-3), 3_000) for plant in (whole, given, restarted)]
    assert ends[0] == ends[1] == ends[2]


def test_a_reduced_plant_goes_on_from_its_cavity(paper):
    whole, restarted = ReducedOrderPlant(paper, dt=DT), ReducedOrderPlant(paper, dt=DT)
    whole.step(PlantInput(0.0, 8e4), 300)
    assert whole.state.V_CB > 1e-5
    restarted.restart(whole.state)
    first, second = (plant.step(PlantInput(1e-3), 3_000) for plant in (whole, restarted))
    assert second == pytest.approx(first, rel=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"V_CA": -1e-9}, "V_CA = -1e-09 m³: must be 0 or greater, and smaller than the chamber"),
        ({"V_CB": 2e-3}, "V_CB = 0.002 m³: must be 0 or greater, and smaller than the chamber, 0."),
        ({"V_CA": math.nan}, "V_CA = nan m³: must be finite"),
        ({"V_CA": 1e-6}, "V_CA = 1e-06 m³: must be 0 at P_A = 4.84536e+06 Pa, for the floor is at"),
    ],
)
def test_refuses_a_cavity_that_cannot_be(paper, change, message):
    plant = FullOrderPlant(paper)
    state = balanced_state(paper)._replace(**change)
    for refused in (lambda: FullOrderPlant(paper, state=state), lambda: plant.restart(state)):
        with pytest.raises(ParameterError) as refusal:
            refused()
        assert str(refusal.value).startswith(message)


def test_refuses_a_cavity_without_a_floor(paper):
    state = balanced_state(paper)._replace(V_CA=1e-6)
    with pytest.raises(ParameterError, match=r"V_CA = 1e-06 m³: .*there is no cavitation floor"):
        FullOrderPlant(paper, options=PlantOptions.paper(), state=state)


compliances = st.floats(1e-12, 1e-6)
flows = st.floats(-1e-2, -1e-3) | st.floats(-1e-3, 1e-3)


@given(
    to_floor=st.tuples(st.floats(-1e3, 0.0), st.floats(-1e3, 0.0)),
    nets=st.tuples(flows, flows),
    rows=st.tuples(compliances, compliances, st.floats(0.0, 1e-7)),
    force=st.floats(-1e3, 1e3),
    inertia=st.floats(1e2, 1e7),
    swings=st.booleans(),
)
@example(
    to_floor=(0.0, -115.0),
    nets=(0.0, -1.175494351e-38),
    rows=(9.560475254856194e-07, 2e-12, 0.0),
    force=0.0,
    inertia=100.0,
    swings=True,
)
@example(
    to_floor=(-37.0, 0.0),
    nets=(0.0, 0.0),
    rows=(9.69031537438874e-07, 8.646128953229527e-07, 0.0),
    force=-0.03125,
    inertia=100.0,
    swings=True,
)
def test_a_chamber_is_at_the_floor_or_filled(to_floor, nets, rows, force, inertia, swings):
    """The complementarity problem has one solution, which is checked, not compared."""
    own_a, own_b, c = rows
    lag = 0.0
    if swings:  # with the end correction, at steps that follow the piston's swing on the oil
        lag = 1.0 / (12.0 * inertia)
        own_a, own_b = own_a + 5e-3**2 / inertia, own_b + 4.7e-3**2 / inertia
    oil = couple((own_a + c, own_b + c, c, *nets, 0.5), lag, 0.0, CHAMBERS)
    a, _, c, _, _, half = oil

    def free_rises(dv):
        return pressure_rises(eliminate_pressures(oil, CHAMBERS), dv)

    free = eliminate_pressures(oil, CHAMBERS)
    dv, _ = velocity_change(force, inertia, half, free, CONSTANTS)
    assume(any(rise < least for rise, least in zip(free_rises(dv), to_floor, strict=True)))
    held = hold(*to_floor, force, inertia, oil, CONSTANTS)
    dv, _ = velocity_change(force, inertia, half, held, CONSTANTS)
    assume(any(rise < least for rise, least in zip(free_rises(dv), to_floor, strict=True)))
    rise_A, rise_B, open_A, open_B = share_out(*to_floor, dv, oil, CHAMBERS)
    for rise, least, flow in ((rise_A, to_floor[0], open_A), (rise_B, to_floor[1], open_B)):
        assert flow >= 0.0
        assert flow == 0.0 or rise == least
    parts = (a * rise_A, c * rise_B, nets[0], 2.5e-3 * dv)
    balance = parts[0] - parts[1] - parts[2] + parts[3]
    size = sum(map(abs, parts)) + abs(a * to_floor[0]) + abs(c * to_floor[1])
    assert balance == pytest.approx(open_A, abs=1e-14 * size)


def test_an_explicit_step_fills_first():
    # 2 cm³/s into a cavity of 1 cm³ for 1 s at 1e8 Pa/(m³/s) leave 1 cm³: 100 Pa above the floor.
    assert compress(-50.0, 1e-6, 2e-6, 1.0, 1e8, -50.0) == pytest.approx((50.0, 0.0))
    assert compress(-50.0, 1e-6, 0.4e-6, 1.0, 1e8, -50.0) == pytest.approx((-50.0, 0.6e-6))
    assert fill(-250.0, 0.0, 1e8, -50.0) == pytest.approx((-50.0, 2e-6))
    assert fill(50.0, 3e-6, 1e8, -50.0) == pytest.approx((-50.0, 2e-6))
    assert fill(-50.0, -1e-6, 1e8, -50.0) == pytest.approx((50.0, 0.0))
    assert fill(50.0, 0.0, 1e8, -50.0) == (50.0, 0.0)
