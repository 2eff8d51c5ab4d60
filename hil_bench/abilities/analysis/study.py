"""Results of an analysis: facts to read, tables as CSV, figures as PNG and SVG.

Nothing in the files depends on the time or the place of the run: the same input gives the same
bytes.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.analysis.figures import (
    ResponseCurve,
    TrajectoryPair,
    draw_responses,
    draw_trajectories,
)
from hil_bench.abilities.analysis.frequency_response import (
    Chirp,
    ChirpRun,
    decibel,
    measure_frequency_response,
)
from hil_bench.abilities.analysis.simulation import (
    Setup,
    state_trajectory,
    without_input_nonlinearities,
)
from hil_bench.abilities.common.figure_style import BLUE, RED, write_figure
from hil_bench.outside.recording.block_file import RecordingFile
from hil_bench.outside.recording.channels import Channel, Recording, recording_dtype
from hil_bench.plants.hydraulic_cylinder.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Fact(NamedTuple):
    """One number that an analysis found.

    Attributes:
        name: of the quantity.
        value: in that unit.
        unit: its symbol; ``-`` for a pure number.
    """

    name: str
    value: float | complex
    unit: str

    @property
    def text(self) -> str:
        """The value as people read it."""
        if isinstance(self.value, complex) and self.value.imag:
            sign = "-" if self.value.imag < 0.0 else "+"
            return f"{self.value.real:.6g} {sign} {abs(self.value.imag):.6g}j"
        return f"{self.value.real:.6g}"

    @property
    def plain(self) -> float | list[float] | None:
        """The value as JSON has it: complex as real and imaginary part, infinite as null."""
        if isinstance(self.value, complex):
            return [self.value.real, self.value.imag]
        return float(self.value) if math.isfinite(self.value) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """The results of one analysis.

    Attributes:
        title: in a few words.
        facts: the numbers.
        tables: by the name of their file; structured arrays with the units as metadata.
        figures: by the name of their file; each draws itself.
    """

    title: str
    facts: Sequence[Fact]
    tables: Mapping[str, Recording]
    figures: Mapping[str, Callable[[], "Figure"]]


def make_table(columns: Mapping[Channel, npt.ArrayLike]) -> Recording:
    """Return columns of one length as a structured array that knows their units."""
    arrays = {channel.name: np.asarray(values) for channel, values in columns.items()}
    table = np.empty(len(next(iter(arrays.values()))), dtype=recording_dtype([*columns]))
    for name, values in arrays.items():
        table[name] = values
    return table


def write_study(study: Study, directory: Path) -> list[Path]:
    """Write tables as CSV and figures as PNG and SVG into a directory; return the files."""
    files = []
    for name, table in study.tables.items():
        path = directory / f"{name}.csv"
        with RecordingFile(path) as file:
            file.write(table)
        files.append(path)
    for name, draw in study.figures.items():
        files += write_figure(draw, directory / name)
    return files


# Frequency responses as a table.

VELOCITY_PER_OPENING = "(m/s)/m"
"""Unit of the gain from spool or orifice to piston velocity."""


def response_table(curves: Sequence[ResponseCurve]) -> Recording:
    """Return gain [dB], phase and coherence of curves that share their frequencies."""
    columns = {Channel("frequency", "Hz"): curves[0].frequencies}
    for curve in curves:
        label = curve.label.replace("$", "").replace("\\,", " ").replace("\\", "")
        columns[Channel(f"{label}: gain", "dB")] = decibel(curve.response)
        columns[Channel(f"{label}: phase", "deg")] = np.angle(curve.response, deg=True)
        if curve.coherence is not None:
            columns[Channel(f"{label}: coherence", "-")] = curve.coherence
    return make_table(columns)


# The analyses that simulate both models, as studies.


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
