"""The strange plant of tests/support: it must be right before an estimate is judged by it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.strange_changes import DEFECTS, SENSOR, draw_pair
from support.strange_logger import draw_logger, seen_by
from support.strange_machines import STRANGE, draw
from support.strange_plant import (
    ATMOSPHERE,
    Machine,
    friction_at,
    modulus_at,
    rest_state,
    run_stroke,
)

SHORT = Machine(stroke=0.1)


def middle_speed(machine, amplitude):
    """The speed of a stroke, which begins at the far end, in the middle of its way."""
    start = -0.04 * math.copysign(1.0, amplitude)
    run = run_stroke(machine, rest_state(machine, start), amplitude, limit=0.04)
    return float(run.v[np.argmin(np.abs(run.x))])


@pytest.mark.parametrize("amplitude", [0.4, -0.8])
def test_the_steady_speed_is_that_of_both_edges_in_series(amplitude):
    m = replace(SHORT, rounding=1e-6, leakage=0.0, laminar=1.0)
    v = middle_speed(m, amplitude)
    first, second = (m.area_a, m.area_b) if amplitude > 0 else (m.area_b, m.area_a)
    friction = abs(friction_at(m, v, 0.0, 1.0))
    # (K a)^2 (P_S A_1 - P_T A_2 - F) = v^2 (A_1^3 + A_2^3), Merritt
    opened = m.conductance * (abs(amplitude) - m.overlaps[0])
    force = m.supply * first - m.tank * second - friction
    expected = opened * math.sqrt(force / (first**3 + second**3))
    assert abs(v) == pytest.approx(expected, rel=1e-3)


def test_a_body_in_series_is_a_longer_way_for_the_oil():
    half = replace(SHORT, body=SHORT.conductance * (0.8 - SHORT.overlaps[0]))
    # two like orifices in series pass 1 / sqrt(2) of one; viscous friction takes a little less then
    ratio = middle_speed(half, 0.8) / middle_speed(SHORT, 0.8)
    assert ratio == pytest.approx(1.0 / math.sqrt(2.0), rel=0.01)


def test_air_makes_oil_soft_at_low_pressure_only():
    m = replace(SHORT, air=0.01, modulus=1.5e9, modulus_slope=0.0)
    # polytropic gas of one hundredth at atmospheric pressure, by hand
    ratio = 0.01 / 0.99
    soft = (1.0 + ratio) / (1.0 / 1.5e9 + ratio / (1.3 * ATMOSPHERE))
    assert modulus_at(m, 0.0) == pytest.approx(soft, rel=1e-12)
    assert modulus_at(m, 200e5) > 0.95 * 1.5e9


def test_a_stroke_into_the_stop_ends_there():
    run = run_stroke(SHORT, rest_state(SHORT, -0.04), 0.8)
    # supply pressure on the piston against the stiffness of the cap
    depth = SHORT.supply * SHORT.area_a / 2e8
    assert 0.05 <= run.x.max() < 0.05 + 3.0 * depth
    assert run.command[-1] == 0.0
    assert run.command.max() == 0.8


@pytest.mark.parametrize("kind", ["sagging", "accumulator"])
def test_a_supply_that_gives_way_makes_it_slower(kind):
    flow = SHORT.area_a * middle_speed(SHORT, 0.8)
    weak = replace(
        SHORT, supply_kind=kind, sag=0.2 * SHORT.supply / flow, pump=0.5 * flow, gas=2e-4
    )
    assert middle_speed(weak, 0.8) < 0.97 * middle_speed(SHORT, 0.8)


def test_machines_are_the_same_for_a_seed():
    assert draw(30, 3) == draw(30, 3)
    assert draw(30, 3) != draw(30, 4)
    assert draw(30, 3) != draw(31, 3)
    every = {effect for number in range(40) for effect in draw(30, number).effects}
    assert every == set(STRANGE)


def test_a_logger_shows_what_its_sensors_do():
    stranger = draw(30, 0)
    logger = replace(draw_logger(30, stranger), period=2e-3, lost=0.0, jitter=0.0)
    logger = replace(logger, pressure_noise=0.0, pressure_lag=0.0, pressure_step=1e5)
    times = 5e-4 * np.arange(2000)
    rows = {
        "time": times,
        "command": np.where(times < 0.5, 0.0, 0.3),
        "x": np.zeros(2000),
        "pressure_a": np.full(2000, 20.3e5),
        "pressure_b": np.full(2000, 1e9),
    }
    shown = seen_by(rows, logger, (0.4e5, 0.0), np.random.default_rng(1))
    assert np.diff(shown["time"]) == pytest.approx(2e-3)
    assert set(shown["P_A"]) == {21e5}  # 20.7 bar in whole bars
    assert set(shown["P_B"]) == {logger.pressure_range}
    assert shown["command"][shown["time"] < 0.499].max() == 0.0


@pytest.mark.parametrize("defect", DEFECTS, ids=lambda one: one.name)
def test_a_defect_changes_one_thing_beside_the_weather(defect):
    healthy, worse = draw_pair(30, 5), draw_pair(30, 5, defect, 4.0)
    assert healthy.before == worse.before
    was, now = healthy.after[0].machine, worse.after[0].machine
    assert (was != now) == (defect.name != SENSOR)
    offsets = [np.array(pair.after[1].pressure_offsets) for pair in (healthy, worse)]
    moved = np.abs(offsets[1] - offsets[0]).max()
    assert moved == pytest.approx(worse.size * 1e5 if defect.name == SENSOR else 0.0)
