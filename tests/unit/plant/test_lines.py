"""Lines between valve and cylinder: the plant with waves in them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model.constants import ExtensionState
from hil_bench.plants.hydraulic_cylinder.model.defects import Defects
from hil_bench.plants.hydraulic_cylinder.model.extensions import (
    CounterbalanceValve,
    Cushion,
    MeteringLands,
    SupplyUnit,
    VariablePump,
)
from hil_bench.plants.hydraulic_cylinder.model.full_order import FullOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.reduced_order import ReducedOrderPlant
from hil_bench.plants.hydraulic_cylinder.model.state import PlantInput, PlantState
from hil_bench.plants.hydraulic_cylinder.model.stepping import Solver
from hil_bench.plants.hydraulic_cylinder.model.waves import CAVITY, QUEUE, Line
from hil_bench.plants.hydraulic_cylinder.resolution import swing_frequency

P = replace(paper_parameters(), P_S=200e5, E=1e9)
# c = 1000 m/s: 6 ms through 6 m, 120 steps of 50 us.
HOSE = Line(length=6.0, inner=0.0125, bulk_modulus=850e6, viscosity=46e-6)
SHORT = replace(HOSE, length=2.0)
BOTH = replace(PlantOptions.bench(), line_a=HOSE, line_b=HOSE)
OIL_ALONE = replace(P, F_c=0.0, F_s=1e-9, sigma=0.0)
STEADY = 8000


def plant(options=BOTH, parameters=P, **extra):
    return FullOrderPlant(parameters, options=options, **extra)


def drop(flow, line):
    """Of Darcy and Weisbach, laminar or by Blasius [Pa]."""
    v = flow / line.area
    reynolds = v * line.inner / line.viscosity
    assert not 2300.0 < reynolds < 4000.0
    factor = 64.0 / reynolds if reynolds < 2300.0 else 0.3164 / reynolds**0.25
    return factor * line.length / line.inner * 0.5 * P.rho * v * v


@pytest.mark.parametrize(
    ("u", "load", "viscosity"), [(0.5e-3, 0.0, 46e-6), (-0.6e-3, 5e3, 46e-6), (0.9e-3, -5e3, 15e-6)]
)
def test_in_steady_motion_edge_and_line_are_in_series(u, load, viscosity):
    line = replace(HOSE, viscosity=viscosity)
    options = replace(BOTH, line_a=line, line_b=line)
    moving = plant(options, state=PlantState(math.copysign(0.19, -u), 0.0, 90e5, 90e5, 0.0, 0.0))
    output = moving.step(PlantInput(u, load), STEADY)
    at_a, at_b = moving.valve_pressures
    z, fed = abs(u) - P.beta, (at_a if u > 0 else at_b)
    flow_a, flow_b = abs(output.v) * P.A_A, abs(output.v) * P.A_B
    inlet, outlet = (flow_a, flow_b) if u > 0 else (flow_b, flow_a)
    # A piston that moves stretches one column of oil and presses the other together: 0.1 %.
    assert inlet == pytest.approx(P.K * z * math.sqrt(P.P_S - fed), rel=2e-3)
    assert outlet == pytest.approx(P.K * z * math.sqrt(at_b if u > 0 else at_a), rel=2e-3)
    sign = math.copysign(1.0, u)
    assert at_a - output.P_A == pytest.approx(sign * drop(flow_a, line), rel=1e-2)
    assert output.P_B - at_b == pytest.approx(sign * drop(flow_b, line), rel=1e-2)


def test_a_valve_that_shuts_makes_the_pressure_of_joukowsky_at_its_port():
    """A-T and P-A shut within 1 ms, long before the wave is back after 12 ms: dp = Z Q."""
    quick = replace(P, omega_0=2e4, m=2000.0)
    thin = replace(HOSE, viscosity=2e-6)
    options = replace(BOTH, line_a=thin, line_b=thin)
    moving = plant(options, quick, state=PlantState(-0.19, 0.0, 90e5, 90e5, 0.0, 0.0))
    moving.step(PlantInput(0.6e-3), STEADY)
    before_a, before_b = moving.valve_pressures
    flow_a, flow_b = moving.output.Q_A, -moving.output.Q_B
    moving.step(PlantInput(0.0), 40)  # 2 ms
    after_a, after_b = moving.valve_pressures
    assert before_a - after_a == pytest.approx(HOSE.impedance(850.0) * flow_a, rel=2e-2)
    assert after_b - before_b == pytest.approx(HOSE.impedance(850.0) * flow_b, rel=2e-2)


def swing(parameters, options, dt):
    """Return the lowest frequency at which the piston swings on a shut valve [Hz]."""
    held = FullOrderPlant(parameters, options=options, dt=dt)
    seen = np.array([held.step(PlantInput(0.0, 10.0)).v for _ in range(round(1.5 / dt))])
    seen = (seen - seen.mean()) * np.blackman(len(seen))
    size = 8 * len(seen)
    lines = np.abs(np.fft.rfft(seen, size))
    peaks = (
        (lines[1:-1] > lines[:-2]) & (lines[1:-1] > lines[2:]) & (lines[1:-1] > lines.max() / 100)
    )
    return (1 + np.argmax(peaks)) / (size * dt)


@pytest.mark.parametrize("lines", [{"line_a": HOSE}, {"line_a": SHORT, "line_b": HOSE}])
def test_the_piston_swings_on_chambers_and_lines(lines):
    """The root of m w² = sum A² / (V / E + tan(w T) / (w Z)): a shut line is tan(w T) / (w Z)."""
    heavy = replace(OIL_ALONE, m=2000.0)
    options = replace(PlantOptions.bench(), **lines)
    assert swing(heavy, options, 1e-4) == pytest.approx(
        swing_frequency(heavy, options, 0.0), rel=5e-3
    )


def test_the_swing_is_far_from_that_of_volumes_alone():
    heavy = replace(OIL_ALONE, m=100.0)
    lumped = math.sqrt(
        sum(A * A / (V / P.E + HOSE.compliance) for A, V in ((P.A_A, P.V_A0), (P.A_B, P.V_B0)))
        / 100.0
    )
    found = swing_frequency(heavy, BOTH, 0.0)
    assert found < 0.85 * lumped / (2.0 * math.pi)
    assert swing(heavy, BOTH, 5e-5) == pytest.approx(found, rel=1e-2)


def content(plant):
    """Return what both lines hold [m³]."""
    waves = plant.extension.waves
    sizes = [round(line.wave_time(P.rho) / plant.dt) for line in (HOSE, SHORT)]
    first = QUEUE + 2 * sizes[0]
    sums = sum(waves[QUEUE:first]), sum(waves[first:])
    # dt / (2 Z) with Z = n dt / C
    return [
        each * line.compliance / (2.0 * n)
        for each, line, n in zip(sums, (HOSE, SHORT), sizes, strict=True)
    ]


def test_on_a_shut_valve_no_oil_is_made_or_lost():
    """A_A dx + V_A / E dP_A + what the line gains is 0, to rounding, in steps without parts."""
    options = replace(PlantOptions.paper(), line_a=HOSE, line_b=SHORT, laminar_transition=300.0)
    held = plant(options, OIL_ALONE)
    turned, lost_a, lost_b = 0.0, 0.0, 0.0
    for k in range(3000):
        before, lines = held.output, content(held)
        after = held.step(PlantInput(0.0, 3e3 if k < 1500 else -2e3))
        gained = [new - old for new, old in zip(content(held), lines, strict=True)]
        middle, moved = before.x + 0.5 * held.dt * before.v, after.x - before.x
        lost_a += (P.V_A0 + P.A_A * middle) / P.E * (after.P_A - before.P_A)
        lost_b += (P.V_B0 - P.A_B * middle) / P.E * (after.P_B - before.P_B)
        lost_a, lost_b = lost_a + P.A_A * moved + gained[0], lost_b - P.A_B * moved + gained[1]
        turned += abs(moved) * P.A_A
    assert held.extra_evaluations == 0
    assert turned > 1e-5
    assert abs(lost_a) < 1e-9 * turned
    assert abs(lost_b) < 1e-9 * turned


def test_what_the_supply_gives_is_in_line_and_chamber():
    """Pump flow less what stays in the supply line enters A's line, to rounding."""
    unit = SupplyUnit(
        pump_flow=4e-4, relief_pressure=190e5, accumulator_volume=0.0, precharge_pressure=0.0
    )
    options = replace(PlantOptions.paper(), line_a=HOSE, line_b=SHORT, supply=unit)
    moving = plant(options, OIL_ALONE, state=PlantState(-0.15, 0.0, 50e5, 53e5, 0.0, 0.0))
    moving.step(PlantInput(0.5e-3), 6000)
    extra, lost, turned = moving.extra_evaluations, 0.0, 0.0
    for k in range(500):
        before, line, P_S = moving.output, content(moving)[0], moving.extension.P_S
        after = moving.step(PlantInput(0.5e-3 + 1e-7 * k))
        given = unit.pump_flow * moving.dt
        kept = unit.line_volume / P.E * (moving.extension.P_S - P_S)
        volume = P.V_A0 + P.A_A * (before.x + 0.5 * moving.dt * before.v)
        pressed = volume / P.E * (after.P_A - before.P_A)
        gained = content(moving)[0] - line
        lost += given - kept - gained - P.A_A * (after.x - before.x) - pressed
        turned += given
    assert moving.extra_evaluations == extra
    assert moving.extension.P_S < unit.relief_pressure
    assert abs(lost) < 1e-9 * turned


