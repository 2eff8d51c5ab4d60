"""What the statements are made of, on motions and systems whose answer is known."""

import math

import numpy as np
import pytest

from hil_bench.abilities.analysis.frequency_response import Chirp, ChirpRun, ResponseEstimate
from hil_bench.abilities.analysis.simulation import CHANNELS, Setup
from hil_bench.abilities.analysis.simulation_statements import (
    dominant_frequency,
    eigenfrequency_at,
    phase_lead,
    position_at,
    ripple,
)
from hil_bench.outside.recording.channels import recording_dtype


def motion(lead_deg, *, amplitude=0.01, drift=0.1):
    """A velocity that oscillates at 70 Hz about a slow motion, and a pressure that leads it."""
    run = np.zeros(4000, dtype=recording_dtype(CHANNELS))
    run["time"] = np.arange(4000) * 5e-4
    angle = 2.0 * math.pi * 70.0 * run["time"]
    run["v"] = drift * run["time"] ** 2 + amplitude * np.sin(angle)
    run["P_L"] = 2e5 + 1e5 * run["time"] + 3e4 * np.sin(angle + math.radians(lead_deg))
    return run


@pytest.mark.parametrize("lead", [0.0, 77.0, -120.0, 179.0])
def test_the_phase_lead_of_an_oscillation_is_found(lead):
    assert phase_lead(motion(lead), 0.5, 1.0) == pytest.approx(lead, abs=0.5)


def test_the_frequency_of_an_oscillation_is_found():
    assert dominant_frequency(motion(30.0), 0.5, 0.8) == pytest.approx(70.0, abs=0.5)


def test_the_ripple_is_what_the_trend_leaves():
    # At both ends of the span the polynomial gives way to half a swing: some 5 %.
    assert ripple(motion(0.0, amplitude=0.01), 0.2, 1.8) == pytest.approx(0.01, rel=0.1)
    assert ripple(motion(0.0, amplitude=0.0), 0.2, 1.8) == pytest.approx(0.0, abs=1e-9)


def test_the_eigenfrequency_off_mid_stroke_is_that_by_hand(table_1):
    # x = 0: 5e6 (25e-6 / 1.2e-3 + 22.09e-6 / 1.15e-3) = 200,210, of which the root is 447.45.
    # x = 0.1: 5e6 (25e-6 / 1.7e-3 + 22.09e-6 / 0.68e-3) = 235,956, of which it is 485.75.
    assert eigenfrequency_at(table_1, 0.0) == pytest.approx(447.45, abs=0.01)
    assert eigenfrequency_at(table_1, 0.1) == pytest.approx(485.75, abs=0.01)


def test_the_position_is_looked_up_when_the_chirp_passes(table_1):
    run = np.zeros(10_000, dtype=recording_dtype(CHANNELS))
    run["x"] = np.arange(10_000)
    empty = np.zeros(1)
    chirp_run = ChirpRun(
        setup=Setup(parameters=table_1),
        chirp=Chirp(amplitude=1.0, start_frequency=100.0, end_frequency=20.0, duration=1.0),
        recording=run,
        estimate=ResponseEstimate(
            frequency=empty, response=empty.astype(np.complex128), coherence=empty
        ),
    )

    # 80 Hz lost in a second: 60 Hz after half of it, 5000 steps of 1e-4 s
    assert position_at(chirp_run, 60.0) == 5000.0
