"""Runs of both models, and sines on them."""

import math

import numpy as np
import pytest

from hil_bench.abilities.analysis.simulation import (
    CHANNELS,
    Model,
    Setup,
    simulate,
    state_trajectory,
    without_input_nonlinearities,
)
from hil_bench.abilities.analysis.steady_motion import NyquistError
from hil_bench.errors import ParameterError
from hil_bench.outside.recording.channels import recording_channels
from hil_bench.plants.hydraulic_cylinder.model import (
    FullOrderPlant,
    PlantInput,
    PlantOptions,
    Solver,
)


def test_a_row_holds_what_the_plant_shows_after_its_step(table_1):
    setpoints = np.array([5e-4, 1e-3, -2e-4, 7e-4, 7e-4])
    run = simulate(Setup(parameters=table_1), setpoints, every=2)

    plant = FullOrderPlant(
        table_1, options=PlantOptions.paper(), solver=Solver.FORWARD_EULER, dt=1e-4
    )
    seen = [plant.step(PlantInput(u)) for u in setpoints.tolist()]
    assert recording_channels(run) == CHANNELS
    assert run["time"] == pytest.approx([2e-4, 4e-4])
    assert run["u"].tolist() == [1e-3, 7e-4]
    for row, output in zip(run, (seen[1], seen[3]), strict=True):
        assert row["x"] == output.x
        assert row["v"] == output.v
        assert row["P_L"] == output.P_A - output.P_B
        assert row["z"] == output.z


@pytest.mark.parametrize("model", Model)
def test_without_input_nonlinearities_a_small_opening_moves_the_piston(table_1, model):
    setup = Setup(
        parameters=table_1,
        model=model,
        options=PlantOptions(alpha_negative=5e-4, beta_negative=4e-4),
    )
    small, large = np.full(500, -2e-4), np.full(500, -2e-3)

    assert not simulate(setup, small)["z"].any()
    free = without_input_nonlinearities(setup, 2e-3)
    assert simulate(free, small)["z"][-1] == pytest.approx(-2e-4, rel=1e-3)
    assert simulate(free, large)["z"][-1] == pytest.approx(-2e-3, rel=1e-3)


@pytest.mark.parametrize("model", Model)
def test_a_sine_has_its_amplitude_frequency_and_phase(table_1, model):
    run = state_trajectory(
        Setup(parameters=table_1, model=model), amplitude=8e-4, frequency=5.0, duration=0.4
    )

    # A row belongs to the end of its step, the set-point to the beginning.
    expected = 8e-4 * np.sin(2.0 * math.pi * 5.0 * (run["time"] - 1e-4))
    assert run["u"] == pytest.approx(expected, abs=1e-12)
    assert len(run) == 800
    assert run["v"].max() > 0.05


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"frequency": 5000.0}, NyquistError, "below the Nyquist frequency of 5000 Hz"),
        ({"frequency": 0.0}, ParameterError, "frequency = 0 Hz: must be greater than 0"),
        ({"amplitude": math.nan}, ParameterError, "amplitude = nan m: must be finite"),
        ({"duration": -1.0}, ParameterError, "duration = -1 s: must be greater than 0"),
        ({"duration": 1e9}, ParameterError, "1 to 20000000 are right"),
        ({"duration": 1e-5}, ParameterError, "0 steps of 0.0001 s"),
    ],
)
def test_a_senseless_sine_is_refused(table_1, given, error, message):
    with pytest.raises(error, match=message):
        state_trajectory(Setup(parameters=table_1), **{"amplitude": 1e-3, **given})