def test_what_wears_is_worn_with_lines_too():
    """A leak of chamber B to the tank empties line and chamber behind a shut valve."""
    held = plant()
    before = held.valve_pressures[1]
    held.defects = Defects(leakage_b=1e-10)
    held.step(PlantInput(0.0), 8000)
    assert held.valve_pressures[1] < 0.5 * before
    assert held.valve_pressures[1] == pytest.approx(held.output.P_B, rel=2e-2, abs=2e4)


def test_the_step_is_of_second_order():
    options = replace(
        PlantOptions.paper(), line_a=HOSE, line_b=HOSE, supply=SupplyUnit(relief_pressure=200e5)
    )
    start = PlantState(0.0, 0.0, 90e5, 96e5, 0.3e-3, 0.0)

    def end(dt):
        moving = plant(options, dt=dt, state=start)
        for k in range(20):  # a set-point without a jump
            output = moving.step(PlantInput(0.5e-3 + 0.01e-3 * k), round(0.002 / dt))
        return output.x, output.P_A, output.P_B, moving.extension.P_S, *moving.valve_pressures

    coarse, middle, fine = (end(dt) for dt in (1e-4, 5e-5, 2.5e-5))
    for a, b, c in zip(coarse, middle, fine, strict=True):
        assert abs(c - b) < 0.4 * abs(b - a)


