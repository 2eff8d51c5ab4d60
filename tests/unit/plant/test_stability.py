"""The largest stable steps of the explicit solvers, against closed forms and against runs."""

import dataclasses
import math

import pytest

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import (
    FullOrderPlant,
    LuGreFriction,
    PlantInput,
    PlantOptions,
    Solver,
    balanced_state,
)
from hil_bench.plants.hydraulic_cylinder.model.stability import (
    largest_euler_step,
    largest_runge_kutta_step,
)

PAPER = PlantOptions.paper()
REAL_AXIS = 2.785293563  # end of the stability interval of classical Runge-Kutta (Hairer & Wanner)
STIFF_END = -0.1999  # V_A is 2e-4 m³ there, V_B 2.1e-4 m³ at the other end, and A_A > A_B [m]
IMAGINARY_AXIS = 2.0 * math.sqrt(2.0)  # and on the imaginary axis


def smooth(paper, **change):
    """Return an axis with viscous friction only, so that all of it is linear while closed."""
    return dataclasses.replace(paper, F_c=0.0, F_s=0.0, **change)


def end_stiffness(p):
    """Return E (A_A² / V_A + A_B² / V_B) [N/m] where it is largest: with one chamber smallest."""
    return max(
        p.E * (p.A_A**2 / (p.V_A0 + p.A_A * x) + p.A_B**2 / (p.V_B0 - p.A_B * x))
        for x in (-p.h, p.h)
    )


def test_friction_at_standstill_limits_a_light_piston(paper):
    rate = (400.0 * paper.F_s + paper.sigma) / paper.m  # 18100 1/s
    soft = dataclasses.replace(paper, E=1e6)
    assert largest_euler_step(soft, PAPER) == pytest.approx(2.0 / rate, rel=1e-3)
    assert largest_runge_kutta_step(soft, PAPER) == pytest.approx(REAL_AXIS / rate, rel=5e-3)


def test_stiff_oil_limits_forward_euler_by_its_damping(paper):
    # s² + (sigma / m) s + k / m: 2 zeta / omega = sigma / k
    oil = smooth(paper, E=1e9)
    assert largest_euler_step(oil, PAPER) == pytest.approx(oil.sigma / end_stiffness(oil), rel=1e-9)


def test_stiff_oil_limits_runge_kutta_by_its_frequency(paper):
    # Hardly damped, so the closed valve alone: omega dt up to the imaginary axis' end. The steep
    # orifice of a small drop is faster; a valve that hardly opens has none.
    oil = smooth(paper, E=1e9, sigma=1.0, w=1e-9)
    omega = math.sqrt(end_stiffness(oil) / oil.m)
    assert largest_runge_kutta_step(oil, PAPER) == pytest.approx(IMAGINARY_AXIS / omega, rel=5e-3)


def test_without_damping_no_euler_step_is_short_enough(paper):
    undamped = smooth(paper, sigma=0.0)
    assert largest_euler_step(undamped, PAPER) == 0.0
    with pytest.raises(ParameterError, match="linearly-implicit-midpoint, for no step is short"):
        FullOrderPlant(undamped, options=PAPER, solver=Solver.FORWARD_EULER)


def test_bristles_limit_forward_euler(paper):
    # At rest they are a spring beside the oil's: 2 zeta / omega = (sigma_1 + sigma) / (k + sigma_0)
    bristles = LuGreFriction(sigma_0=1e8, sigma_1=2e3)
    options = dataclasses.replace(PAPER, bristles=bristles)
    stiffness = end_stiffness(paper) + 1e8
    limit = largest_euler_step(paper, options)
    assert limit == pytest.approx((2e3 + paper.sigma) / stiffness, rel=1e-9)


@pytest.mark.parametrize(
    ("solver", "limit_of", "sigma"),
    [
        (Solver.FORWARD_EULER, largest_euler_step, 2000.0),
        (Solver.RUNGE_KUTTA, largest_runge_kutta_step, 1.0),
    ],
)
def test_a_swing_at_the_strokes_end_decays_below_the_limit_and_grows_above(
    paper, monkeypatch, solver, limit_of, sigma
):
    oil = smooth(paper, E=1e9, sigma=sigma, w=1e-9)
    limit = limit_of(oil, PAPER)
    # Refused above the limit, so the refusal is taken away.
    monkeypatch.setattr(
        "hil_bench.plants.hydraulic_cylinder.model.full_order.largest_step", lambda *_: math.inf
    )

    def largest_velocity(dt):
        start = balanced_state(oil, x=STIFF_END)._replace(v=1e-4)
        plant = FullOrderPlant(oil, options=PAPER, solver=solver, dt=dt, state=start)
        try:
            return max(abs(plant.step(PlantInput(0.0)).v) for _ in range(20000))
        except ParameterError:  # diverged
            return math.inf

    assert largest_velocity(0.98 * limit) < 1.2e-4
    # Forward Euler: by exp(0.05 sigma / (2 m) 20000 dt) = exp(0.77).
    assert largest_velocity(1.05 * limit) > 1.5e-4


def test_the_refusal_names_a_step_that_works(paper):
    oil = dataclasses.replace(paper, E=1e9)
    with pytest.raises(ParameterError) as refusal:
        FullOrderPlant(oil, options=PAPER, solver=Solver.FORWARD_EULER, dt=1e-4)
    named = float(str(refusal.value).split("; ")[1].split()[0])
    FullOrderPlant(oil, options=PAPER, solver=Solver.FORWARD_EULER, dt=named)
