"""Sensors that are behind what they measure."""

import numpy as np
import pytest

from hil_bench.abilities.identification.sensing import Sensors, sense


def test_a_ramp_comes_late_by_delay_and_lag() -> None:
    motion = np.repeat(np.linspace(0.0, 1.0, 101)[np.newaxis, :, np.newaxis], 3, axis=2)

    shown = sense(motion, 1e-3, Sensors(2e-3, 3e-3, 0.0, 4e-3), every=10)

    # 0.01 a millisecond, after 10, 20, ... ms
    rows = 0.1 * np.arange(1, 11)
    assert shown[0, :, 0] == pytest.approx(rows - 0.05)
    assert shown[0, :, 1] == pytest.approx(rows - 0.04)


@pytest.mark.parametrize(("intervals", "rows"), [(99, 9), (100, 10), (9, 0)])
def test_rows_come_after_whole_steps_alone(intervals: int, rows: int) -> None:
    shown = sense(np.zeros((2, intervals + 1, 3)), 1e-3, Sensors(0.0, 0.0, 0.0, 0.0), every=10)
    assert shown.shape == (2, rows, 3)


def test_a_step_behind_a_lag_fades_as_an_exponential() -> None:
    motion = np.zeros((1, 401, 3))
    motion[:, 100:] = 1.0
    lag = 10e-3

    shown = sense(motion, 1e-4, Sensors(0.0, lag, 0.0, lag), every=100)

    # the step begins between the intervals 99 and 100, so 0.05 ms before 10 ms
    expected = 1.0 - np.exp(-(np.arange(2, 5) * 10e-3 - 9.95e-3) / lag)
    assert shown[0, 1:, 2] == pytest.approx(expected, abs=1e-4)
