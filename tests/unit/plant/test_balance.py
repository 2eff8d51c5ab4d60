"""The balances of oil and of energy.

What entered a chamber is displaced, compressed or leaked away.

Eqs. (8), (9), integrated: the volume through a port is A dx + integral of V / E dP + leakage, less
the growth of the cavity where the chamber is at the cavitation floor. Each solver satisfies its own
discrete form of that to rounding, whatever the manoeuvre. The port's volume in a step is dt Q for
forward Euler; for each part of a step of the linearly implicit midpoint it is dt (Q - s dP), with Q
at the start of the part and s its share.
"""

import dataclasses
import math
from typing import NamedTuple

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from hil_bench.plants.hydraulic_cylinder.model import (
    EntrainedAir,
    FullOrderPlant,
    PlantInput,
    PlantOptions,
    PlantState,
    Solver,
    paper_parameters,
)
from hil_bench.plants.hydraulic_cylinder.model.constants import (
    pack_extended,
    unpack,
    unpack_extended,
)
from hil_bench.plants.hydraulic_cylinder.model.extended_midpoint import try_extended
from hil_bench.plants.hydraulic_cylinder.model.kernel import make_row
from hil_bench.plants.hydraulic_cylinder.model.orifice import linearise_flow
from hil_bench.plants.hydraulic_cylinder.model.stepping import implicit_share
from tests.support.plant_parts import made_parts

DT = 1e-4
FLOOR = -101_325.0
OPTIONS = PlantOptions(laminar_transition=300.0)


class Volumes(NamedTuple):
    """Volumes of one chamber in one step [m³].

    entered = displaced + compressed + leaked - opened
    """

    entered: float
    displaced: float
    compressed: float
    leaked: float
    opened: float


def opening(nu, p):
    """Eq. (2) as printed."""
    size = min(max(abs(nu) - p.beta, 0.0), p.alpha)
    return size if nu > 0.0 else -size


def flows(z, before, p):
    orifice = (p.K, p.P_S, p.P_T, 300.0**2, 1.0)
    return linearise_flow(z, before.P_A, orifice), linearise_flow(-z, before.P_B, orifice)


def euler_step(before, after, p, C_LA, C_LB):
    """Everything from the old state."""
    V_A, V_B = p.V_A0 + p.A_A * before.x, p.V_B0 - p.A_B * before.x
    (Q_A, *_), (Q_B, *_) = flows(opening(before.nu, p), before, p)
    leak = p.C_L * (before.P_A - before.P_B)
    moved = after.x - before.x
    rise_A, rise_B = after.P_A - before.P_A, after.P_B - before.P_B
    leaked_A, leaked_B = leak + C_LA * (before.P_A - p.P_T), -leak + C_LB * (before.P_B - p.P_T)
    return (
        Volumes(
            DT * Q_A, p.A_A * moved, V_A / p.E * rise_A, DT * leaked_A, after.V_CA - before.V_CA
        ),
        Volumes(
            DT * Q_B, -p.A_B * moved, V_B / p.E * rise_B, DT * leaked_B, after.V_CB - before.V_CB
        ),
    )


def midpoint_part(before, after, dt, p, C_LA, C_LB):
    """Leakage and volume from the middle of the part."""
    middle = before.x + 0.5 * dt * before.v
    V_A, V_B = p.V_A0 + p.A_A * middle, p.V_B0 - p.A_B * middle
    slopes_A, slopes_B = flows(opening(0.5 * (before.nu + after.nu), p), before, p)
    rise_A, rise_B = after.P_A - before.P_A, after.P_B - before.P_B
    Q_A = slopes_A[0] - implicit_share(*slopes_A[1:], V_A / (p.E * dt)) * rise_A
    Q_B = slopes_B[0] - implicit_share(*slopes_B[1:], V_B / (p.E * dt)) * rise_B
    P_A, P_B = before.P_A + 0.5 * rise_A, before.P_B + 0.5 * rise_B
    leak = p.C_L * (P_A - P_B)
    moved = after.x - before.x
    leaked_A, leaked_B = leak + C_LA * (P_A - p.P_T), -leak + C_LB * (P_B - p.P_T)
    return (
        Volumes(
            dt * Q_A, p.A_A * moved, V_A / p.E * rise_A, dt * leaked_A, after.V_CA - before.V_CA
        ),
        Volumes(
            dt * Q_B, -p.A_B * moved, V_B / p.E * rise_B, dt * leaked_B, after.V_CB - before.V_CB
        ),
    )


