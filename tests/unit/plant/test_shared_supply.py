"""One supply for several plants: against one unit, one system of equations, and closed forms."""

import math
from dataclasses import replace

import pytest

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.cylinder import FullOrderCylinder
from hil_bench.plants.hydraulic_cylinder.model.extensions import (
    ATMOSPHERE,
    SupplyUnit,
    VariablePump,
)
from hil_bench.plants.hydraulic_cylinder.model.load import ConstantLoad
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.shared_supply import (
    SharedSupply,
    exchange_steps,
    full_draw,
    share_unit,
)
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion
from hil_bench.plants.hydraulic_cylinder.model.supply import OilNow

P = replace(paper_parameters(), E=1.4e9, m=200.0)
DT = 5e-5
TICK = 20
"""Steps of a tick."""
LINE = SupplyUnit(accumulator_volume=0.0, precharge_pressure=0.0)
"""60 l/min, 0.5 l of line, no accumulator."""


def share_out(unit, *, plants=(P, P), exchange=1, options=None, dt=DT, pressure=1e7, shares=None):
    """Return a supply with its plants."""
    options = options or [PlantOptions.bench()] * len(plants)
    shares = shares or [1.0 / len(plants)] * len(plants)
    built = [
        FullOrderCylinder(
            p, options=replace(each, supply=share_unit(unit, share, 1.4e9, p.E)), dt=dt
        )
        for p, each, share in zip(plants, options, shares, strict=True)
    ]
    movers = [(each, each) for each in built]
    return SharedSupply(unit, 1.4e9, pressure, 0.0, movers, shares, exchange), built


def demands(t):
    """Two set-points [m]: one axis starts, the other joins it, the first one turns round."""
    first = 0.0 if t < 0.01 else 1.3e-3 if t < 0.08 else -0.9e-3
    return first, 0.8e-3 if t >= 0.04 else 0.0


@pytest.mark.parametrize("unit", [SupplyUnit(), LINE])
def test_a_plant_alone_has_the_whole_unit_bit_for_bit(unit):
    supply, (plant,) = share_out(unit, plants=(P,), exchange=TICK)
    own = FullOrderCylinder(P, options=replace(PlantOptions.bench(), supply=unit), dt=DT)
    for tick in range(150):
        u, _ = demands(tick * 1e-3)
        supply.drive([u], TICK)
        own.drive(u, TICK)
        assert plant.output == own.output
        assert supply.pressure == own.supply_pressure


def together(paper_rates, unit, milliseconds, dt=2e-5):
    """P_S and both cylinders each ms: eqs. (1)-(13) twice and the supply's, by Runge-Kutta."""
    line, p0 = unit.line_volume / 1.4e9, unit.precharge_pressure + ATMOSPHERE

    def slopes(y, us):
        P_S, cylinders = y[0], (y[1:7], y[7:13])
        parameters = replace(P, P_S=P_S)
        drawn = 0.0
        found = []
        for state, u in zip(cylinders, us, strict=True):
            found += paper_rates(tuple(state), u, 0.0, parameters)
            nu, port = state[4], state[2] if state[4] > 0.0 else state[3]
            z = min(max(abs(nu) - P.beta, 0.0), P.alpha)
            drawn += P.K * z * math.copysign(math.sqrt(abs(P_S - port)), P_S - port)
        p = P_S + ATMOSPHERE
        gas = unit.accumulator_volume * (p0 / p) ** (1.0 / unit.gas_exponent) / unit.gas_exponent
        relief = unit.relief_gradient * max(P_S - unit.relief_pressure, 0.0)
        return [(unit.pump_flow - relief - drawn) / (line + (gas / p if p > p0 else 0.0)), *found]

    start = FullOrderCylinder(P).state[:6]
    y = [1e7, *start, *start]
    rows = [y]
    for ms in range(milliseconds):
        us = demands(ms * 1e-3)
        for _ in range(round(1e-3 / dt)):
            a = slopes(y, us)
            b = slopes([v + 0.5 * dt * k for v, k in zip(y, a, strict=True)], us)
            c = slopes([v + 0.5 * dt * k for v, k in zip(y, b, strict=True)], us)
            d = slopes([v + dt * k for v, k in zip(y, c, strict=True)], us)
            y = [
                v + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
                for v, k1, k2, k3, k4 in zip(y, a, b, c, d, strict=True)
            ]
        rows.append(y)
    return rows


