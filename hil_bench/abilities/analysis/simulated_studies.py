"""The analyses that simulate both models, as studies."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hil_bench.abilities.analysis.figures import (
    ResponseCurve,
    TrajectoryPair,
    draw_responses,
    draw_trajectories,
)
from hil_bench.abilities.analysis.frequency_response import (
    Chirp,
    ChirpRun,
    measure_frequency_response,
)
from hil_bench.abilities.analysis.simulation import (
    Setup,
    state_trajectory,
    without_input_nonlinearities,
)
from hil_bench.abilities.analysis.study import VELOCITY_PER_OPENING, Fact, Study, response_table
from hil_bench.figure_style import BLUE, RED
from hil_bench.outside.recording.channels import Recording
from hil_bench.plants.hydraulic_cylinder.model import Model

_COLOURS = {Model.FULL_ORDER: BLUE, Model.REDUCED: RED}
_STYLES = ("-", "--", ":", "-.")


def measured_responses_study(
    runs: Sequence[ChirpRun], *, name: str = "frequency-response-measured"
) -> Study:
    """Return measured responses beside one another."""
    amplitudes = list(dict.fromkeys(run.chirp.amplitude for run in runs))
    curves, facts = [], []
    for run in runs:
        label = f"{run.setup.model}, {run.chirp.amplitude * 1e3:g} mm"
        estimate = run.estimate
        frequency, gain = estimate.peak(20.0, 200.0)
        curves.append(
            ResponseCurve(
                label,
                estimate.frequency,
                estimate.response,
                _COLOURS[run.setup.model],
                _STYLES[amplitudes.index(run.chirp.amplitude) % len(_STYLES)],
                estimate.coherence,
            )
        )
        facts += [
            Fact(f"{label}: peak, at", frequency, "Hz"),
            Fact(f"{label}: peak, gain", gain, "dB of (m/s)/m"),
            Fact(f"{label}: gain at 2 Hz", estimate.gain_at(2.0), "dB of (m/s)/m"),
            Fact(f"{label}: largest position", float(np.abs(run.recording["x"]).max()), "m"),
        ]
    return Study(
        title="Frequency responses measured with a chirp",
        facts=facts,
        tables={name: response_table(curves)},
        figures={
            name: lambda: draw_responses(
                curves, unit=VELOCITY_PER_OPENING, title="Set-point to velocity, measured (H1)"
            )
        },
    )


def measure_both_models(
    setup: Setup, chirps: Sequence[Chirp], *, with_valve: bool, smoothing: float
) -> list[ChirpRun]:
    """Return the measured responses of the full-order and the reduced model to each chirp."""

    def given(chirp: Chirp) -> Setup:
        return setup if with_valve else without_input_nonlinearities(setup, chirp.amplitude)

    return [
        measure_frequency_response(replace(given(chirp), model=model), chirp, smoothing=smoothing)
        for model in Model
        for chirp in chirps
    ]


def trajectories_study(pairs: Sequence[TrajectoryPair], *, name: str = "trajectories") -> Study:
    """Return velocities and phase portraits of both models beside one another."""
    facts, tables = [], {}
    for number, pair in enumerate(pairs, start=1):
        for model, run in ((Model.FULL_ORDER, pair.full_order), (Model.REDUCED, pair.reduced)):
            label = f"{pair.label}, {model}"
            facts += [
                Fact(f"{label}: least velocity", float(run["v"].min()), "m/s"),
                Fact(f"{label}: largest velocity", float(run["v"].max()), "m/s"),
                Fact(f"{label}: mean load pressure", float(run["P_L"].mean()), "Pa"),
                Fact(f"{label}: largest position", float(np.abs(run["x"]).max()), "m"),
            ]
            tables[f"{name}-{number}-{model}"] = run
    return Study(
        title="State trajectories",
        facts=facts,
        tables=tables,
        figures={
            name: lambda: draw_trajectories(
                pairs, title="Velocity and phase portrait under a sinusoidal set-point"
            )
        },
    )


def simulate_both_models(
    setup: Setup, amplitudes: Sequence[float], *, frequency: float = 0.1, duration: float = 10.0
) -> list[TrajectoryPair]:
    """Return runs of both models under sines of several amplitudes [m]."""

    def run(model: Model, amplitude: float) -> Recording:
        return state_trajectory(
            replace(setup, model=model), amplitude=amplitude, frequency=frequency, duration=duration
        )

    return [
        TrajectoryPair(
            f"u = {amplitude * 1e3:g} mm sin(2π · {frequency:g} Hz · t)",
            run(Model.FULL_ORDER, amplitude),
            run(Model.REDUCED, amplitude),
        )
        for amplitude in amplitudes
    ]
