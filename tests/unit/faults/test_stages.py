"""What faults make of a measured value and of its rate."""

import math

import numpy as np
import pytest

from hil_bench.abilities.faults.checks import BrokenReading
from hil_bench.abilities.faults.stages import Broken, Frozen, Lag, Noisy, Shifted, Slowed
from hil_bench.devices.measurement.low_pass import normal_numbers, random_stream

TICK = 1e-3


def test_a_frozen_sensor_shows_its_first_value_and_no_speed():
    stage = Frozen()
    assert [stage.value(value) for value in (3.0, 4.0, math.nan)] == [3.0, 3.0, 3.0]
    assert stage.rate(5.0) == 0.0


def test_an_offset_is_added_and_leaves_the_rate():
    stage = Shifted(2.0, 0.0, TICK)
    assert [stage.value(value) for value in (1.0, 5.0)] == [3.0, 7.0]
    assert stage.rate(0.5) == 0.5


def test_a_drift_grows_from_zero_and_is_part_of_the_rate():
    stage = Shifted(0.0, 100.0, TICK)  # 0.1 a tick
    assert [stage.value(1.0) for _ in range(3)] == pytest.approx([1.0, 1.1, 1.2])
    assert stage.rate(0.5) == 100.5


def test_noise_has_its_rms():
    stage = Noisy(2.0, normal_numbers(random_stream(1, "sensor")))
    values = [stage.value(10.0) for _ in range(5000)]
    # 5 standard deviations of an RMS from 5000 samples: 5 / sqrt(10000).
    assert np.std(values) == pytest.approx(2.0, rel=0.05)
    assert np.mean(values) == pytest.approx(10.0, abs=5 * 2.0 / math.sqrt(5000))
    assert stage.rate(0.5) == 0.5


@pytest.mark.parametrize(
    ("reading", "value"), [(BrokenReading.LOW, -math.inf), (BrokenReading.HIGH, math.inf)]
)
def test_a_broken_wire_reads_beyond_every_range(reading, value):
    stage = Broken(reading)
    assert stage.value(1.0) == value
    assert math.isnan(stage.rate(1.0))


def test_a_broken_wire_may_read_nothing():
    assert math.isnan(Broken(BrokenReading.NOTHING).value(1.0))


def test_a_slow_sensor_begins_settled_and_lags_by_its_time_constant():
    stage = Slowed(0.01, TICK)
    assert stage.value(5.0) == 5.0
    for _ in range(1000):
        last = stage.value(5.0)
    assert last == 5.0
    # A ramp of 1 a second is shown a time constant late once it has settled.
    for tick in range(1, 1000):
        shown = stage.value(5.0 + tick * TICK)
    assert 5.0 + 999 * TICK - shown == pytest.approx(0.01)
    assert stage.rate(1.0) == 1.0  # its own, settled at its first value


def test_a_lag_lets_through_what_is_no_number_and_goes_on():
    lag = Lag(0.01, TICK)
    assert lag.follow(1.0) == 1.0
    assert math.isnan(lag.follow(math.nan))
    assert lag.follow(math.inf) == math.inf
    assert lag.follow(1.0) == 1.0


def test_a_lag_may_begin_elsewhere():
    lag = Lag(1.0, TICK, start=0.0)
    # The input goes from 0 to 1 within the tick: T / (2 τ) of it is through.
    assert lag.follow(1.0) == pytest.approx(0.0005, rel=1e-3)
    assert Lag(1.0, TICK, start=2.0).follow(2.0) == 2.0
