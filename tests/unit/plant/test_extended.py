"""The extensions in the plant as a whole, each against its closed form, with both solvers."""

import dataclasses
import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil_bench.errors import ParameterError
from hil_bench.plant import (
    ConstantLoad,
    EndStop,
    EntrainedAir,
    ExtensionState,
    FullOrderPlant,
    LoadSeries,
    LuGreFriction,
    MassOnSlope,
    PlantInput,
    PlantOptions,
    PlantParameters,
    PlantState,
    Solver,
    SpringLoad,
    SupplyUnit,
    balanced_state,
    paper_parameters,
)
from hil_bench.plant.bulk_modulus import bulk_modulus
from hil_bench.plant.constants import pack
from hil_bench.plant.extended_constants import pack_extended
from hil_bench.plant.extended_euler import advance_extended_euler
from hil_bench.plant.extended_midpoint import advance_extended_midpoint
from hil_bench.plant.forward_euler import advance_forward_euler
from hil_bench.plant.implicit_midpoint import advance_implicit_midpoint
from hil_bench.plant.kernel import make_row

EULER = Solver.FORWARD_EULER
UNDAMPED = [Solver.LINEARLY_IMPLICIT_MIDPOINT, Solver.RUNGE_KUTTA]  # forward Euler is unstable
MIDPOINT = Solver.LINEARLY_IMPLICIT_MIDPOINT
PAPER = PlantOptions.paper()
BENCH = PlantOptions.bench()
AIR = EntrainedAir(air_fraction=0.01)
EVERYTHING = dataclasses.replace(
    BENCH,
    C_LA=1e-12,
    C_LB=2e-12,
    air=AIR,
    bristles=LuGreFriction(),
    supply=SupplyUnit(),
    loads=(
        ConstantLoad(200.0),
        SpringLoad(2e4, 0.01),
        MassOnSlope(30.0, 0.3),
        LoadSeries((0.0, 0.3, 0.3, 1.0), (0.0, 500.0, -500.0, 0.0)),
    ),
)


def free_mass(paper: PlantParameters, m: float = 20.0) -> PlantParameters:
    """A piston that neither oil nor friction touches: E of a thousandth of a pascal."""
    return dataclasses.replace(paper, E=1e-3, F_c=0.0, F_s=0.0, sigma=0.0, m=m)


def stuck(paper: PlantParameters, **change: float) -> PlantParameters:
    """A piston that nothing moves."""
    return dataclasses.replace(paper, F_c=1e9, F_s=1e9, m=1e8, **change)


@pytest.mark.parametrize(
    ("plain", "extended"),
    [
        (advance_forward_euler, advance_extended_euler),
        (advance_implicit_midpoint, advance_extended_midpoint),
    ],
)
@pytest.mark.parametrize("options", [PAPER, BENCH])
def test_with_everything_off_the_bits_are_those_of_the_plain_kernels(
    paper: PlantParameters, plain, extended, options: PlantOptions
) -> None:
    leaky = dataclasses.replace(paper, C_L=1e-12)
    start = balanced_state(leaky)
    state, longer = make_row(start), make_row((*start, 0.0, 0.0, paper.P_S, 0.0))
    row, longer_row = (
        make_row(pack(leaky, options, 1e-4)),
        make_row(pack_extended(leaky, options, 1e-4)),
    )
    for u, F_L in ((1.3e-3, 0.0), (-1.3e-3, 6e4), (1e-3, -6e4), (2e-4, 100.0)):
        assert plain(state, row, u, F_L, 5000) == extended(longer, longer_row, u, F_L, 5000)
        assert [state[i] for i in range(6)] == [longer[i] for i in range(6)]
    assert longer[8] == paper.P_S


@pytest.mark.parametrize("solver", Solver)
def test_external_leakage_lets_a_chamber_down_to_the_tank(
    paper: PlantParameters, solver: Solver
) -> None:
    # P - P_T decays with C_LA E / V_A0 = 1/1.2 1/s for C_LA = 1e-11, and half of it in B.
    held = stuck(paper, P_T=1e5)
    options = dataclasses.replace(PAPER, C_LA=1e-11, C_LB=0.5e-11)
    start = PlantState(0.0, 0.0, 6e6, 4e6, 0.0, 0.0)
    output = FullOrderPlant(held, options=options, solver=solver, state=start).step(
        PlantInput(0.0), 10_000
    )
    assert output.P_A - 1e5 == pytest.approx(5.9e6 * math.exp(-1.0 / 1.2), rel=1e-4)
    assert output.P_B - 1e5 == pytest.approx(3.9e6 * math.exp(-0.5 / 1.15), rel=1e-4)