def deviations(unit, reference, exchange):
    """The largest deviations of P_S [bar] and of the positions [um]."""
    supply, plants = share_out(unit, exchange=exchange, options=[PlantOptions.paper()] * 2)
    pressure = way = 0.0
    for ms, row in enumerate(reference[1:]):
        supply.drive(demands(ms * 1e-3), TICK)
        pressure = max(pressure, abs(supply.pressure - row[0]))
        for plant, x in zip(plants, (row[1], row[7]), strict=True):
            way = max(way, abs(plant.output.x - x))
    return pressure * 1e-5, way * 1e6


@pytest.mark.long  # Runge-Kutta of thirteen states in Python
def test_the_plants_move_as_one_system_of_equations(paper_rates):
    """docs/plant.md has these limits: the error of the coupling, a line without an accumulator."""
    reference = together(paper_rates, LINE, 120)
    assert min(row[0] for row in reference) < 40e5
    found = [deviations(LINE, reference, exchange) for exchange in (20, 10, 5)]
    limits = [(3.0, 40.0), (0.6, 8.0), (0.1, 2.0)]
    assert all(
        a < b for each in zip(found, limits, strict=True) for a, b in zip(*each, strict=True)
    )
    with_gas = together(paper_rates, SupplyUnit(), 120)
    assert deviations(SupplyUnit(), with_gas, 20) < (0.01, 0.5)


@pytest.mark.parametrize("exchange", [1, TICK])
def test_no_oil_is_made_or_lost(exchange):
    """Pump = drawn + stored to rounding, while the relief valve is shut."""
    supply, _ = share_out(replace(LINE, relief_pressure=1e8), exchange=exchange, pressure=2e7)
    given = drawn = 0.0
    compliance = LINE.line_volume / 1.4e9
    for tick in range(120):
        before = supply.pressure
        supply.drive(demands(tick * 1e-3), TICK)
        given += 1e-3 * 1e-3
        drawn += 1e-3 * sum(supply.drawn) + compliance * (supply.pressure - before)
    assert drawn == pytest.approx(given, rel=1e-12)


def balances(unit, dt, exchange):
    """How far the balances of oil and energy of all axes are open, over what they turn over."""
    options = [replace(PlantOptions.bench(), laminar_transition=0.0)] * 2
    supply, plants = share_out(unit, exchange=exchange, dt=dt, options=options)
    n, p0 = unit.gas_exponent, unit.precharge_pressure + ATMOSPHERE

    def stored(P_S):
        """Oil [m³] and energy [J] in line and gas, by integrating P dV of p V^n = const."""
        line, p = unit.line_volume / 1.4e9, P_S + ATMOSPHERE
        V = unit.accumulator_volume * (p0 / p) ** (1.0 / n)
        gas = (p * V - p0 * unit.accumulator_volume) / (n - 1.0)
        oil = unit.accumulator_volume - V
        return line * P_S + oil, 0.5 * line * P_S**2 + gas - ATMOSPHERE * oil

    def flows():
        drawn = sum(o.Q_A if o.z > 0.0 else o.Q_B for o in (each.output for each in plants))
        out = unit.relief_gradient * max(supply.pressure - unit.relief_pressure, 0.0) + drawn
        return unit.pump_flow - out, supply.pressure * (unit.pump_flow - out)

    lost, turned, time = [0.0, 0.0], [0.0, 0.0], exchange * dt
    for number in range(round(0.1 / time)):
        before, held = flows(), stored(supply.pressure)
        supply.drive((1.3e-3, 0.8e-3 if number * time >= 0.04 else 0.0), exchange)
        after, holds = flows(), stored(supply.pressure)
        for place in (0, 1):
            entered = 0.5 * time * (before[place] + after[place])
            lost[place] += entered - (holds[place] - held[place])
            turned[place] += abs(entered) + abs(holds[place] - held[place])
    return [abs(one) / whole for one, whole in zip(lost, turned, strict=True)]


