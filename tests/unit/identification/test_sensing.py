"""Sensors that are behind what they measure."""

import numpy as np
import pytest

from hil_bench.abilities.identification.logger import sense


def test_a_ramp_comes_late_by_the_delay_and_by_the_lag():
    ramp = np.concatenate([np.zeros(100), np.arange(101.0)])

    shown = sense(np.repeat(ramp[:, np.newaxis], 3, axis=1), 2.5, 4.0)

    # the lag's start has faded by exp(-50 / 4)
    assert shown[-50:, 0] == pytest.approx(ramp[-50:] - 2.5)
    assert shown[-50:, 1:] == pytest.approx(np.repeat(ramp[-50:, np.newaxis], 2, axis=1) - 4.0)


def test_sensors_without_delay_and_lag_show_the_motion():
    motion = np.random.default_rng(1).standard_normal((9, 3))

    assert np.array_equal(sense(motion, 0.0, 0.0), motion[1:])


def test_a_step_behind_a_lag_fades_as_an_exponential_from_rest():
    motion = np.full((401, 3), 2.0)
    motion[100:] = 3.0

    shown = sense(motion, 0.0, 100.0)

    # the step goes from row 99 to row 100, so it is in the middle of that
    expected = 3.0 - np.exp(-(np.arange(200, 401) - 99.5) / 100.0)
    assert shown[199:, 2] == pytest.approx(expected, abs=1e-4)
    assert shown[:98, 1] == pytest.approx(2.0)