@pytest.mark.parametrize("E", [1e8, 1.5e9])
def test_closed_chambers_with_air_keep_their_content(paper: PlantParameters, E: float) -> None:
    # (8) without flow: d ln V = -dP / E(P), so ln V + integral of dP / E(P) stays.
    oil = dataclasses.replace(paper, E=E)

    def drift(dt: float) -> float:
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


def test_air_makes_the_cylinder_softer(paper: PlantParameters) -> None:
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
def test_with_air_a_pull_stays_above_vacuum(paper: PlantParameters, solver: Solver) -> None:
    options = dataclasses.replace(BENCH, air=EntrainedAir(air_fraction=0.05))
    plant = FullOrderPlant(paper, options=options, solver=solver)
    pressures = [plant.step(PlantInput(1e-3, -6e4), 10).P_A for _ in range(300)]
    assert -101_325.0 < min(pressures) < -1e4
    plant = FullOrderPlant(paper, options=options, solver=solver)
    pressures = [plant.step(PlantInput(-1e-3, 6e4), 10).P_B for _ in range(300)]
    assert -101_325.0 < min(pressures) < -1e4


@pytest.mark.parametrize("solver", Solver)
def test_steady_motion_on_bristles_has_the_printed_friction(
    paper: PlantParameters, solver: Solver
) -> None:
    options = dataclasses.replace(PAPER, bristles=LuGreFriction(), tanh_gain=math.inf)
    start = balanced_state(paper, x=-0.19)
    plant = FullOrderPlant(paper, options=options, solver=solver, state=start)
    _, v, P_A, P_B, *_ = plant.step(PlantInput(1e-3), 17_000)
    friction = 600.0 + 300.0 * math.exp(-((v / 0.02) ** 0.8)) + 2000.0 * v  # eq. (13)
    assert P_A * paper.A_A - P_B * paper.A_B == pytest.approx(friction, rel=1e-4)


@pytest.mark.parametrize("solver", Solver)
def test_bristles_hold_a_load_at_rest_without_creep(paper: PlantParameters, solver: Solver) -> None:
    # Without oil to help: 500 N bend the bristles by 0.05 mm, and there the piston stays. The
    # static curve with its tanh lets it creep at atanh(500/900) / 400 = 1.6 mm/s.
    dry = dataclasses.replace(paper, E=1e-3)
    options = dataclasses.replace(PAPER, bristles=LuGreFriction(), loads=(ConstantLoad(-500.0),))
    start = balanced_state(dry)
    plant = FullOrderPlant(dry, options=options, solver=solver, state=start)
    after_one = plant.step(PlantInput(0.0), 10_000).x
    after_ten = plant.step(PlantInput(0.0), 90_000).x
    assert plant.extension.z_f == pytest.approx(5e-5, rel=1e-3)
    assert after_ten == pytest.approx(after_one, abs=1e-12)
    static = dataclasses.replace(options, bristles=None)
    plant = FullOrderPlant(dry, options=static, solver=solver, state=start)
    assert plant.step(PlantInput(0.0), 10_000).v == pytest.approx(
        math.atanh(500.0 / 900.0) / 400.0, rel=0.15
    )


@pytest.mark.parametrize("solver", Solver)
def test_break_away_is_at_the_static_friction(paper: PlantParameters, solver: Solver) -> None:
    # A slow ramp of 100 N/s: bristles give way between F_c and F_s, close to F_s.
    dry = dataclasses.replace(paper, E=1e-3)
    ramp = LoadSeries((0.0, 20.0), (0.0, -2000.0))
    options = dataclasses.replace(PAPER, bristles=LuGreFriction(), loads=(ramp,))
    plant = FullOrderPlant(dry, options=options, solver=solver)
    broke = next(step for step in range(2000) if plant.step(PlantInput(0.0), 100).v > 5e-3)
    assert 0.95 * 900.0 < broke * 1.0 < 1.01 * 900.0  # 1 N every 100 steps


