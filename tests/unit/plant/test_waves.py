"""Lines by themselves: wave time, reflection, water hammer, pressure drop and volume."""

import math
from itertools import pairwise

import pytest

from hil_bench.plants.hydraulic_cylinder.model.kernel import make_row
from hil_bench.plants.hydraulic_cylinder.model.waves import (
    LAMINAR,
    QUEUE,
    TURBULENT,
    Line,
    arrive,
    cylinder_end,
    depart,
    friction_ratio,
    korteweg,
    line_constants,
    valve_end,
)

RHO = 850.0
DT = 5e-5
# c = sqrt(E / rho) = 1000 m/s, so a wave takes 4 ms through 4 m: 80 steps of 50 us.
LINE = Line(length=4.0, inner=0.0125, bulk_modulus=RHO * 1e6, viscosity=46e-6)
Z = RHO * 1000.0 / (math.pi / 4.0 * 0.0125**2)


class Pipe:
    """A line whose ends are given what a test wants of them."""

    def __init__(self, pressure=0.0, flow=0.0, *, friction=False):
        n, impedance, half, per_flow = line_constants(LINE, RHO, DT)
        self.constants = (n, impedance, half if friction else 0.0, per_flow)
        self.n = int(self.constants[0])
        self.row = make_row([0.0] * QUEUE + [pressure] * (2 * self.n))
        for place in range(self.n):  # a steady flow from valve to cylinder, without friction
            self.row[QUEUE + 2 * place] = pressure - self.constants[1] * flow
            self.row[QUEUE + 2 * place + 1] = pressure + self.constants[1] * flow

    def step(self, at_valve, at_cylinder):
        """Move on by a step; each end gives its flow from (c, p over q). Returns both pressures."""
        side = arrive(self.row, 0, 0, QUEUE, self.constants)
        flows = at_valve(side[0], side[2]), at_cylinder(side[1], side[3])
        depart(self.row, 0, 0, QUEUE, flows, self.constants)
        return side[0] + side[2] * flows[0], side[1] + side[3] * flows[1]

    @property
    def content(self):
        """What it holds beyond its volume at pressure 0 [m³]."""
        waves = sum(self.row[QUEUE + place] for place in range(2 * self.n))
        return DT / (2.0 * self.constants[1]) * waves


def given(flow):
    return lambda *_: flow


closed = given(0.0)


def held(pressure):
    return lambda c, resistance: (pressure - c) / resistance


def through(resistance):
    """An end behind which a resistance leads to pressure 0."""
    return lambda c, own: -c / (own + resistance)


def test_impedance_and_wave_time_are_those_of_the_line():
    assert LINE.wave_time(RHO) == pytest.approx(4e-3)
    assert line_constants(LINE, RHO, DT)[:2] == (80.0, pytest.approx(Z))


def test_a_wave_arrives_after_l_over_c_and_is_back_after_twice_that():
    pipe = Pipe()
    seen = [pipe.step(given(1e-5 if k == 0 else 0.0), closed) for k in range(200)]
    assert [k for k, (_, far) in enumerate(seen) if far] == [80]
    assert [k for k, (near, _) in enumerate(seen) if near] == [0, 160]


@pytest.mark.parametrize(
    ("end", "coefficient"),
    [
        (closed, 1.0),
        (held(0.0), -1.0),
        (through(Z), 0.0),
        (through(3.0 * Z), 0.5),  # (R - Z) / (R + Z)
        (through(Z / 3.0), -0.5),
    ],
)
def test_what_returns_is_the_reflection_coefficient_of_the_end(end, coefficient):
    pipe = Pipe()
    pulse = 1e-5
    seen = [pipe.step(given(pulse if k == 0 else 0.0), end)[0] for k in range(161)]
    assert seen[0] == pytest.approx(Z * pulse)
    # at the closed valve's end the wave that comes back stands twice as high
    assert seen[160] == pytest.approx(2.0 * coefficient * Z * pulse, abs=1e-6 * Z * pulse)


def test_a_flow_that_stops_makes_the_pressure_of_joukowsky():
    """dp = rho c dv: 3 m/s at 1000 m/s and 850 kg/m³ are 25.5 bar, for 2 L / c = 8 ms."""
    flow = 3.0 * LINE.area
    pipe = Pipe(pressure=100e5, flow=flow)
    assert pipe.step(held(100e5), given(-flow)) == pytest.approx((100e5, 100e5))
    rises = [pipe.step(held(100e5), closed)[1] - 100e5 for _ in range(320)]
    assert rises[:160] == pytest.approx([25.5e5] * 160)
    assert rises[160:] == pytest.approx([-25.5e5] * 160)


def test_the_laminar_drop_is_that_of_hagen_and_poiseuille():
    """128 mu L Q / (pi d⁴) with 0.0391 Pa s: 0.2 l/s in 4 m of 12.5 mm lose 52.2 kPa (Re 443)."""
    pipe = Pipe(friction=True)
    for _ in range(4000):
        near, far = pipe.step(given(2e-4), through(Z))
    assert near - far == pytest.approx(128.0 * 0.0391 * 4.0 * 2e-4 / (math.pi * 0.0125**4))
    assert near - far == pytest.approx(52.2e3, rel=1e-3)


