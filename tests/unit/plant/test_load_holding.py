"""Counterbalance valves and pumps that swivel."""

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil_bench import VirtualBench, load_config
from hil_bench.errors import ConfigError, ParameterError
from hil_bench.plants.hydraulic_cylinder.model.constants import ExtensionState
from hil_bench.plants.hydraulic_cylinder.model.extensions import (
    CounterbalanceValve,
    MeteringLands,
    SupplyUnit,
    VariablePump,
)
from hil_bench.plants.hydraulic_cylinder.model.full_order import FullOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.orifice import lag, move_valves
from hil_bench.plants.hydraulic_cylinder.model.parameters import paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.reduced_order import ReducedOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.state import PlantInput, PlantState
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion
from hil_bench.plants.hydraulic_cylinder.model.stepping import Solver

# With guides that damp and a valve that opens slowly: others let a load swing, as they do.
HEAVY = {"h": 1.0, "V_A0": 6e-3, "V_B0": 6e-3, "m": 500.0, "sigma": 4e4, "F_s": 600.0}
P = replace(paper_parameters(), P_S=200e5, E=1e9, **HEAVY)
WEIGHT = 40e3  # 80 bar under the piston
VALVE = CounterbalanceValve(
    in_line_a=True,
    setting=110e5,
    pilot_ratio=1.0,
    span=100e5,
    conductance=1e-3 / math.sqrt(15e5),
    time_constant=0.05,
)
MOBILE = MeteringLands(overlap_at=-0.1e-3, overlap_bt=-0.1e-3)  # the centre lets both to the tank
TURBULENT = replace(PlantOptions.bench(), laminar_transition=0.0)
HOLDING = replace(TURBULENT, counterbalance=VALVE, lands=MOBILE)
LOAD_SENSING = SupplyUnit(
    relief_pressure=200e5,
    accumulator_volume=0.0,
    precharge_pressure=0.0,
    variable=VariablePump(senses_load=True),
)


def plant(options, *, P_A=80e5, P_B=1e5, x=0.0, **extra):
    state = PlantState(x, 0.0, P_A, P_B, 0.0, 0.0)
    return FullOrderPlant(P, options=options, state=state, **extra)


def test_a_shut_valve_holds_the_load_which_sinks_without_it():
    assert abs(plant(HOLDING).step(PlantInput(0.0, WEIGHT), 40_000).x) < 1e-3
    assert (
        plant(replace(HOLDING, counterbalance=None)).step(PlantInput(0.0, WEIGHT), 4000).x < -0.005
    )


def test_the_pilot_that_lowers_a_load_is_setting_less_load_over_ratio_and_areas():
    """P_B = (P_set + y span - F' / A_A) / (R + A_B / A_A) with F' = F - f(v), at a slow speed."""
    lowering = plant(HOLDING, P_B=15e5, x=0.5)
    output = lowering.step(PlantInput(-0.36e-3, WEIGHT), 60_000)
    share = lowering.extension.Y_A
    held = WEIGHT - P.F_c - P.sigma * abs(output.v)
    opened = VALVE.setting + share * VALVE.span
    pilot = (opened - held / P.A_A) / (VALVE.pilot_ratio + P.A_B / P.A_A)
    assert -0.06 < output.v < -0.02
    assert 0.02 < share < 0.9
    assert pytest.approx(pilot, rel=2e-3) == output.P_B
    # and with the flow of the orifices: in through P-B, out through valve and A-T in series
    fed = P.K * 0.06e-3 * math.sqrt(P.P_S - output.P_B)
    assert -output.v * P.A_B == pytest.approx(fed, rel=2e-3)


def test_the_valve_opens_without_pilot_at_its_setting():
    """A load of 120 bar on a valve set to 110 bar opens a tenth of 100 bar."""
    locked = plant(replace(HOLDING, lands=MeteringLands(overlap_at=0.2e-3)), P_A=120e5, P_B=0.0)
    locked.step(PlantInput(0.0, 60e3), 10_000)
    share = (locked.output.P_A + locked.output.P_B - 110e5) / 100e5
    assert locked.extension.Y_A == pytest.approx(share, rel=1e-3)
    assert 0.05 < share < 0.15


def test_lifting_is_as_free_as_without_the_valve():
    found = plant(HOLDING, x=-0.5).step(PlantInput(1e-3, WEIGHT), 20_000)
    wanted = plant(replace(HOLDING, counterbalance=None), x=-0.5).step(
        PlantInput(1e-3, WEIGHT), 20_000
    )
    assert found.v == pytest.approx(wanted.v, rel=1e-6)


def test_the_steady_motion_of_the_summary_is_what_the_plant_does():
    expected = steady_motion(P, HOLDING, extends=False, z=0.2e-3, load=WEIGHT)
    lowering = plant(HOLDING, x=0.9, P_A=expected.P_A, P_B=expected.P_B)
    output = lowering.step(PlantInput(-0.5e-3, WEIGHT), 60_000)
    assert -output.v == pytest.approx(expected.speed, rel=2e-3)
    assert pytest.approx(expected.P_B, rel=1e-2) == output.P_B
    assert pytest.approx(expected.P_A, rel=1e-2) == output.P_A


