"""Estimates against signals whose answer is known because it was put in."""

import math

import numpy as np
import pytest

from hil_bench.abilities.commissioning.measures import (
    Mode,
    dead_band,
    derivative,
    fit_mode,
    frequency_response,
    friction,
    noise,
    resample,
    rise_time,
    slope,
    undo_derivative,
)

TIME = np.arange(1000) * 2e-3


def test_too_few_samples_tell_nothing():
    assert math.isnan(slope(TIME[:1], TIME[:1]))
    assert math.isnan(noise(TIME[:2], TIME[:2]))


def test_a_valve_that_never_opens_has_no_edges():
    found = dead_band(0.5 * np.sin(TIME), np.zeros_like(TIME))
    assert math.isnan(found.width)


def test_a_motion_one_way_alone_tells_no_friction():
    assert math.isnan(friction(np.abs(np.sin(TIME)), TIME, slowest=0.02).coulomb)


def sweep(period, duration=2.0, band=(2.0, 120.0)):
    time = np.arange(round(duration / period)) * period
    rate = (band[1] - band[0]) / duration
    return time, np.sin(2 * np.pi * (band[0] + 0.5 * rate * time) * time)


def test_noise_lowers_the_coherence():
    _, signal = sweep(1e-3)
    generator = np.random.default_rng(1)
    measured = frequency_response(signal, generator.normal(size=len(signal)), 1e-3, (5.0, 100.0))
    assert measured.coherence.mean() < 0.5


def test_a_lead_is_told_from_the_mode():
    mode = Mode(40.0, 0.1, 2.5, lead=3e-3)
    frequency = np.linspace(5, 100, 200)
    measured = frequency_response(*[sweep(1e-3)[1]] * 2, 1e-3, (5.0, 100.0))._replace(
        frequency=frequency, response=mode.response(frequency), coherence=np.ones(200)
    )
    assert fit_mode(measured) == pytest.approx(mode)


def test_a_derivative_by_differences_is_corrected():
    period, frequency = 2e-3, 100.0
    wave = np.sin(2 * np.pi * frequency * TIME)
    true = 2 * np.pi * frequency * np.cos(2 * np.pi * frequency * TIME)
    measured = frequency_response(wave, derivative(wave, TIME), period, (99.9, 100.1))
    corrected = undo_derivative(measured, period)
    expected = frequency_response(wave, true, period, (99.9, 100.1))
    assert np.abs(corrected.response) == pytest.approx(np.abs(expected.response), rel=0.02)
    # sin(x) / x at x = 0.4 π is 0.757: without the correction a quarter would be missing.
    assert np.abs(measured.response / expected.response) == pytest.approx(0.757, rel=0.02)


def test_left_out_samples_are_bridged():
    whole = np.sin(2 * np.pi * TIME)
    kept = np.ones(len(TIME), dtype=bool)
    kept[7::11] = False
    found = resample(TIME[kept], whole[kept], 2e-3)
    # A straight line over two periods is off by (2 pi f h)^2 / 2 of the amplitude: 8e-5 here.
    assert found == pytest.approx(whole, abs=1e-4)


def test_rise_time_between_two_samples():
    time = np.arange(20) * 2e-3
    setpoint = np.where(time >= 6e-3, 0.5, 0.0)
    lag = 7e-3  # of a first-order lag, whose time to 63 % is the lag itself
    actual = np.where(time > 4e-3, 0.5 * (1 - np.exp(-(time - 4e-3) / lag)), 0.0)
    assert rise_time(time, setpoint, actual) == pytest.approx(lag, rel=0.02)
    assert math.isnan(rise_time(time, setpoint, np.zeros_like(time)))
    assert math.isnan(rise_time(time, np.zeros_like(time), actual))
