"""What the full-order plant takes and refuses: inputs, steps, states."""

import dataclasses
import math

import pytest

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import (
    ExtensionState,
    FullOrderPlant,
    LuGreFriction,
    PlantInput,
    PlantOptions,
    ReducedOrderPlant,
    Solver,
    balanced_state,
)

EULER = Solver.FORWARD_EULER
MIDPOINT = Solver.LINEARLY_IMPLICIT_MIDPOINT
PAPER = PlantOptions.paper()


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_refuses_inputs_that_are_not_finite(paper, bad):
    plant = FullOrderPlant(paper)
    before = plant.state
    with pytest.raises(ParameterError, match=r"^u = (nan|inf|-inf) m, F_L = 0\.0 N"):
        plant.step(PlantInput(bad))
    with pytest.raises(ParameterError, match=r"F_L = (nan|inf|-inf) N: both must be finite"):
        plant.step(PlantInput(0.0, bad))
    assert plant.state == before


def test_inputs_beyond_the_limits_act_as_the_limits(paper):
    far, limit = FullOrderPlant(paper), FullOrderPlant(paper)
    assert far.step(PlantInput(-1e300, 1e300), 5) == limit.step(PlantInput(-1.0, 1e9), 5)


@pytest.mark.parametrize("model", [FullOrderPlant, ReducedOrderPlant])
def test_takes_integers_and_zero_steps(paper, model):
    plant = model(paper)
    assert plant.step(PlantInput(0, 0), 0) == plant.output
    with pytest.raises(ParameterError, match=r"^steps = -1: must be 0 or greater"):
        plant.step(PlantInput(0.0), -1)


@pytest.mark.parametrize("model", [FullOrderPlant, ReducedOrderPlant])
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((PlantInput(0.0), 2.5), "steps = 2.5: must be an integer"),
        ((PlantInput(0.0), True), "steps = True: must be an integer"),
        ((PlantInput(0.0), None), "steps = None: must be an integer"),
        ((PlantInput(True),), "u = True: must be a number in m"),
        ((PlantInput("1e-3"),), "u = '1e-3': must be a number in m"),
        ((PlantInput(0.0, None),), "F_L = None: must be a number in N"),
        (((0.0,),), "plant_input = (0.0,): must be PlantInput(u, F_L)"),
        ((1e-3,), "plant_input = 0.001: must be PlantInput(u, F_L)"),
    ],
)
def test_refuses_what_is_no_input(paper, model, given, message):
    plant = model(paper)
    before = plant.state
    with pytest.raises(ParameterError) as refusal:
        plant.step(*given)
    assert str(refusal.value) == message
    assert plant.state == before


@pytest.mark.parametrize("model", [FullOrderPlant, ReducedOrderPlant])
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"solver": "heun"}, "solver = 'heun': must be one of forward-euler, linearly-implicit-"),
        ({"solver": 1}, "solver = 1: must be one of forward-euler, "),
        ({"options": {}}, "options = {}: must be PlantOptions or None"),
        ({"dt": True}, "dt = True: must be a number in s"),
        ({"state": (0.0,) * 6}, "state = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0): must be PlantState"),
    ],
)
def test_refuses_arguments_of_another_kind(paper, model, given, message):
    with pytest.raises(ParameterError) as refusal:
        model(paper, **given)
    assert str(refusal.value).startswith(message)
    with pytest.raises(ParameterError, match=r"^parameters = None: must be PlantParameters"):
        model(None)
    with pytest.raises(ParameterError, match=r"^state = None: must be PlantState"):
        model(paper).restart(None)


def test_a_solver_may_be_given_by_its_name(paper):
    assert FullOrderPlant(paper, solver="runge-kutta", dt=5e-5).solver is Solver.RUNGE_KUTTA


@pytest.mark.parametrize("model", [FullOrderPlant, ReducedOrderPlant])
def test_refuses_a_step_that_cannot_follow_the_swing(paper, model):
    # 20 g on the oil, nothing that damps: sqrt(k / m) with k = E (A_A² / V_A + A_B² / V_B) at the
    # stroke's end, 1.35e7 N/m: 26.0e3 rad/s; 14.1e3 rad/s with the reduced model's mean volume.
    light = dataclasses.replace(paper, m=0.02, F_c=0.0, F_s=0.0, sigma=0.0)
    limit = {FullOrderPlant: r"3\.84e-05", ReducedOrderPlant: r"7\.06e-05"}[model]
    message = rf"^dt = 0\.001 s: linearly-implicit-midpoint cannot follow .*; {limit} s or less"
    with pytest.raises(ParameterError, match=message):
        model(light, dt=1e-3)
    model(light, dt=3.84e-5)
    # What slides through much viscous friction does not swing: sigma / (2 m) is above it.
    model(dataclasses.replace(light, sigma=2000.0), dt=1e-3)


def test_the_swing_of_a_light_piston_decays_at_the_largest_step(paper):
    # At the limit the pressures of a step of load stay within twice the load over the area.
    light = dataclasses.replace(paper, m=0.02, F_c=0.0, F_s=0.0, sigma=1.0)
    plant = FullOrderPlant(light, dt=3.8e-5)
    highest = max(plant.step(PlantInput(0.0, 1e3)).P_A for _ in range(2000))
    assert highest < plant.parameters.P_S


