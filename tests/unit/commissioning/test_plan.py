"""Plans: what they hold, and what is wrong with one before anything moves."""

from pathlib import Path

import pytest
from support.tables import from_text

from hil_bench import ConfigError, load_config
from hil_bench.abilities.commissioning.plan import (
    StepKind,
    check_against,
    choose_axis,
    expected_speed,
    expected_travel,
    load_plan,
)
from hil_bench.plants.hydraulic_cylinder.model import paper_parameters

EXAMPLE = Path(__file__).parents[3] / "examples" / "commissioning.toml"
LIMITS = "[limits]\nposition_mm = [-100, 100]\nspeed_mm_s = 300\npressure_bar = [-1, 110]\n"


@pytest.fixture
def load(tmp_path):
    def load(text, name="plan.toml"):
        path = tmp_path / name
        path.write_text(text)
        return load_plan(path)

    return load


def test_the_example_is_a_plan_of_all_steps_for_the_built_in_bench():
    plan = load_plan(EXAMPLE)
    assert [step.kind for step in plan.steps] == list(StepKind)
    check_against(plan, choose_axis(plan, load_config()))
    direction = plan.steps[2]
    assert direction.limits.speed == pytest.approx(0.2)  # its own
    assert direction.limits.position == pytest.approx((-0.15, 0.15))  # that of [limits]
    assert direction.values == pytest.approx({"opening": 0.4, "duration": 0.4})


def test_steps_come_in_the_order_of_the_file(load):
    plan = load(LIMITS + "[communication]\n[direction]\n[chirp]\n[ramp]\n[plan]\nperiod_ms = 4\n")
    assert [step.kind.value for step in plan.steps] == (
        ["communication", "direction", "chirp", "ramp"]
    )
    assert plan.period == pytest.approx(4e-3)
    assert plan.bench is None


def test_a_bench_is_relative_to_the_plan(load, tmp_path):
    plan = load(LIMITS + '[plan]\nbench = "m/bench.toml"\naxis = "b"\n[communication]\n')
    assert plan.bench == tmp_path / "m" / "bench.toml"
    with pytest.raises(ConfigError, match=r"plan\.axis: the bench has no b; give one of axis1$"):
        choose_axis(plan, load_config())


@from_text("text", "message")
def test_what_is_wrong_with_a_plan(load, text, message):
    with pytest.raises(ConfigError) as caught:
        load(text)
    assert message in [line.rpartition("/")[2] for line in str(caught.value).splitlines()]


@from_text("text", "message")
def test_a_plan_that_would_leave_the_stroke(load, text, message):
    plan = load(text)
    with pytest.raises(ConfigError) as caught:
        check_against(plan, load_config().axes[0])
    assert message in [line.rpartition(".toml:")[2] for line in str(caught.value).splitlines()]


def test_the_speed_of_the_data_sheet():
    parameters = paper_parameters()
    # 50 % is nu = 0.65e-3 m, z = 0.35e-3 m; both edges drop P_S / 2 = 50 bar; C_d = 0.65,
    # w = 20 mm, rho = 850: Q = 0.65 * 0.02 * 0.35e-3 * sqrt(2 * 50e5 / 850) = 4.935e-4 m3/s over
    # 48.5 cm2.
    assert expected_speed(0.5, parameters) == pytest.approx(0.10176, rel=1e-3)
    assert expected_speed(0.1, parameters) == 0.0  # within the overlap


def test_the_travel_of_a_sweep_is_that_of_the_simulated_one():
    (step,) = [s for s in load_plan(EXAMPLE).steps if s.kind is StepKind.DEAD_BAND]
    parameters = paper_parameters()
    time = [number * 1e-3 for number in range(2000)]  # 0 to 50 % and back in half of 4 s
    path = sum(expected_speed(0.5 * (1 - abs(t - 1.0)), parameters) * 1e-3 for t in time)
    assert expected_travel(step, parameters) == pytest.approx(path, rel=0.01)
