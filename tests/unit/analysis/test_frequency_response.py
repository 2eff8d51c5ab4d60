"""The chirp by its phase, and the estimate on systems whose response is known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from hil_bench.abilities.analysis.frequency_response import (
    Chirp,
    ResponseEstimate,
    decibel,
    estimate_response,
    measure_frequency_response,
    root_locus,
)
from hil_bench.abilities.analysis.linearisation import linearise_with_valve
from hil_bench.abilities.analysis.simulation import Setup, without_input_nonlinearities
from hil_bench.abilities.analysis.steady_motion import NyquistError
from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import Model, Solver

DT = 1e-3


def test_a_chirp_starts_and_ends_at_its_frequencies():
    samples = Chirp(amplitude=2.0, start_frequency=50.0, end_frequency=5.0, duration=10.0).samples(
        1e-4
    )

    assert len(samples) == 100_000
    assert samples[0] == 0.0
    assert np.abs(samples).max() == pytest.approx(2.0, rel=1e-3)
    rising = np.flatnonzero((samples[:-1] < 0.0) & (samples[1:] >= 0.0)) * 1e-4
    # The frequency falls by 4.5 Hz a second: between two zero crossings it is that of their middle.
    middles, frequencies = 0.5 * (rising[1:] + rising[:-1]), 1.0 / np.diff(rising)
    assert frequencies == pytest.approx(50.0 - 4.5 * middles, rel=0.02)


def test_a_chirp_knows_when_it_passes_a_frequency():
    chirp = Chirp(amplitude=1.0, start_frequency=600.0, end_frequency=1.0, duration=60.0)

    assert chirp.time_of(600.0) == 0.0
    assert chirp.time_of(1.0) == 60.0
    assert chirp.time_of(300.5) == pytest.approx(30.0)


@pytest.mark.parametrize("ends", [(600.0, 1.0), (1.0, 600.0)])
def test_a_chirp_above_nyquist_is_refused_by_name(ends):
    chirp = Chirp(amplitude=1.0, start_frequency=ends[0], end_frequency=ends[1])
    with pytest.raises(NyquistError, match="below the Nyquist frequency of 500 Hz"):
        chirp.samples(1e-3)
    with pytest.raises(NyquistError):
        chirp.samples(0.5 / 600.0)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"amplitude": 0.0}, "amplitude = 0: must be greater than 0"),
        ({"amplitude": math.nan}, "amplitude = nan: must be finite"),
        ({"start_frequency": -1.0}, "start_frequency = -1 Hz: must be greater than 0"),
        ({"end_frequency": 0.0}, "end_frequency = 0 Hz: must be greater than 0"),
        ({"duration": math.inf}, "duration = inf s: must be finite"),
    ],
)
def test_a_senseless_chirp_is_refused(given, message):
    with pytest.raises(ParameterError, match=message):
        Chirp(**{"amplitude": 1.0, **given})


@pytest.mark.parametrize("duration", [1e-4, 1e9])
def test_a_chirp_of_no_or_too_many_samples_is_refused(duration):
    with pytest.raises(ParameterError, match=r"samples of 0\.0001 s; 2 to 20000000 are right"):
        Chirp(amplitude=1.0, duration=duration).samples(1e-4)


@pytest.fixture
def noise():
    return np.random.default_rng(17)


def test_the_estimate_finds_a_known_filter(noise):
    excitation = noise.standard_normal(200_000)
    response = signal.lfilter([0.2], [1.0, -0.8], excitation)

    estimate = estimate_response(excitation, response, DT, resolution=2.0)

    # y_n = 0.8 y_(n-1) + 0.2 u_n
    turn = np.exp(-2j * np.pi * estimate.frequency[1:] * DT)
    expected = 0.2 / (1.0 - 0.8 * turn)
    assert estimate.frequency[:3] == pytest.approx([0.0, 2.0, 4.0])
    assert np.abs(estimate.response[1:] / expected - 1.0).max() < 0.02
    # A window of 500 samples cuts off the filter's memory of some 5 samples at its start.
    assert estimate.coherence[1:].min() > 0.99


def test_a_held_excitation_is_taken_as_the_staircase_that_it_is(noise):
    excitation = noise.standard_normal(200_000)
    # An integrator at the end of each held step: dt z / (z - 1) of the samples, z = exp(2j a),
    # a = pi f dt. The staircase is exp(1j a) sin(a) / a of them, so that 1 / (j w) is left, times
    # (a / sin a)² for what the staircase's images leave in the sampled response.
    response = np.cumsum(excitation - excitation.mean()) * DT

    estimate = estimate_response(excitation, response, DT, resolution=2.0, is_held=True)

    band = (estimate.frequency > 40.0) & (estimate.frequency < 400.0)
    frequency = estimate.frequency[band]
    ratio = estimate.response[band] * 2j * np.pi * frequency * np.sinc(frequency * DT) ** 2
    assert np.abs(np.angle(ratio, deg=True)).max() < 2.0  # 72 degrees at 400 Hz as samples
    assert np.abs(ratio) == pytest.approx(1.0, rel=0.03)


def test_noise_in_the_response_costs_coherence_and_does_not_bias_h1(noise):
    excitation, disturbance = noise.standard_normal((2, 400_000))
    response = 3.0 * excitation + 6.0 * disturbance

    estimate = estimate_response(excitation, response, DT, resolution=5.0)

    # Coherence = 3² / (3² + 6²) = 0.2; H1 stays 3, where H2 would give 15.
    assert np.mean(estimate.coherence[1:-1]) == pytest.approx(0.2, abs=0.01)
    assert np.mean(estimate.response[1:-1].real) == pytest.approx(3.0, rel=0.01)
    assert np.mean(estimate.response[1:-1].imag) == pytest.approx(0.0, abs=0.03)


def test_smoothing_averages_over_its_width(noise):
    excitation, disturbance = noise.standard_normal((2, 100_000))
    response = excitation + disturbance
    raw = estimate_response(excitation, response, DT, resolution=0.5)
    smooth = estimate_response(excitation, response, DT, resolution=0.5, smoothing=1.0)

    # At 100 Hz an octave is 141 lines wide, which leaves about a twelfth of the scatter.
    above = raw.frequency > 100.0
    assert np.std(smooth.response[above].real) < 0.2 * np.std(raw.response[above].real)
    # At 0.5 Hz it is narrower than the distance of two lines.
    assert smooth.response[1] == pytest.approx(raw.response[1])


def test_without_smoothing_the_estimate_is_that_of_welch(noise):
    excitation, response = noise.standard_normal((2, 5_000))
    estimate = estimate_response(excitation, response, DT, resolution=2.0)

    coherence = signal.coherence(excitation, response, 1.0 / DT, nperseg=500, noverlap=375)[1]
    assert estimate.coherence == pytest.approx(coherence)


def test_a_system_that_does_not_respond_has_no_gain_and_no_coherence(noise):
    estimate = estimate_response(noise.standard_normal(1000), np.zeros(1000), DT, resolution=2.0)

    assert not estimate.coherence.any()
    assert (estimate.gain[1:] == -math.inf).all()


@pytest.mark.parametrize(
    ("lengths", "message"),
    [((1000, 999), "both need the same number"), ((400, 400), "at least the 500 of one window")],
)
def test_signals_that_do_not_fit_are_refused(lengths, message):
    with pytest.raises(ParameterError, match=message):
        estimate_response(np.ones(lengths[0]), np.ones(lengths[1]), DT, resolution=2.0)


def test_a_signal_that_is_not_finite_is_refused():
    with pytest.raises(ParameterError, match="every sample must be finite"):
        estimate_response(np.ones(1000), np.full(1000, math.nan), DT, resolution=2.0)


def test_the_peak_is_looked_for_between_two_frequencies():
    frequency = np.array([1.0, 2.0, 3.0, 4.0])
    estimate = ResponseEstimate(
        frequency=frequency,
        response=np.array([100.0, 1.0, 10.0, 5.0], dtype=np.complex128),
        coherence=np.ones(4),
    )

    assert estimate.peak(1.5, 4.0) == pytest.approx((3.0, 20.0))
    assert estimate.gain_at(1.5) == pytest.approx(20.0)  # half-way from 40 to 0 dB
    with pytest.raises(ParameterError, match="no line of the estimate lies between 5 and 6 Hz"):
        estimate.peak(5.0, 6.0)


@pytest.mark.long
def test_a_frictionless_cylinder_measures_as_eq_24(table_1):
    parameters = replace(table_1, F_c=0.0, F_s=0.0)
    setup = without_input_nonlinearities(
        Setup(parameters=parameters, model=Model.REDUCED, solver=Solver.LINEARLY_IMPLICIT_MIDPOINT),
        largest=1e-5,
    )

    run = measure_frequency_response(setup, Chirp(amplitude=1e-5, duration=60.0))

    # The solver's step turns omega into 2 atan(omega dt / 2) / dt, which moves the phase at the
    # resonance by 0.09 degrees; a step's hold, uncorrected, would move it by 1.3 degrees there and
    # by 9 degrees at 500 Hz. The last seconds of the chirp have a window less: 5 Hz and above.
    estimate = run.estimate
    linear = linearise_with_valve(parameters, orifice_state=0.0, load_pressure=0.0)
    deviation = estimate.response / linear.response(estimate.frequency)
    inside = (estimate.frequency > 5.0) & (estimate.frequency <= 500.0)
    assert np.abs(np.angle(deviation, deg=True))[inside].max() < 0.2
    assert np.abs(decibel(deviation))[inside].max() < 0.05
    # The sweep is through the resonance, 2 zeta 71 Hz = 16 Hz wide, in 0.4 s of a window of 4 s.
    assert estimate.coherence[inside].min() > 0.97
    assert estimate.coherence[inside & (np.abs(estimate.frequency - 71.0) > 16.0)].min() > 0.99
    assert estimate.frequency[0] >= 1.0
    assert estimate.frequency[-1] <= 600.0


# The locus of k G(s) / s against Routh's criterion and the characteristic equation.


def test_the_critical_gain_is_that_of_routh(table_1):
    locus = root_locus(table_1)

    # Routh on s³ + 2 zeta omega s² + omega² s + k omega² / A: k = 2 zeta omega A = sigma A / m
    assert locus.critical_gain == pytest.approx(2000.0 * 4.85e-3 / 20.0)
    assert locus.critical_gain == pytest.approx(0.485)
    assert locus.critical_frequency == pytest.approx(447.43, abs=0.005)


def test_the_spool_in_the_loop_moves_the_critical_gain(table_1):
    # 0.493 m²/s: worked out independently, from the phase of k G(s) H(s) / s at -180 degrees
    assert root_locus(table_1, with_spool=True).critical_gain == pytest.approx(0.493, abs=0.0005)


@pytest.mark.parametrize("with_spool", [False, True])
def test_at_the_critical_gain_a_pair_lies_on_the_imaginary_axis(table_1, *, with_spool):
    limit = root_locus(table_1, with_spool=with_spool)
    gains = limit.critical_gain * np.array([0.99, 1.0, 1.01])

    real = root_locus(table_1, gains=gains, with_spool=with_spool).poles.real.max(axis=1)

    assert real[0] < -0.1
    assert real[1] == pytest.approx(0.0, abs=1e-6)
    assert real[2] > 0.1


def test_each_pole_solves_the_characteristic_equation(table_1):
    locus = root_locus(table_1, gains=[0.1, 0.7])

    for gain, poles in zip(locus.gains, locus.poles, strict=True):
        G = (1.0 / 4.85e-3) / (
            (poles / table_1.omega_c) ** 2 + 2.0 * table_1.zeta * poles / table_1.omega_c + 1.0
        )
        assert gain * G / poles == pytest.approx(-np.ones(3))


def test_the_branches_start_at_the_open_loops_poles_and_do_not_jump(table_1):
    locus = root_locus(table_1, with_spool=True)

    assert np.sort_complex(locus.poles[0]) == pytest.approx(np.sort_complex(locus.open_loop_poles))
    steps = np.abs(np.diff(locus.poles, axis=0))
    assert steps.max() < 20.0  # rad/s; two branches lie 400 apart


def test_without_damping_any_gain_is_too_much(table_1):
    locus = root_locus(replace(table_1, sigma=0.0), gains=[0.0, 1e-6])

    assert locus.critical_gain == pytest.approx(0.0, abs=1e-12) or math.isinf(locus.critical_gain)
    assert locus.poles[1].real.max() > 0.0


@pytest.mark.parametrize(
    ("gains", "message"),
    [
        ([-1.0], "0 or greater"),
        ([math.nan], "must be finite"),
        ([[1.0]], "in a row"),
        ([1.0, 1.0], "must rise"),
    ],
)
def test_senseless_gains_are_refused(table_1, gains, message):
    with pytest.raises(ParameterError, match=message):
        root_locus(table_1, gains=gains)