def test_oil_and_energy_of_all_axes_are_balanced():
    """By the reported flows and the trapezoidal rule, to second order of step and exchange."""
    unit = replace(SupplyUnit(), accumulator_volume=2e-4)
    coarse, fine = (balances(unit, dt, 1) for dt in (1e-4, 2.5e-5))
    assert max(coarse) < 2e-5
    assert all(b < a / 8.0 for a, b in zip(coarse, fine, strict=True))


def test_two_axes_that_ask_for_more_share_the_flow_by_their_valves():
    """The P_S at which both steady motions draw what the pump gives, by halving."""
    slow = replace(P, w=0.25 * P.w)
    supply, plants = share_out(LINE, plants=(P, slow), exchange=5)
    for _ in range(250):
        supply.drive((1.3e-3, 1.3e-3), TICK)

    def flow(p, P_S):
        still = replace(PlantOptions.bench(), laminar_transition=0.0)
        return steady_motion(replace(p, P_S=P_S), still, extends=True).supply_flow

    low, high = 0.0, 1e7
    for _ in range(60):
        middle = 0.5 * (low + high)
        is_more = flow(P, middle) + flow(slow, middle) > LINE.pump_flow
        low, high = (low, middle) if is_more else (middle, high)
    assert supply.pressure == pytest.approx(low, rel=2e-4)
    for plant, p, drawn in zip(plants, (P, slow), supply.drawn, strict=True):
        assert plant.output.v * p.A_A == pytest.approx(flow(p, low), rel=2e-4)
        assert drawn == pytest.approx(flow(p, low), rel=2e-4)
    assert sum(supply.drawn) == pytest.approx(LINE.pump_flow, rel=1e-5)


@pytest.mark.parametrize("n", [1.0, 1.4])
def test_an_accumulator_feeds_both_axes_along_its_polytrope(n):
    unit = SupplyUnit(
        pump_flow=0.0, line_volume=1e-7, accumulator_volume=1e-3, gas_exponent=n,
        precharge_pressure=5e6,
    )  # fmt: skip
    supply, plants = share_out(unit, exchange=TICK)
    begin = [plant.output for plant in plants]
    for _ in range(200):
        supply.drive((1.3e-3, 0.6e-3), TICK)
    swept = 0.0
    for before, after in zip(begin, (plant.output for plant in plants), strict=True):
        middle = 0.5 * (before.x + after.x)
        swept += P.A_A * (after.x - before.x)
        swept += (P.V_A0 + P.A_A * middle) / P.E * (after.P_A - before.P_A)
    p0 = 5e6 + ATMOSPHERE
    gas = 1e-3 * (p0 / (1e7 + ATMOSPHERE)) ** (1.0 / n)
    expected = p0 * (1e-3 / (gas + swept)) ** n - ATMOSPHERE
    assert swept > 1e-4
    assert supply.pressure == pytest.approx(expected, rel=2e-4)


def test_oil_of_half_the_stiffness_halves_the_rise_of_the_pressure():
    """Valves shut: the pump fills the line, dP/dt = Q E / V."""
    rises = []
    for stiffness in (1.0, 0.5):
        supply, _ = share_out(LINE, pressure=1e6)
        supply.warm(OilNow(stiffness=stiffness), 1.0)
        supply.drive((0.0, 0.0), TICK)
        rises.append(supply.pressure - 1e6)
    assert rises[0] > 1e6
    assert rises[1] == pytest.approx(0.5 * rises[0], rel=0.02)


