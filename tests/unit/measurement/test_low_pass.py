"""The low-passes against scipy.signal, whose lsim takes the input linear from sample to sample."""

import math

import numpy as np
import pytest
from scipy import linalg, signal

from hil_bench.devices.measurement.low_pass import (
    FirstOrderLowPass,
    SecondOrderLowPass,
    Unlimited,
    natural_frequency,
    transition,
)

TICK = 1e-3
INPUT = np.random.default_rng(1).normal(size=200).cumsum()


def system(bandwidth, order, damping_ratio):
    if order == 1:
        return ([1.0], [1.0 / (2.0 * math.pi * bandwidth), 1.0])
    omega = natural_frequency(bandwidth, damping_ratio)
    return ([omega**2], [1.0, 2.0 * damping_ratio * omega, omega**2])


def low_pass(bandwidth, order, damping_ratio):
    if order == 1:
        return FirstOrderLowPass(bandwidth, TICK)
    return SecondOrderLowPass(bandwidth, damping_ratio, TICK)


FILTERS = pytest.mark.parametrize(
    ("bandwidth", "order", "damping_ratio"),
    [(2.0, 1, 0.0), (233.0, 1, 0.0), (2000.0, 1, 0.0)]
    + [(b, 2, d) for b in (2.0, 233.0, 2000.0) for d in (0.2, 0.7, 1.0, 1.5, 20.0)],
)


@FILTERS
def test_the_output_at_the_ticks_is_that_of_scipy(bandwidth, order, damping_ratio):
    time = np.arange(INPUT.size) * TICK
    _, expected, _ = signal.lsim(system(bandwidth, order, damping_ratio), INPUT - INPUT[0], time)

    unit = low_pass(bandwidth, order, damping_ratio)
    unit.settle(INPUT[0])
    outputs = [INPUT[0]]
    for value in INPUT[1:]:
        unit.advance(value)
        outputs.append(unit.at(TICK))

    np.testing.assert_allclose(outputs, expected + INPUT[0], atol=1e-9)


@FILTERS
def test_the_output_between_the_ticks_is_that_of_scipy(bandwidth, order, damping_ratio):
    parts = 5
    fine = np.arange((INPUT.size - 1) * parts + 1) * (TICK / parts)
    inputs = np.interp(fine, np.arange(INPUT.size) * TICK, INPUT - INPUT[0])
    _, expected, _ = signal.lsim(system(bandwidth, order, damping_ratio), inputs, fine)

    unit = low_pass(bandwidth, order, damping_ratio)
    unit.settle(0.0)
    outputs = [0.0]
    for value in INPUT[1:] - INPUT[0]:
        unit.advance(value)
        outputs += [unit.at((part + 1) * TICK / parts) for part in range(parts)]

    np.testing.assert_allclose(outputs, expected, atol=1e-9)


@FILTERS
def test_the_matched_filter_of_scipy_is_the_same(bandwidth, order, damping_ratio):
    """cont2discrete with a first-order hold, run by lfilter."""
    numerator, denominator, _ = signal.cont2discrete(
        system(bandwidth, order, damping_ratio), TICK, method="foh"
    )
    inputs = INPUT - INPUT[0]
    expected = signal.lfilter(numerator.ravel(), denominator, inputs)

    unit = low_pass(bandwidth, order, damping_ratio)
    outputs = []
    for value in inputs:
        unit.advance(value)
        outputs.append(unit.at(TICK))

    # A polynomial of poles close to 1, as 2 Hz at 1 kHz, costs lfilter digits.
    np.testing.assert_allclose(outputs, expected, atol=1e-6)


@pytest.mark.parametrize("damping_ratio", [0.1, 0.7071, 1.0, 3.0, 1e3])
def test_the_bandwidth_is_that_of_3_db(damping_ratio):
    omega = natural_frequency(100.0, damping_ratio)
    s = 2j * math.pi * 100.0

    gain = omega**2 / (s**2 + 2.0 * damping_ratio * omega * s + omega**2)

    assert abs(gain) == pytest.approx(math.sqrt(0.5))


@pytest.mark.parametrize("damping_ratio", [0.0, 0.3, 0.999999, 1.0, 1.000001, 2.0, 50.0])
@pytest.mark.parametrize("time", [1e-6, 1e-3, 0.1])
def test_the_transition_is_the_matrix_exponential(damping_ratio, time):
    omega = 500.0
    matrix = np.array([[0.0, 1.0], [-(omega**2), -2.0 * damping_ratio * omega]])

    actual = np.array(transition(omega, damping_ratio, time)).reshape(2, 2)

    # In the units of the oscillation, in which each entry is at most about 1.
    scale = np.diag([1.0, 1.0 / omega])
    expected = scale @ linalg.expm(matrix * time) @ linalg.inv(scale)
    np.testing.assert_allclose(scale @ actual @ linalg.inv(scale), expected, atol=1e-8)


def test_a_strongly_damped_low_pass_does_not_overflow():
    assert transition(1e6, 1e3, 1.0) == pytest.approx((0.0, 0.0, 0.0, 0.0), abs=1e-9)


def test_a_settled_low_pass_stays():
    for unit in (low_pass(50.0, 1, 0.0), low_pass(50.0, 2, 0.5), Unlimited(TICK)):
        unit.settle(7.0)
        unit.advance(7.0)
        assert unit.at(0.3 * TICK) == unit.at(TICK) == 7.0


def test_no_limit_is_linear_between_the_ticks():
    unit = Unlimited(TICK)
    unit.settle(2.0)
    unit.advance(4.0)
    assert (unit.at(0.25 * TICK), unit.at(TICK)) == (2.5, 4.0)
