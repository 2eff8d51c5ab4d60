"""The stages of a measuring chain and their order; the quantity has no unit here."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from hil_bench.devices.measurement.chain import MeasuringChain
from hil_bench.devices.measurement.low_pass import (
    ChainParameters,
    OverRange,
    natural_frequency,
    random_stream,
)

MS = 1_000_000
US = 1_000


def chain(tick=MS, seed=1, **parameters):
    return MeasuringChain(ChainParameters(**parameters), tick, random_stream(seed, "sensor"))


def measure(unit, quantities):
    return [unit.measure(float(quantity)) for quantity in quantities]


def test_with_everything_off_the_value_is_the_quantity():
    quantities = [0.0, 1.5, -2.0, 1e9]
    assert ChainParameters().is_ideal
    assert measure(chain(), quantities) == quantities


@pytest.mark.parametrize(
    "change",
    [
        {"hysteresis": 0.1},
        {"offset_error": 0.1},
        {"gain_error": 0.1},
        {"offset_drift": 0.1, "temperature": ((0.0, 1.0),)},
        {"gain_drift": 0.1, "temperature": ((0.0, 1.0),)},
        {"bandwidth": 10.0},
        {"sampling_period_ns": 3 * MS},
        {"noise_rms": 0.1},
        {"resolution": 0.3},
        {"range": (0.0, 1.0)},
        {"delay_ns": MS},
    ],
)
def test_no_stage_alone_is_ideal(change):
    assert not ChainParameters(**change).is_ideal
    assert measure(chain(**change), [0.5, 1.4, 2.9]) != [0.5, 1.4, 2.9]


def test_drift_without_temperature_and_temperature_without_drift_are_off():
    assert ChainParameters(offset_drift=0.1).is_ideal
    assert ChainParameters(temperature=((0.0, 1.0),)).is_ideal


def test_offset_and_gain_error_add():
    unit = chain(offset_error=0.5, gain_error=0.01)
    assert measure(unit, [0.0, 100.0, -100.0]) == pytest.approx([0.5, 101.5, -100.5])


def test_drift_follows_the_temperature():
    """At 0, 1, 2, 3, 4 ms it is 0, 0, 10, 20 and 20 K warmer than the reference."""
    unit = chain(
        offset_drift=0.1, gain_drift=0.01, temperature=((0.001, 0.0), (0.003, 20.0)), gain_error=0.1
    )
    expected = [110.0, 110.0, 110.0 + 1.0 + 10.0, 110.0 + 2.0 + 20.0, 110.0 + 2.0 + 20.0]
    assert measure(unit, [100.0] * 5) == pytest.approx(expected)


def test_two_temperatures_at_one_time_are_a_step():
    unit = chain(offset_drift=1.0, temperature=((0.0, 5.0), (0.002, 5.0), (0.002, 7.0)))
    assert measure(unit, [0.0] * 4) == pytest.approx([5.0, 5.0, 7.0, 7.0])


def test_hysteresis_is_a_loop_of_its_width():
    unit = chain(hysteresis=2.0)
    measure(unit, [0.0, 10.0, -10.0])
    rising = measure(unit, [-5.0, 0.0, 5.0, 10.0])
    falling = measure(unit, [5.0, 0.0, -5.0])
    assert rising == [-6.0, -1.0, 4.0, 9.0]  # half of the width late each way
    assert falling == [6.0, 1.0, -4.0]
    assert measure(unit, [-4.0, -3.0]) == [-4.0, -4.0]  # within the loop nothing moves


def test_quantisation_gives_whole_steps():
    assert measure(chain(resolution=0.25), [0.1, 0.13, -0.4]) == [0.0, 0.25, -0.5]


def test_beyond_its_range_a_chain_saturates():
    assert measure(chain(range=(-1.0, 2.0)), [-5.0, 0.5, 2.0, 2.1]) == [-1.0, 0.5, 2.0, 2.0]


def test_beyond_its_range_a_chain_may_have_no_value():
    unit = chain(range=(-1.0, 2.0), over_range=OverRange.INVALID)
    values = measure(unit, [-5.0, 0.5, 2.0, 2.1, 1.0, -1.0])
    assert [math.isnan(value) for value in values] == [True, False, False, True, False, False]
    assert values[4] == 1.0  # nothing of it stays


def test_a_step_takes_the_time_of_the_low_pass():
    """From tick to tick the input is linear: after a ramp of one tick, the exact ramp response."""
    unit, tau, tick = chain(bandwidth=50.0), 1.0 / (2 * math.pi * 50.0), 1e-3
    values = measure(unit, [0.0] + [1.0] * 20)
    after_ramp = 1.0 - tau / tick * (1.0 - math.exp(-tick / tau))
    expected = [1.0 - (1.0 - after_ramp) * math.exp(-k * tick / tau) for k in range(20)]
    assert values[1:] == pytest.approx(expected)


def test_a_delay_of_whole_ticks_shifts_the_values():
    assert measure(chain(delay_ns=2 * MS), [5.0, 6.0, 7.0, 8.0, 9.0]) == [5.0, 5.0, 5.0, 6.0, 7.0]


def test_a_delay_of_parts_of_ticks_shifts_the_linear_quantity():
    values = measure(chain(delay_ns=1250 * US), [0.0, 1.0, 2.0, 3.0, 4.0])
    assert values == pytest.approx([0.0, 0.0, 0.75, 1.75, 2.75])


def test_a_delayed_low_pass_is_exact_between_the_ticks():
    inputs = np.random.default_rng(3).normal(size=50).cumsum()
    inputs -= inputs[0]
    unit = chain(bandwidth=120.0, order=2, damping_ratio=0.5, delay_ns=400 * US)
    values = measure(unit, inputs)

    omega_3db, zeta = 2 * math.pi * 120.0, 0.5
    skew = 1 - 2 * zeta**2
    omega = omega_3db / math.sqrt(skew + math.sqrt(skew**2 + 1))
    fine = np.arange(49 * 5 + 1) * 0.2e-3
    system = ([omega**2], [1.0, 2 * zeta * omega, omega**2])
    _, expected, _ = signal.lsim(system, np.interp(fine, np.arange(50) * 1e-3, inputs), fine)
    # At tick k the value of k - 0.4 ms: two fifths of a tick before.
    np.testing.assert_allclose(values[1:], expected[3::5], atol=1e-9)


def test_a_slower_clock_holds_its_samples():
    unit = chain(sampling_period_ns=3 * MS, sampling_phase_ns=MS)
    assert measure(unit, range(10)) == [0, 1, 1, 1, 4, 4, 4, 7, 7, 7]


def test_without_phase_the_first_sample_is_at_the_start():
    assert measure(chain(sampling_period_ns=2 * MS), range(6)) == [0, 0, 2, 2, 4, 4]


def test_a_clock_of_its_own_beats_with_the_ticks():
    """Samples at 1.5, 3, 4.5, 6 ms of a quantity that is the time in ms."""
    values = measure(chain(sampling_period_ns=1500 * US), range(7))
    assert values == pytest.approx([0.0, 0.0, 1.5, 3.0, 3.0, 4.5, 6.0])


def test_of_several_samples_in_a_tick_the_latest_is_there():
    """Samples each 0.4 ms that are ready 0.3 ms later: at 1, 2, 3 ms those of 0.4, 1.6, 2.4 ms."""
    values = measure(chain(sampling_period_ns=400 * US, delay_ns=300 * US), range(4))
    assert values == pytest.approx([0.0, 0.4, 1.6, 2.4])


def test_noise_comes_before_quantisation_and_range():
    unit = chain(noise_rms=0.5, resolution=0.25, range=(-0.5, 0.75))
    values = set(measure(unit, [0.0] * 500))
    assert values == {-0.5, -0.25, 0.0, 0.25, 0.5, 0.75}


def test_noise_is_held_with_its_sample():
    values = measure(chain(noise_rms=1.0, sampling_period_ns=2 * MS), [0.0] * 6)
    assert values[0] == values[1] != values[2] == values[3] != values[4] == values[5]


def test_the_same_seed_gives_the_same_values_and_another_seed_others():
    parameters = {"noise_rms": 1.0, "noise_density": 0.1, "bandwidth": 50.0, "order": 2}
    first, again = (measure(chain(**parameters), [0.0] * 300) for _ in range(2))
    assert first == again
    assert first != measure(chain(seed=2, **parameters), [0.0] * 300)


def test_density_noise_has_the_rms_of_its_low_pass():
    """Of the first order: density times sqrt(π/2 bandwidth). 5 kHz leaves samples independent."""
    values = measure(chain(noise_density=0.01, bandwidth=5000.0), [0.0] * 20_000)
    rms = 0.01 * math.sqrt(math.pi / 2 * 5000.0)
    assert np.std(values) == pytest.approx(rms, rel=5 / math.sqrt(2 * 20_000))


def test_density_noise_follows_the_order_of_its_low_pass():
    """Of the second order: density times sqrt(ω / (8 ζ)), a sixth less than of the first here."""
    parameters = {"bandwidth": 5000.0, "order": 2, "damping_ratio": 0.7}
    values = measure(chain(noise_density=0.01, **parameters), [0.0] * 20_000)
    rms = 0.01 * math.sqrt(natural_frequency(5000.0, 0.7) / (8 * 0.7))
    assert np.std(values) == pytest.approx(rms, rel=5 / math.sqrt(2 * 20_000))


def test_speed_is_the_mean_over_the_window():
    unit = chain(speed_window_ns=4 * MS)
    speeds = []
    for position in [0.0, 0.0, 1e-3, 2e-3, 3e-3, 4e-3, 4e-3]:
        unit.measure(position)
        speeds.append(unit.speed(99.0))
    # As many samples as there are, up to four intervals of 1 ms.
    assert speeds == pytest.approx([0.0, 0.0, 0.5, 2 / 3, 0.75, 1.0, 0.75])


def test_speed_counts_samples_where_they_are_slower_than_ticks():
    unit = chain(speed_window_ns=3 * MS, sampling_period_ns=3 * MS)
    speeds = []
    for tick in range(8):
        unit.measure(tick * 1e-3)
        speeds.append(unit.speed(99.0))
    assert speeds == pytest.approx([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0])


def test_a_window_shorter_than_a_sample_is_one():
    unit = chain(speed_window_ns=MS, sampling_period_ns=2 * MS)
    for position in [0.0, 0.0, 2e-3, 2e-3, 8e-3]:
        unit.measure(position)
    assert unit.speed(99.0) == pytest.approx(6e-3 / 2e-3)


def test_without_a_window_speed_is_the_true_one():
    unit = chain(resolution=0.1)
    unit.measure(1.0)
    assert unit.speed(0.123) == 0.123


# What holds for every measuring chain_of.


microseconds = st.integers(1, 5000)


def chain_of(parameters, tick_us):
    return MeasuringChain(parameters, tick_us * US, random_stream(1, "sensor"))


@given(
    tick_us=st.integers(100, 3000),
    period_us=st.integers(10, 5000),
    share=st.floats(0.0, 0.99),
    delay_us=st.integers(0, 5000),
    seed=st.integers(0, 9),
)
@settings(max_examples=60)
def test_the_latest_sample_that_is_ready_is_shown(tick_us, period_us, share, delay_us, seed):
    """Against the definition: sample k is of phase + k period, and there delay later."""
    phase_us = int(share * period_us)
    quantities = np.random.default_rng(seed).normal(size=12)
    ticks_us = np.arange(quantities.size) * tick_us
    unit = chain_of(
        ChainParameters(
            sampling_period_ns=period_us * US,
            sampling_phase_ns=phase_us * US,
            delay_ns=delay_us * US,
        ),
        tick_us,
    )
    for now_us, quantity in zip(ticks_us, quantities, strict=True):
        samples = np.arange(phase_us, max(now_us - delay_us, -1) + 1, period_us)
        latest = samples[-1] if samples.size else 0  # before the first: as at the start
        expected = np.interp(latest, ticks_us, quantities)
        assert math.isclose(unit.measure(float(quantity)), expected, abs_tol=1e-9)


amounts = st.just(0.0) | st.floats(1e-12, 1e11)
signed = st.floats(-1e11, 1e11)
PARAMETERS = st.builds(
    ChainParameters,
    hysteresis=amounts,
    offset_error=signed,
    gain_error=st.floats(-1e4, 1e4),
    offset_drift=signed,
    gain_drift=st.floats(-1.0, 1.0),
    temperature=st.lists(
        st.tuples(st.floats(-1.0, 1.0), st.floats(-1000.0, 1000.0)), max_size=3
    ).map(lambda points: tuple(sorted(points))),
    bandwidth=st.floats(1e-6, 1e6),
    order=st.sampled_from([1, 2]),
    damping_ratio=st.floats(0.01, 100.0),
    sampling_period_ns=st.just(0) | microseconds.map(lambda us: max(us, 10) * US),
    noise_density=amounts,
    noise_rms=amounts,
    resolution=amounts,
    range=st.none() | st.tuples(st.floats(-1e11, -1.0), st.floats(1.0, 1e11)),
    over_range=st.sampled_from(OverRange),
    delay_ns=st.just(0) | microseconds.map(lambda us: us * US),
    speed_window_ns=st.just(0) | microseconds.map(lambda us: us * US),
)


@given(parameters=PARAMETERS, quantities=st.lists(st.floats(-1e12, 1e12), min_size=1, max_size=8))
@settings(max_examples=150)
def test_whatever_the_configuration_lets_through_is_a_number_or_no_value(parameters, quantities):
    unit = chain_of(parameters, 1000)
    for quantity in quantities:
        value = unit.measure(quantity)
        if math.isnan(value):
            assert parameters.over_range is OverRange.INVALID
        elif parameters.range is not None:
            low, high = parameters.range
            assert low <= value <= high
        else:
            assert math.isfinite(value)