def test_the_turbulent_drop_is_that_of_blasius():
    """lambda L / d rho v² / 2 with lambda = 0.3164 / Re^0.25, at 4 l/s in the same hose."""
    flow, thin = 4e-3, 46e-6
    v = flow / LINE.area
    factor = 0.3164 / (v * 0.0125 / thin) ** 0.25
    pipe = Pipe(friction=True)
    for _ in range(4000):
        near, far = pipe.step(given(flow), through(Z))
    assert near - far == pytest.approx(factor * 4.0 / 0.0125 * 0.5 * RHO * v * v, rel=1e-6)


def test_the_friction_factor_has_no_jump():
    for limit in (LAMINAR, TURBULENT):
        below, above = (friction_ratio(limit * (1.0 + each)) for each in (-1e-9, 1e-9))
        assert above == pytest.approx(below, rel=1e-7)
    assert friction_ratio(1000.0) == 1.0
    ratios = [friction_ratio(50.0 * k) * 50.0 * k for k in range(200)]
    assert ratios == sorted(ratios)


def test_what_flows_in_is_what_it_holds():
    pipe = Pipe(pressure=50e5, friction=True)
    entered, before = 0.0, pipe.content
    assert before == pytest.approx(LINE.volume * 50e5 / LINE.bulk_modulus)
    for k in range(1000):
        flows = 1e-3 * math.sin(0.01 * k), -4e-4 * math.cos(0.003 * k * k)
        pipe.step(given(flows[0]), given(flows[1]))
        entered += DT * sum(flows)
    assert pipe.content - before == pytest.approx(entered, rel=1e-9)


def test_a_closed_line_swings_at_c_over_twice_its_length():
    pipe = Pipe()
    pipe.step(given(1e-4), closed)
    seen = [pipe.step(closed, closed)[0] for _ in range(1600)]
    peaks = [k for k, each in enumerate(seen) if each > 0.5 * max(seen)]
    assert {after - before for before, after in pairwise(peaks)} == {160}


ORIFICE = (6e-4, 200e5, 0.0, 0.0, 1.0)


def test_an_edge_and_a_line_pass_the_same_flow():
    """Behind the edge p = c + Z q and q = K a sqrt(P_S - p): a quadratic in q."""
    side = (50e5, 0.0, Z, Z, 0.0)
    p, flow, fed, *_ = valve_end(50e5, side, (1e-3, 0.0), math.inf, -1e5, DT, ORIFICE)
    gain = (6e-4 * 1e-3) ** 2
    expected = 0.5 * (-gain * Z + math.sqrt(gain * gain * Z * Z + 4.0 * gain * 150e5))
    assert flow == pytest.approx(expected, rel=1e-9)
    assert fed == pytest.approx(flow, rel=1e-9)
    assert p == pytest.approx(50e5 + Z * expected)


@pytest.mark.parametrize("to_tank", [0.0, 3e-4])
def test_flows_at_the_valve_rise_with_the_supply_as_their_slopes_say(to_tank):
    side, openings = (50e5, 0.0, Z, Z, 0.0), (1e-3, to_tank)
    p, flow, fed, slope, slope_fed, _ = valve_end(50e5, side, openings, math.inf, -1e5, DT, ORIFICE)
    more = valve_end(p, side, openings, math.inf, -1e5, DT, (6e-4, 200.1e5, 0.0, 0.0, 1.0))
    assert slope == pytest.approx((more[1] - flow) / 1e4, rel=1e-3)
    assert slope_fed == pytest.approx((more[2] - fed) / 1e4, rel=1e-3)


def test_a_line_that_is_drawn_empty_has_a_cavity_at_the_shut_valve():
    """c = -20 bar behind a shut valve: at -1 bar the line draws 19 bar / Z from the cavity."""
    side = (-20e5, 0.0, Z, Z, 0.0)
    p, flow, *_, cavity = valve_end(0.0, side, (0.0, 0.0), math.inf, -1e5, DT, ORIFICE)
    assert (p, flow) == (-1e5, pytest.approx(19e5 / Z))
    assert cavity == pytest.approx(DT * 19e5 / Z)
    back = (30e5, 0.0, Z, Z, cavity)
    p, flow, *_, left = valve_end(0.0, back, (0.0, 0.0), math.inf, -1e5, DT, ORIFICE)
    assert left == 0.0
    assert flow == pytest.approx(-cavity / DT)
    assert p == pytest.approx(30e5 - 19e5)


def test_oil_that_leaves_through_a_resistance_loses_its_square_too():
    """drop = Z q + (r q)², with q = 1 l/s and r² q² = 10 bar."""
    root = math.sqrt(10e5) / 1e-3
    flow, secant, tangent = cylinder_end(Z * 1e-3 + 10e5, (0.0, 0.0, Z, Z, 0.0), root)
    assert flow == pytest.approx(-1e-3)
    assert secant == pytest.approx(1e-3 / (Z * 1e-3 + 10e5))
    assert tangent == pytest.approx(1.0 / (Z + 2.0 * root * root * 1e-3))
    assert cylinder_end(1e5, (0.0, 2e5, Z, Z, 0.0), math.inf)[0] == pytest.approx(1e5 / Z)
    assert cylinder_end(3e5, (0.0, 2e5, Z, Z, 0.0), math.inf) == (0.0, 0.0, 0.0)


def test_a_thin_wall_softens_the_oil_by_korteweg():
    """1 / 1400 + 16 / (2 x 206000) per MPa: 1328 MPa."""
    assert korteweg(1400e6, 0.016, 0.002, 206e9) == pytest.approx(1327.8e6, rel=1e-4)
