"""Strokes to record: both ways at three openings, within the bounds of the machine."""

from dataclasses import replace
from itertools import groupby
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from hil_bench import ConfigError, load_config
from hil_bench.abilities.commissioning.plan import Limits
from hil_bench.abilities.identification.design import (
    Bounds,
    Twin,
    _join,
    plan_strokes,
    shorten_course,
)
from hil_bench.plants.hydraulic_cylinder.model import paper_parameters

if TYPE_CHECKING:
    from hil_bench.plants.hydraulic_cylinder.configuration import CylinderConfig

AXIS = cast("CylinderConfig", load_config(None).first_axis)
LIMITS = Limits(position=(-0.1, 0.1), speed=0.25, pressure=(-1e5, 1.2e7), time=60.0)
TWIN = Twin(
    axis="axis1",
    parameters=paper_parameters(),
    options=AXIS.options,
    step=2.5e-4,
    interval=2e-3,
    full_opening=paper_parameters().full_opening,
)


@pytest.fixture(scope="module")
def run():
    return plan_strokes(TWIN, Bounds.of(AXIS, LIMITS), 60.0)


def test_strokes_go_both_ways_at_three_openings(run):
    levels = {round(float(value), 6) for value in np.unique(run.setpoints)}

    assert levels == {0.0, *(round(sign * one, 6) for one in run.openings for sign in (1, -1))}
    dead = 0.3 / 1.3  # of Table I's valve
    assert dead < min(run.openings) < max(run.openings) <= 0.9
    assert len(run.names) == 3


def test_the_motion_stays_within_the_limits(run):
    x, v = run.states[:, 0], run.states[:, 1]

    assert -0.1 < x.min() < -0.02
    assert 0.02 < x.max() < 0.1
    assert 0.1 < np.abs(v).max() < 0.25


def test_limits_that_allow_nothing_are_named():
    tight = replace(LIMITS, speed=1e-3)

    with pytest.raises(ConfigError, match="that of speed; give wider"):
        plan_strokes(TWIN, Bounds.of(AXIS, tight), 60.0)


def test_a_time_that_is_too_short_is_named():
    with pytest.raises(ConfigError, match="the shortest run takes"):
        plan_strokes(TWIN, Bounds.of(AXIS, LIMITS), 2.0)


def test_a_tenth_of_the_limits_stays_free():
    expected = {
        (0.0, 0.0, 5e6, 5e6): "",
        (0.091, 0.0, 5e6, 5e6): "position",
        (0.0, -0.24, 5e6, 5e6): "speed",
        (0.0, 0.0, 5e6, 1.3e7): "pressure",
        (0.0, 0.0, 1.3e7, 5e6): "pressure",
        (0.0, 0.0, -2e5, 5e6): "pressure",
        (0.0799, 0.2249, -1e5, 1.2e7): "",
        (-0.091, 0.0, 5e6, 5e6): "position",
    }
    assert {
        state: Bounds.of(AXIS, LIMITS).leaves(np.array([state])) for state in expected
    } == expected


def test_without_a_plan_the_stroke_limits():
    bounds = Bounds.of(AXIS, None)

    assert bounds.position == pytest.approx((-0.16, 0.16))  # of 400 mm
    assert bounds.leaves(np.array([[0.0, 10.0, 5e6, 5e6]])) == ""


def test_the_course_leads_through_every_setpoint():
    steps = np.repeat([0.0, 0.4, -0.4], 40)
    setpoints = np.concatenate([steps, np.linspace(0.0, 0.5, 100), 0.3 * np.sin(np.arange(80.0))])

    course = shorten_course(setpoints, 2e-3)

    times, values = np.array(course).T
    assert np.interp(2e-3 * np.arange(len(setpoints)), times, values) == pytest.approx(
        setpoints, abs=1e-5
    )
    assert len(course) < 100  # of 300 rows: only the sine needs one each


def test_both_ways_of_a_stroke_go_as_far():
    """Half an opening makes 50 mm/s one way and 25 mm/s the other, which has its 2.5 s for 62.5 mm,
    less than 0.8 of the room."""

    def run(setpoints, _start):
        return np.column_stack([setpoints, np.where(setpoints > 0.0, 0.10, 0.05) * setpoints])

    twin = SimpleNamespace(interval=0.01, run=run)
    _, setpoints = _join(twin, SimpleNamespace(room=0.1, middle=0.0), (0.5,), pairs=1)
    strokes = [(opening, len([*rows])) for opening, rows in groupby(setpoints)]
    there, back, rest = (0.5, 125), (-0.5, 250), (0.0, 35)
    assert strokes == [rest, there, rest, back, rest, back, rest, there, rest]
