"""The reduced model against its printed equations and against closed forms of them."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import (
    ConstantLoad,
    Cushion,
    EntrainedAir,
    FullOrderPlant,
    LoadSeries,
    LuGreFriction,
    MeteringLands,
    PlantInput,
    PlantOptions,
    PlantState,
    ReducedOrderPlant,
    Solver,
    SpringLoad,
    SupplyUnit,
    spool_delay,
)
from hil_bench.plants.hydraulic_cylinder.model.reduced_order import (
    balanced_reduced_state,
    largest_reduced_step,
)

PAPER = PlantOptions.paper()
BENCH = PlantOptions.bench()
Q_L = 6  # field of the output: through port A


def printed_rates(p, u, F_L, y):
    """Return eqs. (2), (13), (14), (16), (17) as printed: rates of x, v, P_L."""
    _, v, P_L = y
    z = math.copysign(min(max(abs(u) - p.beta, 0.0), p.alpha), u)
    K = p.C_d * p.w * math.sqrt(2.0 / p.rho)
    flow = z * K * math.sqrt(0.5 * (p.P_S - np.sign(z) * P_L))
    stribeck = p.F_c + (p.F_s - p.F_c) * math.exp(-((abs(v) / p.chi) ** p.delta))
    f = math.tanh(400.0 * v) * stribeck + p.sigma * v
    area, volume = 0.5 * (p.A_A + p.A_B), p.V_A0 + p.V_B0
    return [v, (P_L * area - f - F_L) / p.m, 4.0 * p.E / volume * (flow - area * v - p.C_L * P_L)]


@pytest.mark.parametrize("u", [8e-4, -1.1e-3, 2e-3])
def test_a_step_response_is_that_of_the_printed_equations(paper, u):
    p = dataclasses.replace(paper, C_L=1e-11)
    plant = ReducedOrderPlant(p, options=PAPER, solver=Solver.RUNGE_KUTTA, dt=1e-5)
    seen = [plant.step(PlantInput(u, 2000.0), 1000) for _ in range(20)]  # every 10 ms

    start = [0.0, 0.0, 0.0]  # no load at the start, so no load pressure
    printed = solve_ivp(
        lambda _, y: printed_rates(p, u, 2000.0, y),
        (0.0, 0.2),
        start,
        "LSODA",
        t_eval=np.arange(1, 21) * 0.01,
        rtol=1e-10,
        atol=[1e-13, 1e-12, 1e-4],
    )
    x, v, P_L = printed.y
    # 1e-9 m, 1e-7 m/s and 1 Pa: far above LSODA's tolerance, 1e-6 of what is seen
    assert [o.x for o in seen] == pytest.approx(x, abs=1e-9)
    assert [o.v for o in seen] == pytest.approx(v, abs=1e-7)
    assert [o.P_A - o.P_B for o in seen] == pytest.approx(P_L, abs=1.0)
    # eq. (15), and the closed circuit of eq. (14)
    assert [o.P_A + o.P_B for o in seen] == pytest.approx([p.P_S] * 20, rel=1e-14)
    assert all(o.Q_A == -o.Q_B for o in seen)


@pytest.mark.parametrize(
    ("solver", "dt", "order"),
    [
        (Solver.FORWARD_EULER, 2e-5, 1),
        (Solver.LINEARLY_IMPLICIT_MIDPOINT, 1e-4, 4),
        (Solver.RUNGE_KUTTA, 2e-4, 4),
    ],
)
def test_a_closed_valve_leaves_eqs_18_to_20(paper, solver, dt, order):
    """With viscous friction alone P_L and v swing at omega_c = 447.43 rad/s, zeta = 0.11175."""
    p = dataclasses.replace(paper, F_c=0.0, F_s=0.0)
    start = PlantState(0.0, 0.0, 5.5e6, 4.5e6, 0.0, 0.0)
    sigma = 50.0  # by hand: sigma / (2 m)
    omega = 2.0 * 4.85e-3 * math.sqrt(1e8 / (2.35e-3 * 20.0))  # eq. (19): 447.43 rad/s
    matrix = np.array([[-2.0 * sigma, p.mean_area / p.m], [-(omega**2) * p.m / p.mean_area, 0.0]])
    v, P_L = expm(matrix * 0.02) @ (0.0, 1e6)
    errors = []
    for step in (dt, dt / 2.0):
        plant = ReducedOrderPlant(p, options=PAPER, solver=solver, dt=step, state=start)
        end = plant.step(PlantInput(0.0), round(0.02 / step))
        errors.append(math.hypot(end.v - v, (end.P_A - end.P_B - P_L) / 2e6))
    scale = math.hypot(v, P_L / 2e6)
    assert math.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)
    assert errors[1] < 0.05 * scale if order == 1 else errors[1] < 2e-3 * scale


@pytest.mark.parametrize("u", [1e-3, -1e-3])
def test_the_steady_velocity_is_where_flow_and_friction_meet(paper, u):
    def excess(v):
        """Q_L - mean area v, with the P_L that friction asks for."""
        f = printed_rates(paper, u, 0.0, np.array([0.0, v, 0.0]))[1] * -paper.m
        P_L = f / 4.85e-3
        return 0.7e-3 * 6.3059e-4 * math.sqrt(0.5 * (1e7 - P_L)) - 4.85e-3 * v

    expected = math.copysign(brentq(excess, 0.1, 0.3), u)  # the model is symmetric
    end = ReducedOrderPlant(paper, options=PAPER).step(PlantInput(u), 5000)
    assert end.v == pytest.approx(expected, rel=2e-5)  # K to five digits
    # model.md: the full model gives about +0.204 and -0.198 m/s; this is between them in size
    assert 0.198 < abs(end.v) < 0.204


def test_a_delay_shifts_everything_by_its_length(paper):
    setpoints = [1e-3, 1e-3, -8e-4, 0.0, 5e-4, 5e-4, 5e-4, -2e-3, 0.0, 0.0]
    prompt = ReducedOrderPlant(paper, dt=1e-4)
    late = ReducedOrderPlant(paper, delay=1.2e-3, dt=1e-4)  # twelve steps
    late.step(PlantInput(setpoints[0]), 10)
    late.step(PlantInput(setpoints[1]), 2)
    shown = []
    for before, after in zip(setpoints[1:], [*setpoints[2:], 0.0], strict=True):
        # Ticks of ten steps: eight more with this set-point, two with the next.
        late.step(PlantInput(before), 8)
        shown.append(late.step(PlantInput(after), 2))
    expected = [prompt.step(PlantInput(u), 10) for u in setpoints[: len(shown)]]
    # The call sees the set-point in force at its end: the last but two.
    assert [o[:4] for o in shown] == [o[:4] for o in expected]


def test_a_delay_does_not_depend_on_how_the_steps_are_grouped(paper):
    whole = ReducedOrderPlant(paper, delay=7e-4)
    single = ReducedOrderPlant(paper, delay=7e-4)
    for u in (1e-3, -1e-3, 4e-4, 4e-4, 0.0):
        whole.step(PlantInput(u), 10)
        for _ in range(10):
            single.step(PlantInput(u), 1)
    assert single.output == whole.output


def test_the_equivalent_delay_has_the_spools_phase_at_low_frequencies(paper):
    # 2 * 0.7 / 1200 s; at 1 Hz the phase of eq. (1) is that of the delay but for the third order
    assert spool_delay(paper) == pytest.approx(1.16667e-3, rel=1e-5)
    s = 2j * math.pi
    spool = 1200.0**2 / (s * s + 2.0 * 0.7 * 1200.0 * s + 1200.0**2)
    assert np.angle(np.exp(-s * spool_delay(paper))) == pytest.approx(np.angle(spool), rel=1e-5)


def test_an_overload_stops_at_the_cavitation_floor(paper):
    for solver in Solver:
        plant = ReducedOrderPlant(paper, options=BENCH, solver=solver, dt=2e-5)
        lowest = min(plant.step(PlantInput(0.0, 9e4), 5).P_B for _ in range(50))
        assert lowest == pytest.approx(-101325.0, rel=1e-9)
        # Closed valve: the oil holds P_L at P_S + 2 * 101325 Pa, 49.48 kN on the mean area.
        held = (1e7 + 2.0 * 101325.0) * 4.85e-3
        before = plant.output.v
        after = plant.step(PlantInput(0.0, 9e4), 1).v
        drag = printed_rates(paper, 0.0, 0.0, np.array([0.0, before, 0.0]))[1]
        assert (after - before) / 2e-5 == pytest.approx((held - 9e4) / 20.0 + drag, rel=1e-2)


def test_the_end_stop_holds_the_piston(paper):
    plant = ReducedOrderPlant(paper, options=BENCH)
    end = plant.step(PlantInput(1.3e-3), 20000)
    # At rest it is P_S * mean area / stiffness deep: 48.5 kN / 2e8 N/m
    assert end.x - 0.2 == pytest.approx(48.5e3 / 2e8, rel=1e-4)
    assert abs(end.v) < 1e-6


def test_loads_add_up_and_hold(paper):
    loads = (ConstantLoad(3000.0), SpringLoad(2e5, -0.01), LoadSeries((0.1, 0.2), (0.0, 500.0)))
    free = dataclasses.replace(paper, F_c=0.0, F_s=0.0)
    for solver in Solver:
        options = dataclasses.replace(BENCH, loads=loads)
        plant = ReducedOrderPlant(free, options=options, solver=solver, dt=5e-5)
        assert plant.output.P_A - plant.output.P_B == pytest.approx(5000.0 / 4.85e-3)  # at x = 0
        plant.step(PlantInput(5e-4), 1000)
        end = plant.step(PlantInput(0.0), 19000)
        force = 3000.0 + 2e5 * (end.x + 0.01) + 500.0
        assert (end.P_A - end.P_B) * 4.85e-3 == pytest.approx(force, rel=1e-6)


def test_the_clamped_root_stops_the_flow_that_the_signed_one_turns_round(paper):
    start = PlantState(0.0, 0.0, 1.2e7, -2e6, 0.0, 0.0)  # P_L = 14 MPa, above P_S
    for signed, expected in ((True, -1e-3 * 6.3059e-4 * math.sqrt(2e6)), (False, 0.0)):
        options = dataclasses.replace(PAPER, signed_root=signed)
        plant = ReducedOrderPlant(paper, options=options, state=start)
        assert plant.step(PlantInput(1.3e-3), 0)[Q_L] == pytest.approx(expected, rel=1e-4)


def test_it_stays_finite_under_any_input(paper):
    source = np.random.default_rng(1)
    plant = ReducedOrderPlant(paper, delay=3e-4)
    for _ in range(500):
        u, F_L = source.uniform(-1.0, 1.0) * 10.0 ** source.uniform(-4, 300, 2)
        assert all(math.isfinite(value) for value in plant.step(PlantInput(u, F_L), 10))


@pytest.mark.parametrize("solver", [Solver.FORWARD_EULER, Solver.RUNGE_KUTTA])
def test_a_swing_decays_below_the_largest_step_and_grows_above(paper, monkeypatch, solver):
    sigma = 2000.0 if solver is Solver.FORWARD_EULER else 1.0
    oil = dataclasses.replace(paper, F_c=0.0, F_s=0.0, E=1e9, w=1e-9, sigma=sigma)
    limit = largest_reduced_step(oil, PAPER, solver)
    omega = 2.0 * 4.85e-3 * math.sqrt(1e9 / (2.35e-3 * 20.0))
    # forward Euler: 2 zeta / omega = sigma / (m omega²); Runge-Kutta: 2 sqrt(2) / omega
    closed = sigma / (20.0 * omega**2) if sigma > 1.0 else 2.0 * math.sqrt(2.0) / omega
    assert limit == pytest.approx(closed, rel=5e-3)
    monkeypatch.setattr(
        "hil_bench.plants.hydraulic_cylinder.model.reduced_order.largest_reduced_step",
        lambda *_: math.inf,
    )

    def largest_velocity(dt):
        start = balanced_reduced_state(oil)._replace(v=1e-4)
        plant = ReducedOrderPlant(oil, options=PAPER, solver=solver, dt=dt, state=start)
        try:
            return max(abs(plant.step(PlantInput(0.0)).v) for _ in range(20000))
        except ParameterError:  # diverged
            return math.inf

    assert largest_velocity(0.98 * limit) < 1.2e-4
    assert largest_velocity(1.05 * limit) > 1.5e-4


def test_an_unstable_step_is_refused_with_one_that_works(paper):
    oil = dataclasses.replace(paper, E=1e9)
    with pytest.raises(ParameterError, match="unstable with these parameters") as refusal:
        ReducedOrderPlant(oil, options=PAPER, solver=Solver.FORWARD_EULER, dt=1e-3)
    named = float(str(refusal.value).split("; ")[1].split()[0])
    ReducedOrderPlant(oil, options=PAPER, solver=Solver.FORWARD_EULER, dt=named)


@pytest.mark.parametrize(
    ("option", "symbol"),
    [
        ({"C_LA": 1e-12}, "C_LA"),
        ({"C_LB": 1e-12}, "C_LB"),
        ({"air": EntrainedAir(air_fraction=0.01)}, "air_fraction"),
        ({"bristles": LuGreFriction()}, "bristles"),
        ({"lands": MeteringLands()}, "lands"),
        ({"compensator_margin": 8e5}, "compensator_margin"),
        ({"cushion_a": Cushion(length=0.01, orifice=1e-3)}, "cushion"),
        ({"cushion_b": Cushion(length=0.01, orifice=1e-3)}, "cushion"),
        ({"supply": SupplyUnit()}, "supply_unit"),
    ],
)
def test_what_needs_the_full_model_is_refused(paper, option, symbol):
    with pytest.raises(ParameterError, match=f"no place for {symbol}: the full-order model"):
        ReducedOrderPlant(paper, options=dataclasses.replace(BENCH, **option))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"P_A": 6e6}, r"P_A \+ P_B = 1.1e\+07 Pa: must be P_S = 1e\+07 Pa, eq. \(15\)"),
        ({"nu_dot": 0.1}, "nu_dot = 0.1 m/s: must be 0"),
        ({"x": 0.21}, r"x = 0.21 m: must lie between the end stops at \+-0.2 m"),
        ({"P_A": 1.1e7, "P_B": -1e6}, "must be at least the cavitation floor, -101325 Pa"),
        ({"v": math.nan}, "v = nan m/s: must be finite"),
    ],
)
def test_a_state_that_the_model_cannot_have_is_refused(paper, change, message):
    state = PlantState(0.0, 0.0, 5e6, 5e6, 0.0, 0.0)._replace(**change)
    with pytest.raises(ParameterError, match=message):
        ReducedOrderPlant(paper, state=state)


def test_tank_pressure_and_long_delays_are_refused(paper):
    with pytest.raises(ParameterError, match="P_T = 100000 Pa: must be 0"):
        ReducedOrderPlant(dataclasses.replace(paper, P_T=1e5))
    with pytest.raises(ParameterError, match="delay = 2 s: must be 1 s or less"):
        ReducedOrderPlant(paper, delay=2.0)
    with pytest.raises(ParameterError, match=r"delay = -0\.001 s: must be 0 or greater"):
        ReducedOrderPlant(paper, delay=-1e-3)


def test_its_state_goes_on_where_another_plant_stopped(paper):
    first = ReducedOrderPlant(paper)
    first.step(PlantInput(1e-3), 137)
    second = ReducedOrderPlant(paper, state=first.state)
    # P_L is rebuilt from both pressures: equal but for their rounding
    assert second.step(PlantInput(-5e-4), 200) == pytest.approx(
        first.step(PlantInput(-5e-4), 200), rel=1e-9
    )


def test_it_is_near_the_full_model_where_its_assumptions_hold(paper):
    """A double rod, equal volumes and a fast spool leave eqs. (14)-(17) of the full model."""
    twin = dataclasses.replace(
        paper, A_A=4.85e-3, A_B=4.85e-3, V_A0=1.175e-3, V_B0=1.175e-3, omega_0=1e5
    )
    full = FullOrderPlant(twin, options=PAPER, dt=5e-5)
    reduced = ReducedOrderPlant(twin, options=PAPER, dt=5e-5)
    for _ in range(20):
        f = full.step(PlantInput(9e-4), 20)
        r = reduced.step(PlantInput(9e-4), 20)
        # x is below 5 mm in 20 ms, so V_A is within 2 % of its mean; the peak is 0.2 m/s
        assert r.v == pytest.approx(f.v, abs=2e-2 * 0.2)