@pytest.mark.parametrize("load", [0.0, 20e3, 60e3])
def test_a_load_sensing_pump_stands_its_margin_above_each_load(load):
    """P_S = P_A + 20 bar and v = K z sqrt(20 bar) / A_A; 20 bar in the centre."""
    lifting = plant(replace(TURBULENT, supply=LOAD_SENSING), P_A=load / P.A_A, x=-0.8)
    lifting.step(PlantInput(0.0, load), 60_000)
    assert lifting.extension.P_S == pytest.approx(20e5, rel=2e-2)
    output = lifting.step(PlantInput(0.5e-3, load), 60_000)
    assert lifting.extension.P_S - output.P_A == pytest.approx(20e5, rel=5e-3)
    assert output.v == pytest.approx(P.K * 0.2e-3 * math.sqrt(20e5) / P.A_A, rel=5e-3)


def test_a_pressure_compensated_pump_holds_its_pressure_and_gives_what_is_drawn():
    pump = VariablePump(senses_load=False)
    unit = replace(LOAD_SENSING, variable=pump)
    lifting = plant(replace(TURBULENT, supply=unit), x=-0.8)
    output = lifting.step(PlantInput(0.5e-3, WEIGHT), 60_000)
    assert lifting.extension.P_S == pytest.approx(200e5, rel=2e-3)
    leak = pump.leakage * lifting.extension.P_S
    assert lifting.extension.Q_P == pytest.approx(output.Q_A + leak, rel=2e-3)


def test_a_pump_gives_no_more_than_it_has():
    small = replace(LOAD_SENSING, pump_flow=1e-4)
    output = plant(replace(TURBULENT, supply=small), x=-0.8).step(PlantInput(2e-3, 0.0), 60_000)
    assert output.v == pytest.approx(1e-4 / P.A_A, rel=2e-2)


def test_the_lag_is_of_second_order_and_never_overshoots():
    def after(steps):
        share = 0.0
        for _ in range(steps):
            share = lag(share, 1.0, 0.5 * (0.01 / steps) / 0.01)[1]
        return abs(share - (1.0 - math.exp(-1.0)))

    assert 3.8 < after(10) / after(20) < 4.2
    valve = (1.0, 0.0, 110e5, 3.0, 1.0 / 30e5, 1e-4, 1e6)
    _, end = move_valves((0.0, 0.0), (200e5, 0.0), 5e-5, valve)
    assert end == (1.0, 0.0)


def test_each_valve_has_a_state_and_a_pilot_of_its_own():
    """By hand: A (30 + 2 x 50 - 110) / 40 = 0.5, B (50 + 2 x 30 - 110) / 40 = 0; k = 0.25."""
    valve = (1.0, 1.0, 110e5, 2.0, 1.0 / 40e5, 1e-4, 1.0)
    middle, end = move_valves((0.25, 0.5), (30e5, 50e5), 0.5, valve)
    assert middle == pytest.approx(((0.25 + 0.25 * 0.5) / 1.25, 0.5 / 1.25))
    assert end == pytest.approx((2.0 * 0.3 - 0.25, 2.0 * 0.4 - 0.5))
    for only in (0, 1):
        there = (1.0 - only, float(only))
        middle, end = move_valves((0.25, 0.5), (30e5, 50e5), 0.5, (*there, *valve[2:]))
        assert middle[1 - only] == end[1 - only] == 0.0
        assert end[only] == pytest.approx((0.35, 0.3)[only])


def test_the_step_is_of_second_order_with_all_of_it_on():
    options = replace(HOLDING, supply=LOAD_SENSING, counterbalance=replace(VALVE, in_line_b=True))
    setup = plant(options, x=0.5, P_A=60e5, P_B=20e5, dt=1e-5)
    setup.step(PlantInput(-0.6e-3, 30e3), 40_000)

    def end(dt):
        again = FullOrderPlant(
            P, options=options, dt=dt, state=setup.state, extension=setup.extension
        )
        output = again.step(PlantInput(-0.7e-3, 30e3), round(0.016 / dt))
        return output.P_A, output.P_B, *again.extension[2:4]

    ends = [end(dt) for dt in (2e-4, 1e-4, 5e-5)]
    for coarse, middle, fine in zip(*ends, strict=True):
        assert 3.0 < (middle - coarse) / (fine - middle) < 5.0