@pytest.mark.parametrize("solver", Solver)
def test_a_constant_load_is_a_load(paper: PlantParameters, solver: Solver) -> None:
    options = dataclasses.replace(BENCH, loads=(ConstantLoad(3000.0),))
    by_option = FullOrderPlant(paper, options=options, solver=solver, state=balanced_state(paper))
    by_input = FullOrderPlant(paper, options=BENCH, solver=solver)
    assert by_option.step(PlantInput(1e-3), 3000) == by_input.step(PlantInput(1e-3, 3000.0), 3000)


@pytest.mark.parametrize("solver", Solver)
def test_starts_at_rest_under_its_loads(paper: PlantParameters, solver: Solver) -> None:
    loads = (ConstantLoad(2e3), SpringLoad(1e4, -0.1), MassOnSlope(100.0, 1.0))
    plant = FullOrderPlant(paper, options=dataclasses.replace(BENCH, loads=loads), solver=solver)
    before = plant.state
    plant.step(PlantInput(0.0), 10_000)
    assert plant.state == pytest.approx(before, rel=1e-9, abs=1e-9)


def test_a_mass_on_a_spring_swings_at_its_frequency(paper: PlantParameters) -> None:
    # x = 0.03 + 0.02 cos(w t), w = sqrt(k / m) = 31.6 rad/s; the midpoint rule keeps the amplitude
    # and stretches the period by (w dt)² / 12 = 8e-7.
    options = dataclasses.replace(PAPER, loads=(SpringLoad(1.5e4, 0.04), SpringLoad(0.5e4, 0.0)))
    start = balanced_state(paper, x=0.05)
    plant = FullOrderPlant(free_mass(paper), options=options, state=start)
    for step in range(1, 101):
        x = plant.step(PlantInput(0.0), 100).x
        assert x == pytest.approx(0.03 + 0.02 * math.cos(math.sqrt(1e3) * step * 1e-2), abs=2e-6)


@pytest.mark.parametrize("stiffness", [1e6, 1e9, 1e13])
def test_a_stiff_spring_creates_no_energy(paper: PlantParameters, stiffness: float) -> None:
    options = dataclasses.replace(PAPER, loads=(SpringLoad(stiffness),))
    start = balanced_state(paper)._replace(v=0.5)
    plant = FullOrderPlant(free_mass(paper), options=options, state=start)
    for _ in range(1000):
        x, v, *_ = plant.step(PlantInput(0.0))
        assert 10.0 * v * v + 0.5 * stiffness * x * x <= 2.5 * (1.0 + 1e-9)


@pytest.mark.parametrize("solver", UNDAMPED)
def test_a_mass_slides_down_its_slope(paper: PlantParameters, solver: Solver) -> None:
    # a = -g M sin(slope) / (m + M), with M = 60 kg beside m = 20 kg
    options = dataclasses.replace(PAPER, loads=(MassOnSlope(60.0, math.radians(30.0)),))
    start = balanced_state(paper)
    plant = FullOrderPlant(free_mass(paper), options=options, solver=solver, state=start)
    v = plant.step(PlantInput(0.0), 1000).v
    assert v == pytest.approx(-0.1 * 9.80665 * 0.5 * 60.0 / 80.0, rel=1e-9)


@pytest.mark.parametrize("solver", UNDAMPED)
def test_a_series_gives_its_impulse(paper: PlantParameters, solver: Solver) -> None:
    # 100 N rising over 10 ms, held for 20 ms, then falling at once: 2.5 N s on 20 kg.
    series = LoadSeries((0.01, 0.02, 0.04, 0.04), (0.0, 100.0, 100.0, 0.0))
    options = dataclasses.replace(PAPER, loads=(series,))
    plant = FullOrderPlant(free_mass(paper), options=options, solver=solver)
    assert plant.step(PlantInput(0.0), 100).v == pytest.approx(0.0, abs=1e-9)
    v = plant.step(PlantInput(0.0), 900).v
    # Runge-Kutta counts a sixth of the step before the fall, 100 N * 0.1 ms, as fallen already.
    assert v == pytest.approx(-2.5 / 20.0, abs=1e-9 if solver is MIDPOINT else 1e-4)
    assert plant.extension.t == pytest.approx(0.1, rel=1e-12)


