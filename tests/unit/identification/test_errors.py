"""Errors of prediction in a user's units, and limits on them."""

import math

import numpy as np
import pytest

from hil_bench.abilities.identification.errors import (
    Limit,
    StrokeError,
    find_exceeded,
    measure_errors,
    read_limit,
    stated_error,
)
from hil_bench.errors import ConfigError

ROWS = 1001
WAY = np.linspace(0.0, 0.1, ROWS)  # [m] in a second: 100 mm/s


def signals(x, pressure):
    return np.column_stack([x, np.full(len(x), pressure), np.full(len(x), np.nan)])


def test_a_model_that_is_slower_is_late_by_the_same_share():
    """2 % slower: 2 % of the speed, and 90 mm are reached after 0.9 s / 0.98."""
    found = measure_errors(signals(0.98 * WAY, 5.2e6), signals(WAY, 5e6), 1e-3)

    assert found.speed == pytest.approx(0.02, rel=1e-6)
    assert found.time == pytest.approx(0.9 / 0.98 - 0.9, rel=1e-2)
    assert found.pressure == pytest.approx(2e5)
    # The rms of a ramp that ends at 2 mm.
    assert found.position == pytest.approx(2e-3 / math.sqrt(3.0), rel=1e-2)


def test_a_model_that_never_arrives_is_later_than_the_stroke_is_long():
    assert measure_errors(signals(0.5 * WAY, 0.0), signals(WAY, 0.0), 1e-3).time > 0.8


def test_a_stroke_without_travel_has_no_speed_and_no_time():
    found = measure_errors(signals(0.0 * WAY, 0.0), signals(1e-4 * WAY, 0.0), 1e-3)

    assert math.isnan(found.speed)
    assert math.isnan(found.time)


def test_what_is_stated_covers_nine_of_ten_strokes():
    errors = [StrokeError(1e-3 * k, math.nan, 0.0, 0.0) for k in range(1, 11)]

    assert stated_error(errors, "position") == pytest.approx(10.0)  # of ten the largest
    assert math.isnan(stated_error(errors, "speed"))
    many = [StrokeError(1e-3 * k, math.nan, 0.0, 0.0) for k in range(1, 100)]
    assert stated_error(many, "position") == pytest.approx(90.0)


def test_limits_decide():
    errors = [StrokeError(2e-3, math.nan, 1e5, 5e-3)] * 4

    assert find_exceeded(errors, [Limit("position", 3.0), Limit("time", 6.0)]) == []
    (line,) = find_exceeded(errors, [Limit("position", 1.0)])
    assert line == "position 1 mm: the error of prediction is 2 mm"
    (line,) = find_exceeded(errors, [Limit("speed", 1.0)])
    assert "no stroke that was left out shows it" in line
    assert find_exceeded([], [Limit("position", 1.0)])  # undecided is not passed


@pytest.mark.parametrize(
    "text", ["position 1 bar", "mass 1 mm", "position mm", "position 1e mm", ""]
)
def test_a_limit_that_is_none_is_refused(text):
    with pytest.raises(ConfigError, match='"position 1 mm"'):
        read_limit(text)


@pytest.mark.parametrize("text", ["position -1 mm", "position 1e999 mm", "position 0 mm"])
def test_a_limit_needs_a_number_above_zero(text):
    with pytest.raises(ConfigError, match="above 0"):
        read_limit(text)


def test_a_limit_is_read():
    assert read_limit("speed 1.5 %") == Limit("speed", 1.5)
