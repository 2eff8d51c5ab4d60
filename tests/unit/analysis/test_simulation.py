"""Runs of both models, and sines on them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hil_bench.abilities.analysis.simulation import (
    CHANNELS,
    Model,
    Setup,
    simulate,
    simulate_batch,
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
    SpringLoad,
    balanced_state,
)
from hil_bench.plants.hydraulic_cylinder.model.batch import LANES


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


# Runs of many plants at once.


def varied_setups(parameters, count):
    """Return set-ups with other parameters, options and starts each, reproducibly."""
    source = np.random.default_rng(1)

    def vary(name):
        return float(getattr(parameters, name) * source.uniform(0.8, 1.2))

    return [
        Setup(
            parameters=replace(
                parameters, **{name: vary(name) for name in ("E", "m", "P_S", "xi")}
            ),
            options=replace(
                PlantOptions.bench(),
                signed_root=bool(number % 2),
                cavitation_floor=None if number % 3 else -1e5,
                alpha_negative=8e-4 if number % 5 == 0 else None,
            ),
            solver=Solver.LINEARLY_IMPLICIT_MIDPOINT,
            state=balanced_state(parameters, x=float(source.uniform(-0.19, 0.19))),
        )
        for number in range(count)
    ]


def manoeuvre(runs, steps):
    """Return set-points that jump every 50 steps, within both directions' saturation."""
    jumps = np.random.default_rng(2).uniform(-2e-3, 2e-3, (runs, steps // 50))
    return jumps.repeat(50, axis=1)


def test_each_run_of_a_batch_has_the_bits_of_a_single_one(table_1):
    """Two full blocks and a part of one, into stops, cavitation and reversed flow."""
    setups = varied_setups(table_1, 2 * LANES + 3)
    setpoints = manoeuvre(len(setups), 4000)

    batch = simulate_batch(setups, setpoints, every=7)

    assert batch.shape == (len(setups), 4000 // 7)
    assert recording_channels(batch) == CHANNELS
    for setup, setpoint, run in zip(setups, setpoints, batch, strict=True):
        single = simulate(setup, setpoint, every=7)
        for name in single.dtype.names or ():
            assert run[name].tolist() == single[name].tolist(), name


@pytest.mark.long
def test_what_fits_no_block_runs_in_its_place(table_1):
    plain = varied_setups(table_1, 3)
    extended = replace(
        plain[0], options=replace(PlantOptions.bench(), loads=(SpringLoad(1e5, 0.0),))
    )
    setups = [
        plain[0],
        replace(plain[1], model=Model.REDUCED, state=None, delay=1e-3),
        extended,
        replace(plain[1], solver=Solver.RUNGE_KUTTA, dt=5e-5),
        plain[2],
        replace(plain[2], dt=5e-5),
    ]
    setpoints = manoeuvre(1, 1000)[0]

    batch = simulate_batch(setups, setpoints, every=10, threads=2)

    for setup, run in zip(setups, batch, strict=True):
        single = simulate(setup, setpoints, every=10)
        assert run["x"].tolist() == single["x"].tolist()
        assert run["time"].tolist() == single["time"].tolist()


def test_set_points_beyond_the_limit_act_as_the_limit(table_1):
    setup = varied_setups(table_1, 1)[0]
    setpoints = np.full(200, 1e6)
    batch = simulate_batch([setup], setpoints)
    assert batch[0]["x"].tolist() == simulate(setup, setpoints)["x"].tolist()


@pytest.mark.parametrize(
    ("setpoints", "every", "message"),
    [
        (np.zeros((2, 10)), 1, r"setpoints of shape \(2, 10\) for 3 set-ups: .* \(3, steps\)"),
        (np.zeros((3, 1, 10)), 1, r"setpoints of shape \(3, 1, 10\)"),
        (np.array([0.0, np.nan]), 1, "setpoints: NaN or infinite"),
        (np.zeros(10), 0, "every = 0: must be 1 or greater"),
    ],
)
def test_set_points_that_fit_nothing_are_refused(table_1, setpoints, every, message):
    with pytest.raises(ParameterError, match=message):
        simulate_batch(varied_setups(table_1, 3), setpoints, every=every)


def test_a_set_up_that_cannot_be_is_named(table_1):
    setups = varied_setups(table_1, 3)
    setups[1] = replace(setups[1], state=balanced_state(table_1, x=0.3))
    with pytest.raises(ParameterError, match=r"set-up 1: x = 0.3 m: must lie between the end stop"):
        simulate_batch(setups, np.zeros(10))


def test_no_bar_is_drawn_where_nobody_looks(table_1, capfd):
    simulate_batch(varied_setups(table_1, 2), np.zeros(10), progress=True)
    assert capfd.readouterr().err == ""