def test_a_line_behind_a_counterbalance_valve_is_empty_of_pressure_at_the_start():
    valve = CounterbalanceValve(in_line_a=True, setting=150e5, pilot_ratio=3.0, conductance=1e-6)
    held = plant(replace(BOTH, counterbalance=valve), state=PlantState(0, 0, 80e5, 0, 0, 0))
    assert held.valve_pressures == (0.0, 0.0)
    output = held.step(PlantInput(0.0, 80e5 * P.A_A), 4000)
    assert abs(output.x) < 1e-3


def test_a_burst_of_the_hose_is_held_by_the_valve_on_the_cylinder():
    """With A's edge open to the tank the line empties, and the load stands on the valve."""
    valve = CounterbalanceValve(in_line_a=True, setting=150e5, pilot_ratio=3.0, conductance=1e-6)
    open_centre = MeteringLands(overlap_at=-0.1e-3)
    options = replace(BOTH, counterbalance=valve, lands=open_centre)
    start = PlantState(0.0, 0.0, 80e5, 0.0, 0.0, 0.0)
    assert abs(plant(options, state=start).step(PlantInput(0.0, 40e3), 4000).x) < 1e-3
    without = replace(options, counterbalance=None)
    assert plant(without, state=start).step(PlantInput(0.0, 40e3), 4000).x < -5e-3