@settings(max_examples=20, deadline=None)
@given(
    setpoints=st.lists(st.floats(-2e-3, 2e-3), min_size=1, max_size=5),
    load=st.floats(-9e4, 9e4),
    setting=st.floats(1e5, 3e7),
    ratio=st.floats(0.0, 20.0),
    span=st.floats(1e3, 1e7),
    times=st.tuples(st.floats(1e-6, 1.0), st.floats(1e-4, 1.0)),
    volume=st.floats(1e-6, 1e-2),
)
def test_nothing_leaves_the_finite_numbers(setpoints, load, setting, ratio, span, times, volume):
    valve = CounterbalanceValve(
        in_line_a=True,
        in_line_b=True,
        setting=setting,
        pilot_ratio=ratio,
        span=span,
        conductance=1e-6,
        time_constant=times[0],
    )
    pump = VariablePump(senses_load=True, swivel_time=times[1])
    unit = replace(LOAD_SENSING, variable=pump, line_volume=volume)
    moving = plant(replace(HOLDING, counterbalance=valve, supply=unit, compensator_margin=1e6))
    for setpoint in setpoints:
        moving.step(PlantInput(setpoint, load), 400)
        assert abs(moving.output.v) < 20.0
        assert 0.0 <= moving.extension.Y_A <= 1.0
        assert 0.0 <= moving.extension.Q_P <= unit.pump_flow
        assert moving.extra_evaluations <= 84 * 400 * len(setpoints)


def test_a_plant_goes_on_from_the_states_of_its_components():
    options = replace(HOLDING, supply=LOAD_SENSING)
    whole = plant(options, x=0.5)
    whole.step(PlantInput(-0.6e-3, 30e3), 500)
    halves = FullOrderPlant(P, options=options, state=whole.state, extension=whole.extension)
    expected, found = (each.step(PlantInput(-0.6e-3, 30e3), 500) for each in (whole, halves))
    assert found == pytest.approx(expected, rel=1e-9)


KEYS = {
    "counterbalance": "a",
    "counterbalance_setting_bar": 210,
    "counterbalance_rated_flow_l_min": 60,
    "counterbalance_rated_drop_bar": 10,
}


def test_a_file_gives_them_by_their_data_sheets():
    keys = KEYS | {"supply": "unit", "pump_control": "load-sensing", "accumulator_volume_l": 0}
    options = load_config(tables={"plant": {"axis1": keys}}).axes[0].options
    assert options.counterbalance == CounterbalanceValve(
        in_line_a=True, setting=210e5, pilot_ratio=3.0, conductance=1e-3 / math.sqrt(10e5)
    )
    assert options.supply.variable.senses_load
    assert options.supply.variable.margin == 20e5


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (
            {"counterbalance": "a"},
            "counterbalance: a valve needs its data; give counterbalance_setting_bar too",
        ),
        ({"counterbalance": "c"}, "counterbalance"),
        (KEYS | {"counterbalance_rated_drop_bar": 0}, "must be greater than 0"),
        (KEYS | {"solver": "runge-kutta"}, "has no counterbalance valve"),
        (KEYS | {"model": "reduced"}, "no place for counterbalance"),
        (
            {"pump_control": "load-sensing"},
            'pump_control: a constant supply has no pump; give supply = "unit" too',
        ),
        (
            {"supply": "unit", "pump_control": "load-sensing", "accumulator_volume_l": 1},
            "accumulator_volume_l: .* must be 0",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(keys, message):
    with pytest.raises(ConfigError, match=message):
        load_config(tables={"plant": {"axis1": keys}})


def test_what_no_plant_can_have_is_refused():
    with pytest.raises(ParameterError, match="must be in a line"):
        replace(VALVE, in_line_a=False)
    with pytest.raises(ParameterError, match="forward-euler has no counterbalance valve"):
        plant(HOLDING, solver=Solver.FORWARD_EULER)
    with pytest.raises(ParameterError, match="no place for counterbalance"):
        ReducedOrderPlant(P, options=PlantOptions(counterbalance=VALVE))
    with pytest.raises(ParameterError, match="Y_A = nan"):
        plant(HOLDING, extension=ExtensionState(0.0, 0.0, 1e7, Y_A=math.nan))


HANGING = """
[plant.axis1]
bore_mm = 63
rod_mm = 36
stroke_mm = 500
rated_flow_l_min = 25
rated_pressure_drop_bar = 5
overlap_percent = 15
frequency_90deg_hz = 60
supply_pressure_bar = 70
tank_pressure_bar = 2
load_mass_kg = 5000
load_slope_deg = {slope}
"""


@pytest.mark.parametrize(("slope", "sides"), [(90, "AB"), (-90, "BA")])
def test_a_load_above_the_supply_starts_behind_the_shut_valve(tmp_path, slope, sides):
    """m g = 49.03 kN is more than 70 bar on either side can push: the oil behind it holds it."""
    (tmp_path / "bench.toml").write_text(HANGING.format(slope=slope))
    with VirtualBench(load_config(tmp_path / "bench.toml")) as bench:
        bench.run(0.1)
        signals = bench.signals
    area_a, area_b = math.pi / 4 * 0.063**2, math.pi / 4 * (0.063**2 - 0.036**2)
    fed, other = (area_a, area_b) if slope > 0 else (area_b, area_a)
    held = (5000 * 9.80665 + 2e5 * other) / fed
    assert signals[f"axis1.P_{sides[0]}"][-1] == pytest.approx(held, rel=1e-3)
    assert signals[f"axis1.P_{sides[1]}"][-1] == pytest.approx(2e5, rel=1e-2)
    assert abs(signals["axis1.position"][-1]) < 1e-5