def euler_steps(plant, plant_input):
    """Make a step of forward Euler."""
    p, options, before = plant.parameters, plant.options, plant.state
    plant.step(plant_input)
    return [euler_step(before, plant.state, p, options.C_LA, options.C_LB)]


def midpoint_steps(plant, plant_input):
    """Make a step of the linearly implicit midpoint rule, which may be made in parts."""
    p, options, before = plant.parameters, plant.options, plant.state
    row = make_row(pack_extended(p, options, DT))
    constants, extension = unpack(row), unpack_extended(row)

    def attempt(cylinder, spool, shortened):
        others = (0.0, p.P_S, (0.0, 0.0, 0.0))
        moved, _, error = try_extended(
            cylinder, spool, plant_input.F_L, others, shortened, extension
        )
        return moved, error

    plant.step(plant_input)
    start = (*before[:4], *before[6:])
    parts = list(made_parts(attempt, start, (before.nu, plant.state.nu), constants))
    assert parts[-1][1] == (*plant.state[:4], *plant.state[6:])  # the plant made the same parts
    volumes = []
    for begin, end, (nu, nu_end), dt in parts:
        old = PlantState(*begin[:4], nu, 0.0, *begin[4:])
        new = PlantState(*end[:4], nu_end, 0.0, *end[4:])
        volumes.append(midpoint_part(old, new, dt, p, options.C_LA, options.C_LB))
    return volumes


STEPS = {Solver.FORWARD_EULER: euler_steps, Solver.LINEARLY_IMPLICIT_MIDPOINT: midpoint_steps}


@pytest.mark.long
@pytest.mark.parametrize("solver", STEPS)
@settings(max_examples=30)
@given(
    setpoints=st.lists(st.floats(-2e-3, 2e-3), min_size=1, max_size=6),
    loads=st.lists(st.floats(-2e4, 2e4) | st.floats(-9e4, 9e4), min_size=6, max_size=6),
    floor=st.none() | st.sampled_from([0.0, FLOOR]),
    E=st.floats(1e7, 1e8),
    C_L=st.floats(0.0, 1e-11),
    external=st.tuples(st.floats(0.0, 1e-11), st.floats(0.0, 1e-11)),
)
def test_oil_is_neither_made_nor_lost(solver, setpoints, loads, floor, E, C_L, external):
    oil = dataclasses.replace(paper_parameters(), E=E, C_L=C_L, P_T=1e5)
    options = dataclasses.replace(
        OPTIONS, C_LA=external[0], C_LB=external[1], cavitation_floor=floor
    )
    plant = FullOrderPlant(oil, options=options, solver=solver, dt=DT)
    steps = []
    for u, F_L in zip(setpoints, loads, strict=False):
        for _ in range(40):
            steps += STEPS[solver](plant, PlantInput(u, F_L))
    for chamber in zip(*steps, strict=True):
        entered, displaced, compressed, leaked, opened = map(sum, zip(*chamber, strict=True))
        moved = sum(abs(volumes.displaced) + abs(volumes.compressed) for volumes in chamber)
        # The second term is rounding: 240 positions known to 2e-17 m, times the area.
        assert abs(entered - displaced - compressed - leaked + opened) <= 1e-9 * moved + 3e-17


