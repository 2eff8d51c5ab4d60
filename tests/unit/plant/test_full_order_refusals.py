"""What the full-order plant takes and refuses: inputs, steps, states."""

import dataclasses
import math

import pytest

from hil_bench.errors import ParameterError
from hil_bench.plant import (
    FullOrderPlant,
    PlantInput,
    PlantOptions,
    PlantParameters,
    Solver,
    balanced_state,
)

EULER = Solver.FORWARD_EULER
MIDPOINT = Solver.LINEARLY_IMPLICIT_MIDPOINT
PAPER = PlantOptions.paper()


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_refuses_inputs_that_are_not_finite(paper: PlantParameters, bad: float) -> None:
    plant = FullOrderPlant(paper)
    before = plant.state
    with pytest.raises(ParameterError, match=r"^u = (nan|inf|-inf) m, F_L = 0\.0 N"):
        plant.step(PlantInput(bad))
    with pytest.raises(ParameterError, match=r"F_L = (nan|inf|-inf) N: both must be finite"):
        plant.step(PlantInput(0.0, bad))
    assert plant.state == before


def test_inputs_beyond_the_limits_act_as_the_limits(paper: PlantParameters) -> None:
    far, limit = FullOrderPlant(paper), FullOrderPlant(paper)
    assert far.step(PlantInput(-1e300, 1e300), 5) == limit.step(PlantInput(-1.0, 1e9), 5)


def test_takes_integers_and_zero_steps(paper: PlantParameters) -> None:
    plant = FullOrderPlant(paper)
    assert plant.step(PlantInput(0, 0), 0) == plant.output
    with pytest.raises(ParameterError, match=r"^steps = -1"):
        plant.step(PlantInput(0.0), -1)


@pytest.mark.parametrize("dt", [0.0, -1e-4, math.nan, math.inf, "1e-4"])
def test_refuses_a_senseless_step(paper: PlantParameters, dt: float) -> None:
    with pytest.raises(ParameterError, match=r"^dt = "):
        FullOrderPlant(paper, dt=dt)


def test_forward_euler_refuses_a_step_beyond_the_standstill_limit(
    paper: PlantParameters,
) -> None:
    # 2 m / (400 F_s + sigma) = 40 / 3.62e5 = 1.105e-4 s
    FullOrderPlant(paper, options=PAPER, solver=EULER, dt=1.104e-4)
    with pytest.raises(ParameterError, match=r"^dt = 0\.0001106 s: .*; 0\.00011 s or less"):
        FullOrderPlant(paper, options=PAPER, solver=EULER, dt=1.106e-4)


def test_forward_euler_chatters_beyond_that_limit_and_not_below(
    paper: PlantParameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hil_bench.plant.full_order._LARGEST_STEP", {})

    def last_velocity(dt: float) -> float:
        state = balanced_state(paper)._replace(v=1e-6)
        plant = FullOrderPlant(paper, options=PAPER, solver=EULER, dt=dt, state=state)
        return abs(plant.step(PlantInput(0.0), 2000).v)

    assert last_velocity(1.09e-4) < 1e-6
    assert last_velocity(1.2e-4) > 1e-4


def test_forward_euler_says_when_it_has_diverged(
    paper: PlantParameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hil_bench.plant.full_order._LARGEST_STEP", {})
    # A fluid a thousand times stiffer than Table I's: zeta - omega_c dt / 2 = 0.004 - 0.71 < 0.
    steel = dataclasses.replace(paper, E=1e11)
    plant = FullOrderPlant(steel, options=PAPER, solver=EULER)
    with pytest.raises(ParameterError, match=r"^dt = 0\.0001 s: forward-euler has diverged"):
        plant.step(PlantInput(1e-3), 2000)


def test_forward_euler_refuses_a_step_beyond_the_spools_limit(paper: PlantParameters) -> None:
    # 2 xi / omega_0 = 1.1667e-3 s, once the oil is soft and the piston heavy and well damped.
    heavy = dataclasses.replace(paper, m=2000.0, E=1e6)
    with pytest.raises(ParameterError, match=r"0\.00116 s or less"):
        FullOrderPlant(heavy, options=PAPER, solver=EULER, dt=1.2e-3)


def test_printed_sign_is_for_forward_euler(paper: PlantParameters) -> None:
    sign = dataclasses.replace(PAPER, tanh_gain=math.inf)
    plant = FullOrderPlant(paper, options=sign, solver=EULER)
    assert plant.step(PlantInput(1e-3), 5000).v == pytest.approx(0.204, abs=5e-4)
    with pytest.raises(ParameterError, match=r"^tanh_gain = inf s/m: .*finite gain"):
        FullOrderPlant(paper, options=sign, solver=MIDPOINT)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": math.nan}, "x = nan m: must be finite"),
        ({"P_A": -2e5}, "P_A = -200000 Pa: must be at least the cavitation floor, -101325 Pa"),
        ({"x": 0.3}, "x = 0.3 m: must lie between the end stops at +-0.2 m"),
    ],
)
def test_refuses_a_senseless_state(
    paper: PlantParameters, change: dict[str, float], message: str
) -> None:
    with pytest.raises(ParameterError) as refusal:
        FullOrderPlant(paper, state=balanced_state(paper)._replace(**change))
    assert str(refusal.value) == message or str(refusal.value).startswith(message)


def test_refuses_a_tank_below_the_floor(paper: PlantParameters) -> None:
    with pytest.raises(ParameterError, match=r"^P_T = -200000 Pa"):
        FullOrderPlant(dataclasses.replace(paper, P_T=-2e5))