def test_refuses_bristles_that_drive_the_piston(paper):
    # sigma F_c / (F_s - F_c) = 2000 * 600 / 300, Barabanov and Ortega 2000
    def options(sigma_1):
        return dataclasses.replace(PAPER, bristles=LuGreFriction(sigma_1=sigma_1))

    FullOrderPlant(paper, options=options(4000.0), dt=1e-5)
    with pytest.raises(ParameterError, match=r"^sigma_1 = 4001 N s/m: must be 4000 N s/m or less"):
        FullOrderPlant(paper, options=options(4001.0), dt=1e-5)


@pytest.mark.parametrize("model", [FullOrderPlant, ReducedOrderPlant])
def test_refuses_a_negative_supply_pressure(paper, model):
    plant = model(paper)
    for wrong in (-1.0, math.nan, True):
        with pytest.raises(ParameterError, match=r"^supply_pressure = (-1 Pa|nan Pa|True): must"):
            plant.supply_pressure = wrong
    assert plant.supply_pressure == paper.P_S


@pytest.mark.parametrize(
    ("extension", "message"),
    [
        (ExtensionState(0.0, 0.0, -2e5), "P_S = -200000 Pa: must be at least -101325 Pa"),
        (ExtensionState(math.inf, 0.0, 1e7), "t = inf s: must be finite"),
        ((0.0, 0.0, 1e7), "extension = (0.0, 0.0, 10000000.0): must be ExtensionState"),
    ],
)
def test_refuses_a_senseless_extension(paper, extension, message):
    with pytest.raises(ParameterError) as refusal:
        FullOrderPlant(paper, extension=extension)
    assert str(refusal.value).startswith(message)


def test_a_plant_pressed_into_its_stop_goes_on_from_there(paper):
    plant = FullOrderPlant(paper)
    plant.step(PlantInput(1.3e-3), 40_000)
    assert plant.state.x > paper.h
    copy = FullOrderPlant(paper, state=plant.state)
    assert copy.step(PlantInput(0.0), 100) == plant.step(PlantInput(0.0), 100)


@pytest.mark.parametrize("dt", [0.0, -1e-4, math.nan, math.inf, "1e-4"])
def test_refuses_a_senseless_step(paper, dt):
    with pytest.raises(ParameterError, match=r"^dt = "):
        FullOrderPlant(paper, dt=dt)


def test_forward_euler_refuses_a_step_beyond_the_standstill_limit(paper):
    # 2 m / (400 F_s + sigma) = 40 / 3.62e5 = 1.105e-4 s
    FullOrderPlant(paper, options=PAPER, solver=EULER, dt=1.104e-4)
    with pytest.raises(ParameterError, match=r"^dt = 0\.0001106 s: .*; 0\.00011 s or less"):
        FullOrderPlant(paper, options=PAPER, solver=EULER, dt=1.106e-4)


def test_forward_euler_chatters_beyond_that_limit_and_not_below(paper, monkeypatch):
    monkeypatch.setattr(
        "hil_bench.plants.hydraulic_cylinder.model.full_order.largest_step", lambda *_: math.inf
    )

    def last_velocity(dt):
        state = balanced_state(paper)._replace(v=1e-6)
        plant = FullOrderPlant(paper, options=PAPER, solver=EULER, dt=dt, state=state)
        return abs(plant.step(PlantInput(0.0), 2000).v)

    assert last_velocity(1.09e-4) < 1e-6
    assert last_velocity(1.2e-4) > 1e-4


def test_forward_euler_says_when_it_has_diverged(paper, monkeypatch):
    monkeypatch.setattr(
        "hil_bench.plants.hydraulic_cylinder.model.full_order.largest_step", lambda *_: math.inf
    )
    # A fluid a thousand times stiffer than Table I's: zeta - omega_c dt / 2 = 0.004 - 0.71 < 0.
    steel = dataclasses.replace(paper, E=1e11)
    plant = FullOrderPlant(steel, options=PAPER, solver=EULER, dt=1e-4)
    with pytest.raises(ParameterError, match=r"^dt = 0\.0001 s: forward-euler has diverged"):
        plant.step(PlantInput(1e-3), 2000)


def test_forward_euler_refuses_a_step_beyond_the_spools_limit(paper):
    # 2 xi / omega_0 = 1.1667e-3 s, once the oil is soft and the piston heavy and well damped.
    heavy = dataclasses.replace(paper, m=2000.0, E=1e6)
    with pytest.raises(ParameterError, match=r"0\.00116 s or less"):
        FullOrderPlant(heavy, options=PAPER, solver=EULER, dt=1.2e-3)


def test_printed_sign_is_for_forward_euler(paper):
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
def test_refuses_a_senseless_state(paper, change, message):
    with pytest.raises(ParameterError) as refusal:
        FullOrderPlant(paper, state=balanced_state(paper)._replace(**change))
    assert str(refusal.value) == message or str(refusal.value).startswith(message)


def test_refuses_a_tank_below_the_floor(paper):
    with pytest.raises(ParameterError, match=r"^P_T = -200000 Pa"):
        FullOrderPlant(dataclasses.replace(paper, P_T=-2e5))