@pytest.mark.parametrize("air", [None, EntrainedAir(air_fraction=0.01)])
def test_the_reported_flows_balance_to_second_order(air):
    # Q_A of the output is of the instant: its trapezoidal sum meets the balance as dt² does.
    paper = paper_parameters()
    options = dataclasses.replace(OPTIONS, air=air)

    def lost(dt):
        plant = FullOrderPlant(paper, options=options, dt=dt)
        plant.step(PlantInput(1e-3), round(0.05 / dt))
        balance, x = 0.0, plant.state.x
        for _ in range(round(0.2 / dt)):
            before, Q_A = plant.state, plant.output.Q_A
            after = plant.step(PlantInput(1e-3))
            V_A = paper.V_A0 + 0.5 * paper.A_A * (before.x + after.x)
            middle = 0.5 * (before.P_A + after.P_A)
            E = paper.E if air is None else soft(middle, air)
            balance += 0.5 * dt * (Q_A + after.Q_A) - V_A / E * (after.P_A - before.P_A)
        displaced = paper.A_A * (plant.state.x - x)
        return abs(balance - displaced) / displaced

    def soft(pressure, air):
        """The mixture law, written out."""
        p = pressure + 101_325.0
        r = air.ratio * (101_325.0 / p) ** (1.0 / 1.4)
        return 1e8 * (1.0 + r) / (1.0 + r * 1e8 / (1.4 * p))

    coarse, fine = lost(2e-4), lost(1e-4)
    assert fine < 1e-5
    assert 3.0 < coarse / fine < 5.0


@pytest.mark.long
@settings(max_examples=20)
@given(
    setpoints=st.lists(st.floats(-1.5e-3, 1.5e-3), min_size=2, max_size=4),
    F_L=st.floats(-1e4, 1e4) | st.floats(-8e4, 8e4),
    E=st.floats(1e8, 1.7e9),
    C_L=st.floats(0.0, 1e-11),
)
@example(setpoints=[0.0, 0.0], F_L=511.0, E=5.6e8, C_L=0.0)  # 10 mJ, and the rule misses 2e-5
def test_energy_is_neither_made_nor_lost(setpoints, F_L, E, C_L):
    # What the oil brings through the ports is motion, compression, friction, load, leakage and,
    # at the cavitation floor, the work that opens a cavity:
    # P_A Q_A + P_B Q_B = d/dt(m v² / 2) + P dP V / E + f v + F_L v + C_L (P_A - P_B)² - P dV_C/dt,
    # summed up by the trapezoidal rule, so to second order in the step.
    oil = dataclasses.replace(paper_parameters(), E=E, C_L=C_L)
    options = dataclasses.replace(OPTIONS, cavitation_floor=FLOOR)

    def imbalance(dt):
        plant = FullOrderPlant(oil, options=options, dt=dt)
        cavities = 0.0
        missing = turned_over = 0.0
        before = plant.output
        for u in setpoints:
            for _ in range(round(0.02 / dt)):
                after = plant.step(PlantInput(u, F_L))
                void = plant.state.V_CA + plant.state.V_CB
                parts = (*energy_parts(before, after, dt, F_L, oil), -FLOOR * (void - cavities))
                cavities = void
                missing += parts[0] - sum(parts[1:])
                turned_over += sum(map(abs, parts))
                before = after
        return abs(missing), turned_over

    missing, turned_over = imbalance(1e-5)
    # Where the spool's overshoot barely opens the valve, the flow is a pulse of a few steps, of
    # which the trapezoidal rule knows too little: 0.6 mJ are no motion to balance.
    assume(turned_over > 1e-2)
    # What the rule misses is a quarter with half the step; what the plant loses stays.
    assert missing <= 2e-5 * turned_over + 1e-9 or imbalance(5e-6)[0] <= 0.5 * missing


def energy_parts(a, b, dt, F_L, p):
    """Energy of one step [J]: through the ports, then where it went."""

    def rate(y):
        friction = math.tanh(400.0 * y.v) * (
            p.F_c + (p.F_s - p.F_c) * math.exp(-((abs(y.v) / p.chi) ** p.delta))
        )
        drag = (friction + p.sigma * y.v + F_L) * y.v
        return y.P_A * y.Q_A + y.P_B * y.Q_B, drag + p.C_L * (y.P_A - y.P_B) ** 2

    (port_a, loss_a), (port_b, loss_b) = rate(a), rate(b)
    x = 0.5 * (a.x + b.x)
    oil = (p.V_A0 + p.A_A * x) * 0.5 * (b.P_A**2 - a.P_A**2)
    oil += (p.V_B0 - p.A_B * x) * 0.5 * (b.P_B**2 - a.P_B**2)
    motion = 0.5 * p.m * (b.v**2 - a.v**2)
    return 0.5 * dt * (port_a + port_b), motion, oil / p.E, 0.5 * dt * (loss_a + loss_b)
