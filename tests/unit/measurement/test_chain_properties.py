"""What holds for every measuring chain."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hil_bench.devices.measurement.chain import MeasuringChain
from hil_bench.devices.measurement.low_pass import ChainParameters, OverRange, random_stream

US = 1_000
microseconds = st.integers(1, 5000)


def chain(parameters, tick_us):
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
    unit = chain(
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
    unit = chain(parameters, 1000)
    for quantity in quantities:
        value = unit.measure(quantity)
        if math.isnan(value):
            assert parameters.over_range is OverRange.INVALID
        elif parameters.range is not None:
            low, high = parameters.range
            assert low <= value <= high
        else:
            assert math.isfinite(value)
