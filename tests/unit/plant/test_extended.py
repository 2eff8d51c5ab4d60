"""All extensions at once in the plant, with all solvers; what they refuse."""

import dataclasses
import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import (
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
    Solver,
    SpringLoad,
    SupplyUnit,
    balanced_state,
    paper_parameters,
)
from hil_bench.plants.hydraulic_cylinder.model.constants import pack, pack_extended
from hil_bench.plants.hydraulic_cylinder.model.extended_midpoint import advance_extended_midpoint
from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import advance_implicit_midpoint
from hil_bench.plants.hydraulic_cylinder.model.kernel import make_row

EULER = Solver.FORWARD_EULER
PAPER = PlantOptions.paper()
BENCH = PlantOptions.bench()
EVERYTHING = dataclasses.replace(
    BENCH,
    C_LA=1e-12,
    C_LB=2e-12,
    air=EntrainedAir(air_fraction=0.01),
    bristles=LuGreFriction(),
    supply=SupplyUnit(),
    loads=(
        ConstantLoad(200.0),
        SpringLoad(2e4, 0.01),
        MassOnSlope(30.0, 0.3),
        LoadSeries((0.0, 0.3, 0.3, 1.0), (0.0, 500.0, -500.0, 0.0)),
    ),
)


@pytest.mark.parametrize("options", [PAPER, BENCH])
def test_with_everything_off_the_bits_are_those_of_the_plain_kernel(paper, options):
    plain, extended = advance_implicit_midpoint, advance_extended_midpoint
    leaky = dataclasses.replace(paper, C_L=1e-12)
    start = balanced_state(leaky)
    state, longer = make_row((*start, 0.0)), make_row((*start, 0.0, 0.0, paper.P_S, *[0.0] * 5))
    row, longer_row = (
        make_row(pack(leaky, options, 1e-4)),
        make_row(pack_extended(leaky, options, 1e-4)),
    )
    for u, F_L in ((1.3e-3, 0.0), (-1.3e-3, 6e4), (1e-3, -6e4), (2e-4, 100.0)):
        assert plain(state, row, u, F_L, 5000) == extended(longer, longer_row, u, F_L, 5000)
        assert [state[i] for i in range(8)] == [longer[i] for i in range(8)]
    assert longer[10] == paper.P_S


def test_a_series_goes_on_where_the_state_says(paper):
    ramp = LoadSeries((0.0, 1.0), (0.0, 1000.0))
    options = dataclasses.replace(EVERYTHING, loads=(ramp,))
    whole = FullOrderPlant(paper, options=options)
    whole.step(PlantInput(1e-3), 500)
    halves = FullOrderPlant(paper, options=options, state=whole.state, extension=whole.extension)
    expected, found = (plant.step(PlantInput(1e-3), 500) for plant in (whole, halves))
    assert found == pytest.approx(expected, rel=1e-9)


def test_midpoint_is_of_second_order_with_everything_on(paper):
    # A motion without kinks: sliding, relief valve shut, load series smooth.
    supply = SupplyUnit(relief_pressure=2e7)
    options = dataclasses.replace(EVERYTHING, supply=supply)
    setup = FullOrderPlant(paper, options=options, dt=1e-5)
    setup.step(PlantInput(1e-3), 5_000)

    def end(dt):
        plant = FullOrderPlant(
            paper, options=options, dt=dt, state=setup.state, extension=setup.extension
        )
        plant.step(PlantInput(8e-4), round(0.02 / dt))
        return (*plant.state[:4], *plant.extension[1:3])

    ends = [end(dt) for dt in (2e-4, 1e-4, 5e-5, 2.5e-5)]
    for quantity in zip(*ends, strict=True):
        steps = [b - a for a, b in itertools.pairwise(quantity)]
        for coarse, fine in itertools.pairwise(steps):
            assert 3.0 < coarse / fine < 5.0


def test_both_solvers_tell_the_same(paper):
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
    | st.builds(LuGreFriction, sigma_0=st.floats(1e3, 1e12), sigma_1=st.floats(0.0, 4000.0)),
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
    options=option_sets, E=st.floats(1e7, 2e9), history=st.lists(inputs, min_size=1, max_size=15)
)
def test_midpoint_stays_finite_whatever_is_on(options, E, history):
    oil = dataclasses.replace(paper_parameters(), E=E)
    plant = FullOrderPlant(oil, options=options, state=balanced_state(oil))
    for u, F_L in history:
        output = plant.step(PlantInput(u, F_L), 100)
        assert all(map(math.isfinite, (*plant.state, *output, *plant.extension[:-1])))


def test_forward_euler_is_refused_where_an_extension_makes_it_unstable(paper):
    # Relief valve: 2 C_S / G with C_S = V_line / E: 2 * 1e-14 / 2e-9 = 1e-5 s
    tight = dataclasses.replace(PAPER, supply=SupplyUnit(line_volume=1e-6, accumulator_volume=0.0))
    with pytest.raises(ParameterError, match=r"; \S+ s or less"):
        FullOrderPlant(paper, options=tight, solver=EULER)
    FullOrderPlant(paper, options=tight, solver=EULER, dt=0.99e-5)


def test_a_load_mass_counts_for_that_limit(paper):
    # 2 (m + 5 kg) / (400 F_s + sigma) = 50 / 3.62e5 = 1.381e-4 s
    options = dataclasses.replace(PAPER, loads=(MassOnSlope(5.0),))
    FullOrderPlant(paper, options=options, solver=EULER, dt=1.38e-4)
    with pytest.raises(ParameterError, match=r"0\.000138 s or less"):
        FullOrderPlant(paper, options=options, solver=EULER, dt=1.39e-4)


def test_refuses_bristles_without_coulomb_friction(paper):
    smooth = dataclasses.replace(paper, F_c=0.0)
    options = dataclasses.replace(PAPER, bristles=LuGreFriction())
    with pytest.raises(ParameterError, match=r"^F_c = 0 N: must be greater than 0 for LuGre"):
        FullOrderPlant(smooth, options=options)


def test_refuses_two_series():
    series = LoadSeries((0.0,), (1.0,))
    with pytest.raises(ParameterError, match=r"^load_series = several: must be one"):
        PlantOptions(loads=(series, series))


def test_refuses_a_senseless_extension_state(paper):
    with pytest.raises(ParameterError, match=r"^z_f = nan m: must be finite"):
        FullOrderPlant(paper, options=EVERYTHING, extension=ExtensionState(0.0, math.nan, 1e7))


def test_without_extensions_there_is_their_start(paper):
    plant = FullOrderPlant(paper)
    plant.step(PlantInput(1e-3), 100)
    assert plant.extension == ExtensionState(0.0, 0.0, paper.P_S)
