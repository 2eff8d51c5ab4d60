"""The low-passes against scipy.signal, whose lsim takes the input linear from sample to sample."""

import math

import numpy as np
import pytest
from scipy import linalg, signal

from hil_bench.devices.measurement.low_pass import (
    FirstOrderLowPass,
    FirstOrderNoise,
    SecondOrderLowPass,
    SecondOrderNoise,
    Unlimited,
    WhiteNoise,
    natural_frequency,
    normal_numbers,
    random_stream,
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
def test_the_output_at_and_between_the_ticks_is_that_of_scipy(bandwidth, order, damping_ratio):
    parts = 5
    fine = np.arange((INPUT.size - 1) * parts + 1) * (TICK / parts)
    inputs = np.interp(fine, np.arange(INPUT.size) * TICK, INPUT - INPUT[0])
    _, expected, _ = signal.lsim(system(bandwidth, order, damping_ratio), inputs, fine)

    unit = low_pass(bandwidth, order, damping_ratio)
    unit.settle(INPUT[0])
    outputs = [INPUT[0]]
    for value in INPUT[1:]:
        unit.advance(value)
        outputs += [unit.at((part + 1) * TICK / parts) for part in range(parts)]

    np.testing.assert_allclose(outputs, expected + INPUT[0], atol=1e-9)


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


# Streams, and the noise that they make; expectations from the theory of linear systems.


PERIOD = 1e-3
COUNT = 40_000
# The standard deviation of an RMS found from n independent samples is RMS / sqrt(2 n).
TOLERANCE = 5.0 / math.sqrt(2.0 * COUNT)


def draws(*names, seed=1):
    return normal_numbers(random_stream(seed, *names))


def samples(noise, count=COUNT):
    return np.array([noise.add_to(0.0) for _ in range(count)])


def test_the_numbers_are_those_of_single_draws_of_the_stream():
    draw, stream = draws("pressure_a"), random_stream(1, "pressure_a")
    assert [draw() for _ in range(600)] == [stream.standard_normal() for _ in range(600)]


@pytest.mark.parametrize("other", [(2, "pressure_a"), (1, "pressure_b"), (1, "pressure_a", "x")])
def test_another_seed_or_name_gives_another_stream(other):
    seed, *names = other
    assert draws("pressure_a")() != draws(*names, seed=seed)()


def test_two_streams_are_not_correlated():
    a, b = draws("pressure_a"), draws("pressure_b")
    products = np.array([a() * b() for _ in range(COUNT)])
    assert abs(products.mean()) < 5.0 / math.sqrt(COUNT)


def test_white_noise_has_its_rms():
    noise = samples(WhiteNoise(0.3, draws("a")))
    assert noise.std() == pytest.approx(0.3, rel=TOLERANCE)
    assert abs(np.mean(noise[1:] * noise[:-1])) < 5.0 * 0.3**2 / math.sqrt(COUNT)


def test_shaped_noise_of_first_order_has_variance_and_correlation_of_the_low_pass():
    """RMS: density times sqrt(π/2 bandwidth); from sample to sample exp(-T/τ) stays."""
    bandwidth = 100.0
    noise = samples(FirstOrderNoise(0.02, bandwidth, PERIOD, draws("a")))
    rms = 0.02 * math.sqrt(math.pi / 2.0 * bandwidth)
    correlation = math.exp(-2.0 * math.pi * bandwidth * PERIOD)
    # Correlated samples are worth as many independent ones as (1 - c²) / (1 + c²) tells.
    worth = math.sqrt((1 + correlation**2) / (1 - correlation**2))
    assert noise.std() == pytest.approx(rms, rel=TOLERANCE * worth)
    assert np.mean(noise[1:] * noise[:-1]) / rms**2 == pytest.approx(
        correlation, abs=2 * TOLERANCE * worth
    )


def test_shaped_noise_of_first_order_begins_as_it_goes_on():
    """The first value has the RMS of all: it is that many times the first number drawn."""
    noise = FirstOrderNoise(0.02, 100.0, PERIOD, scripted(2.0))
    assert noise._value == pytest.approx(2.0 * 0.02 * math.sqrt(math.pi / 2.0 * 100.0))


def scripted(*numbers):
    rest = list(numbers)
    return lambda: rest.pop(0)


@pytest.mark.parametrize("damping_ratio", [0.2, 0.7, 1.0, 4.0])
@pytest.mark.parametrize("bandwidth", [5.0, 100.0, 3000.0])
def test_shaped_noise_of_second_order_is_that_of_the_continuous_low_pass(bandwidth, damping_ratio):
    """Transition and new covariance against Van Loan's matrix exponential."""
    density, omega = 0.02, natural_frequency(bandwidth, damping_ratio)
    a = np.array([[0.0, 1.0], [-(omega**2), -2.0 * damping_ratio * omega]])
    # A one-sided density n is a two-sided one of n²/2.
    intensity = np.diag([0.0, omega**4 * density**2 / 2.0])
    # In seconds of 1/ω both states have one size, and no digit is lost.
    scale = np.diag([1.0, 1.0 / omega])
    a, intensity = scale @ a @ linalg.inv(scale), scale @ intensity @ scale
    stationary = linalg.solve_continuous_lyapunov(a, -intensity)
    phi = linalg.expm(a * PERIOD)
    expected = stationary - phi @ stationary @ phi.T

    root = np.zeros((2, 2))
    for column, numbers in enumerate([(1.0, 0.0), (0.0, 1.0)]):
        noise = SecondOrderNoise(
            density, bandwidth, damping_ratio, PERIOD, scripted(0.0, 0.0, *numbers)
        )
        root[:, column] = noise.add_to(0.0), noise._rate / omega
    start = SecondOrderNoise(density, bandwidth, damping_ratio, PERIOD, scripted(1.0, 0.0))

    assert start._value**2 == pytest.approx(stationary[0, 0])
    scale = stationary[0, 0]
    np.testing.assert_allclose(root @ root.T / scale, expected / scale, atol=1e-9)


def test_the_spectrum_of_shaped_noise_is_density_times_gain():
    """Welch's estimate far below the bandwidth is the density, and half its power at it."""
    density, bandwidth, rate = 0.02, 100.0, 2000.0
    noise = samples(SecondOrderNoise(density, bandwidth, 0.7, 1.0 / rate, draws("a")), 100_000)
    frequency, power = signal.welch(noise, rate, nperseg=1000)
    segments = 2 * noise.size // 1000
    low = np.mean(power[(frequency >= 4) & (frequency <= 30)])
    at_bandwidth = np.mean(power[(frequency >= 96) & (frequency <= 104)])
    assert low == pytest.approx(density**2, rel=5 / math.sqrt(segments * 13))
    assert at_bandwidth == pytest.approx(density**2 / 2, rel=5 / math.sqrt(segments * 5))