def test_a_series_goes_on_where_the_state_says(paper: PlantParameters) -> None:
    ramp = LoadSeries((0.0, 1.0), (0.0, 1000.0))
    options = dataclasses.replace(EVERYTHING, loads=(ramp,))
    whole = FullOrderPlant(paper, options=options)
    whole.step(PlantInput(1e-3), 500)
    halves = FullOrderPlant(paper, options=options, state=whole.state, extension=whole.extension)
    expected, found = (plant.step(PlantInput(1e-3), 500) for plant in (whole, halves))
    assert found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("solver", Solver)
def test_a_pump_fills_the_accumulator(paper: PlantParameters, solver: Solver) -> None:
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
def test_an_idle_pump_runs_over_the_relief_valve(paper: PlantParameters, solver: Solver) -> None:
    # 1e-3 m³/s through 2e-9 m³/(s Pa): 5 bar above the 100 bar at which it opens.
    options = dataclasses.replace(BENCH, supply=SupplyUnit())
    plant = FullOrderPlant(paper, options=options, solver=solver)
    plant.step(PlantInput(0.0), 20_000)
    assert plant.extension.P_S == pytest.approx(1.05e7, rel=1e-6)


@pytest.mark.parametrize("solver", Solver)
def test_the_pump_limits_the_speed(paper: PlantParameters, solver: Solver) -> None:
    # A third of the flow that this opening wants: v = Q_P / A_A = 0.0667 m/s out, Q_P / A_B in.
    unit = SupplyUnit(pump_flow=1e-3 / 3.0, accumulator_volume=0.0)
    options = dataclasses.replace(BENCH, supply=unit)
    for u, area, x in ((1e-3, paper.A_A, -0.1), (-1e-3, paper.A_B, 0.1)):
        start = balanced_state(paper, x=x)
        plant = FullOrderPlant(paper, options=options, solver=solver, state=start)
        output = plant.step(PlantInput(u), 20_000)
        assert abs(output.v) == pytest.approx(unit.pump_flow / area, rel=1e-3)
        assert plant.extension.P_S < 0.3 * paper.P_S


def test_the_pumps_oil_is_all_somewhere(paper: PlantParameters) -> None:
    # Pump, relief valve and cylinder against what line and accumulator hold, to second order.
    unit = SupplyUnit(gas_exponent=1.0)
    options = dataclasses.replace(BENCH, supply=unit)

    def held(P_S: float) -> float:
        gas = unit.accumulator_volume * (unit.precharge_pressure + 101_325.0) / (P_S + 101_325.0)
        return unit.line_volume * P_S / paper.E + unit.accumulator_volume - gas

    def lost(dt: float) -> float:
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
def test_a_stiff_supply_line_does_not_ring(paper: PlantParameters, E: float, line: float) -> None:
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


def test_midpoint_is_of_second_order_with_everything_on(paper: PlantParameters) -> None:
    # A motion without kinks: sliding, relief valve shut, load series smooth.
    supply = SupplyUnit(relief_pressure=2e7)
    options = dataclasses.replace(EVERYTHING, supply=supply)
    setup = FullOrderPlant(paper, options=options, dt=1e-5)
    setup.step(PlantInput(1e-3), 5_000)

    def end(dt: float) -> tuple[float, ...]:
        plant = FullOrderPlant(
            paper, options=options, dt=dt, state=setup.state, extension=setup.extension
        )
        plant.step(PlantInput(8e-4), round(0.02 / dt))
        return (*plant.state[:4], *plant.extension[1:])

    ends = [end(dt) for dt in (2e-4, 1e-4, 5e-5, 2.5e-5)]
    for quantity in zip(*ends, strict=True):
        steps = [b - a for a, b in itertools.pairwise(quantity)]
        for coarse, fine in itertools.pairwise(steps):
            assert 3.0 < coarse / fine < 5.0


def test_both_solvers_tell_the_same(paper: PlantParameters) -> None:
    midpoint = FullOrderPlant(paper, options=EVERYTHING, dt=1e-5)
    euler = FullOrderPlant(paper, options=EVERYTHING, solver=EULER, dt=1e-5)
    for u in (1e-3, 0.0, -1e-3, 5e-4):
        a, b = (plant.step(PlantInput(u), 20_000) for plant in (midpoint, euler))
        assert b.x == pytest.approx(a.x, abs=2e-5)
        assert b.v == pytest.approx(a.v, abs=2e-3)
        assert euler.extension.P_S == pytest.approx(midpoint.extension.P_S, rel=1e-3)