def test_a_load_sensing_pump_sees_the_highest_load():
    pump = VariablePump(senses_load=True, margin=2e6, leakage=1e-11)
    unit = replace(LINE, relief_pressure=2e7, variable=pump)
    loads = [replace(PlantOptions.bench(), loads=(ConstantLoad(F),)) for F in (5e3, 40e3)]
    plants = (replace(P, P_S=2e7), replace(P, P_S=2e7))
    supply, (light, heavy) = share_out(unit, plants=plants, options=loads, exchange=1)
    for _ in range(300):
        supply.drive((0.5e-3, 0.5e-3), TICK)
    assert heavy.output.P_A > light.output.P_A + 30e5
    leaked = unit.variable.leakage * supply.pressure
    assert supply.flow == pytest.approx(sum(supply.drawn) + leaked, rel=1e-3)
    assert supply.pressure == pytest.approx(heavy.output.P_A + 2e6, rel=1e-3)
    for _ in range(300):
        supply.drive((0.5e-3, 0.0), TICK)
    assert supply.pressure == pytest.approx(light.output.P_A + 2e6, rel=1e-3)
    for _ in range(800):
        supply.drive((0.0, 0.0), TICK)
    assert supply.pressure == pytest.approx(2e6, rel=1e-3)


@pytest.mark.parametrize("volume", [1e-8, 1e-5, 5e-4])
@pytest.mark.parametrize("transition", [0.0, 300.0])
def test_no_consumer_makes_it_unstable(volume, transition):
    """Both pistons at their stops: two chambers of 2.2 l behind wide open edges, and a line."""
    still = replace(PlantOptions.bench(), laminar_transition=transition)
    supply, plants = share_out(
        replace(LINE, line_volume=volume), exchange=TICK, options=[still] * 2
    )
    for _ in range(2500):
        supply.drive((1.3e-3, 1.3e-3), TICK)
    rest = LINE.relief_pressure + LINE.pump_flow / LINE.relief_gradient
    assert plants[0].output.x > P.h
    assert supply.pressure == pytest.approx(rest, rel=1e-3)
    assert [plant.output.P_A for plant in plants] == pytest.approx([rest] * 2, rel=1e-3)


def test_the_time_between_exchanges_follows_from_what_the_valves_can_draw():
    draws = [full_draw(P, PlantOptions.bench(), 1e7)] * 2
    # K alpha sqrt(P_R / 2): 0.65 * 0.02 m * sqrt(2 / 850) * 1e-3 m * sqrt(50 bar)
    assert draws[0] == pytest.approx(
        0.65 * 0.02 * math.sqrt(2.0 / 850.0) * 1e-3 * 2236.07, rel=1e-5
    )
    # 2.8 l/s change 0.5 l / 1.4 GPa by 10 % of 100 bar in 127 us: two steps
    assert exchange_steps(LINE, 1.4e9, draws, DT, TICK) == 2
    # four times that in 2 l: 507 us, of whose ten steps a tick's are a multiple
    assert exchange_steps(replace(LINE, line_volume=2e-3), 1.4e9, draws, DT, TICK) == 10
    assert exchange_steps(replace(LINE, line_volume=5e-5), 1.4e9, draws, DT, TICK) == 1
    # V_gas / (n p) at 100 bar is 0.7 l / 140 bar: 18 ms
    assert exchange_steps(SupplyUnit(), 1.4e9, draws, DT, TICK) == TICK
    # 2.8 l/s * 50 us * 1.4 GPa / 50 bar
    with pytest.raises(ParameterError, match=r"line_volume = 10 cm³: .* at least 39.5 cm³"):
        exchange_steps(replace(LINE, line_volume=1e-5), 1.4e9, draws, DT, TICK)