def test_a_column_that_breaks_leaves_a_cavity_at_the_valve_and_never_less_than_vacuum():
    heavy = replace(P, m=3000.0, omega_0=2e4)
    moving = plant(parameters=heavy, state=PlantState(-0.19, 0.0, 90e5, 90e5, 0.0, 0.0))
    moving.step(PlantInput(0.9e-3, 30e3), 6000)
    lowest, largest = 1e9, 0.0
    for _ in range(2000):
        moving.step(PlantInput(0.0, -30e3))
        lowest = min(lowest, *moving.valve_pressures)
        largest = max(largest, moving.extension.waves[CAVITY])
    assert lowest == pytest.approx(-101_325.0)
    assert largest > 1e-7


@settings(max_examples=15, deadline=None)
@given(
    setpoints=st.lists(st.floats(-2e-3, 2e-3), min_size=1, max_size=5),
    load=st.floats(-9e4, 9e4),
    length=st.floats(0.06, 30.0),
    inner=st.floats(3e-3, 50e-3),
    viscosity=st.floats(1e-6, 1e-3),
    line_volume=st.floats(1e-6, 1e-2),
)
def test_nothing_leaves_the_finite_numbers(setpoints, load, length, inner, viscosity, line_volume):
    line = Line(length=length, inner=inner, bulk_modulus=850e6, viscosity=viscosity)
    unit = SupplyUnit(
        relief_pressure=200e5,
        line_volume=line_volume,
        accumulator_volume=0.0,
        precharge_pressure=0.0,
        variable=VariablePump(senses_load=True),
    )
    valve = CounterbalanceValve(in_line_a=True, setting=1e7, pilot_ratio=3.0, conductance=1e-6)
    options = replace(
        BOTH,
        line_a=line,
        counterbalance=valve,
        cushion_b=Cushion(length=0.05, orifice=2e-3),
        lands=MeteringLands(null_opening=5e-6),
        compensator_margin=1e6,
        supply=unit,
    )
    moving = plant(options)
    for setpoint in setpoints:
        output = moving.step(PlantInput(setpoint, load), 400)
        assert abs(output.v) < 20.0
        assert max(map(abs, moving.valve_pressures)) < 1e10


def test_a_plant_goes_on_from_the_waves_under_way():
    whole = plant()
    whole.step(PlantInput(0.8e-3), 333)
    half = plant(state=whole.state, extension=whole.extension)
    expected, found = (each.step(PlantInput(0.8e-3), 500) for each in (whole, half))
    assert found == pytest.approx(expected, rel=1e-9)


def test_steps_in_one_call_or_in_many_are_the_same():
    at_once, one_by_one = plant(), plant()
    at_once.step(PlantInput(0.8e-3), 500)
    for _ in range(500):
        one_by_one.step(PlantInput(0.8e-3), 1)
    assert one_by_one.output == at_once.output
    assert one_by_one.valve_pressures == at_once.valve_pressures


def test_without_a_line_the_port_is_the_chamber():
    one = plant(replace(BOTH, line_b=None))
    output = one.step(PlantInput(0.8e-3), 500)
    assert one.valve_pressures[1] == output.P_B
    assert one.valve_pressures[0] != output.P_A
    without = plant(replace(BOTH, line_a=None, line_b=None)).step(PlantInput(0.8e-3), 500)
    assert (output.nu, output.z) == (without.nu, without.z)  # no line moves the spool


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: replace(HOSE, length=0.0), "length of the line = 0 m: must be greater than 0"),
        (lambda: replace(HOSE, bulk_modulus=math.nan), "bulk_modulus of the line = nan Pa"),
        (
            lambda: plant(replace(BOTH, line_a=replace(HOSE, length=0.04))),
            "line_a = 0.04 m: a wave passes it in 40 us, within one step of 50 us",
        ),
        (lambda: plant(replace(BOTH, line_b=replace(HOSE, length=9e4))), "line_b = 90000 m"),
        (lambda: plant(solver=Solver.RUNGE_KUTTA), "runge-kutta has no lines with waves"),
        (lambda: ReducedOrderPlant(P, options=PlantOptions(line_a=HOSE)), "no place for lines"),
        (
            lambda: plant(extension=ExtensionState(0.0, 0.0, 1e7, waves=(0.0,))),
            "waves = 1 numbers: must be 496 finite ones",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(make, message):
    with pytest.raises(ParameterError, match=message):
        make()