option_sets = st.builds(
    PlantOptions,
    end_stop=st.none() | st.just(EndStop()),
    cavitation_floor=st.none() | st.just(-101_325.0),
    laminar_transition=st.just(0.0) | st.just(300.0),
    C_LA=st.floats(0.0, 1e-6),
    C_LB=st.floats(0.0, 1e-6),
    air=st.none()
    | st.builds(EntrainedAir, air_fraction=st.floats(1e-6, 0.5), air_exponent=st.floats(1.0, 2.0)),
    bristles=st.none()
    | st.builds(LuGreFriction, sigma_0=st.floats(1e3, 1e12), sigma_1=st.floats(0.0, 1e7)),
    supply=st.none()
    | st.builds(
        SupplyUnit,
        pump_flow=st.floats(0.0, 1e-2),
        line_volume=st.floats(1e-9, 1.0),
        accumulator_volume=st.floats(0.0, 1.0),
        relief_gradient=st.floats(1e-12, 1e-5),
    ),
    loads=st.lists(
        st.builds(ConstantLoad, st.floats(-1e5, 1e5))
        | st.builds(SpringLoad, st.floats(1.0, 1e12), st.floats(-1.0, 1.0))
        | st.builds(MassOnSlope, st.floats(0.0, 1e4), st.floats(-1.5, 1.5)),
        max_size=3,
    ).map(tuple),
)
inputs = st.tuples(st.floats(-2e-3, 2e-3), st.floats(-1e5, 1e5))


@settings(max_examples=150)
@given(
    options=option_sets,
    E=st.floats(1e7, 2e9),
    history=st.lists(inputs, min_size=1, max_size=15),
)
def test_midpoint_stays_finite_whatever_is_on(
    options: PlantOptions, E: float, history: list[tuple[float, float]]
) -> None:
    oil = dataclasses.replace(paper_parameters(), E=E)
    plant = FullOrderPlant(oil, options=options, state=balanced_state(oil))
    for u, F_L in history:
        output = plant.step(PlantInput(u, F_L), 100)
        assert all(map(math.isfinite, (*plant.state, *output, *plant.extension)))


def test_forward_euler_is_refused_where_an_extension_makes_it_unstable(
    paper: PlantParameters,
) -> None:
    # Relief valve: 2 C_S / G with C_S = V_line / E: 2 * 1e-14 / 2e-9 = 1e-5 s
    tight = dataclasses.replace(PAPER, supply=SupplyUnit(line_volume=1e-6, accumulator_volume=0.0))
    with pytest.raises(ParameterError, match=r"; \S+ s or less"):
        FullOrderPlant(paper, options=tight, solver=EULER)
    FullOrderPlant(paper, options=tight, solver=EULER, dt=0.99e-5)


def test_a_load_mass_counts_for_that_limit(paper: PlantParameters) -> None:
    # 2 (m + 5 kg) / (400 F_s + sigma) = 50 / 3.62e5 = 1.381e-4 s
    options = dataclasses.replace(PAPER, loads=(MassOnSlope(5.0),))
    FullOrderPlant(paper, options=options, solver=EULER, dt=1.38e-4)
    with pytest.raises(ParameterError, match=r"0\.000138 s or less"):
        FullOrderPlant(paper, options=options, solver=EULER, dt=1.39e-4)


def test_refuses_bristles_without_coulomb_friction(paper: PlantParameters) -> None:
    smooth = dataclasses.replace(paper, F_c=0.0)
    options = dataclasses.replace(PAPER, bristles=LuGreFriction())
    with pytest.raises(ParameterError, match=r"^F_c = 0 N: must be greater than 0 for LuGre"):
        FullOrderPlant(smooth, options=options)


def test_refuses_two_series() -> None:
    series = LoadSeries((0.0,), (1.0,))
    with pytest.raises(ParameterError, match=r"^load_series = several: must be one"):
        PlantOptions(loads=(series, series))


def test_refuses_a_senseless_extension_state(paper: PlantParameters) -> None:
    with pytest.raises(ParameterError, match=r"^z_f = nan m: must be finite"):
        FullOrderPlant(paper, options=EVERYTHING, extension=ExtensionState(0.0, math.nan, 1e7))


def test_without_extensions_there_is_their_start(paper: PlantParameters) -> None:
    plant = FullOrderPlant(paper)
    plant.step(PlantInput(1e-3), 100)
    assert plant.extension == (0.0, 0.0, paper.P_S)
