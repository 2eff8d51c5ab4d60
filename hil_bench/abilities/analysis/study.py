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

from hil_bench.abilities.analysis import linearisation
from hil_bench.abilities.analysis.figures import (
    ResponseCurve,
    TrajectoryPair,
    draw_flow_pressure,
    draw_responses,
    draw_root_locus,
    draw_trajectories,
)
from hil_bench.abilities.analysis.frequency_response import (
    Chirp,
    ChirpRun,
    decibel,
    measure_frequency_response,
    root_locus,
)
from hil_bench.abilities.analysis.operating_point import flow_pressure_curves
from hil_bench.abilities.analysis.simulation import (
    Setup,
    state_trajectory,
    without_input_nonlinearities,
)
from hil_bench.abilities.analysis.steady_motion import OperatingPoint
from hil_bench.abilities.common.block_file import RecordingFile
from hil_bench.abilities.common.figure_style import BLUE, RED, write_figure
from hil_bench.outside.recording.channels import Channel, Recording, recording_dtype
from hil_bench.plants.hydraulic_cylinder.model import Model, PlantOptions, PlantParameters

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
        figures={name: lambda: draw_trajectories(pairs)},
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


# The analyses of the linear models and of the static valve, as studies.


def linearisation_study(
    parameters: PlantParameters, point: OperatingPoint, options: PlantOptions
) -> Study:
    """Return both models, linearised about one operating point of the full-order model."""
    full = linearisation.linearise_full(parameters, point, options)
    load_pressure = (point.pressure_a * parameters.A_A - point.pressure_b * parameters.A_B) / (
        parameters.mean_area
    )
    reduced = linearisation.linearise_with_valve(
        parameters, orifice_state=point.orifice_state, load_pressure=load_pressure
    )
    frequencies = np.geomspace(1.0, 600.0, 400)
    velocity = full.response(
        frequencies, linearisation.Input.SPOOL_SETPOINT, linearisation.Output.VELOCITY
    )
    curves = [
        ResponseCurve(
            "reduced, eq. (24), without spool", frequencies, reduced.response(frequencies), RED
        )
    ]
    if velocity.any():
        curves.insert(0, ResponseCurve("full-order, with spool", frequencies, velocity, BLUE))
    return Study(
        title="Linearisation about an operating point",
        facts=[*_reduced_facts(parameters, point, load_pressure, reduced), *_full_facts(full)],
        tables={"linearisation": response_table(curves)},
        figures={
            "linearisation": lambda: draw_responses(
                curves,
                unit=VELOCITY_PER_OPENING,
                title=f"Linearisation at {point.velocity * 1e3:.4g} mm/s",
            )
        },
    )


def _reduced_facts(
    parameters: PlantParameters,
    point: OperatingPoint,
    load_pressure: float,
    with_valve: linearisation.SecondOrderSystem,
) -> list[Fact]:
    plain = linearisation.linearise_reduced(parameters)
    facts = [
        Fact("reduced: eigenfrequency omega_c (19)", plain.eigenfrequency, "rad/s"),
        Fact("reduced: eigenfrequency omega_c (19)", plain.eigenfrequency / (2.0 * math.pi), "Hz"),
        Fact("reduced: damping ratio zeta (20)", plain.damping_ratio, "-"),
        Fact("reduced: pole of G (18)", plain.poles[0], "rad/s"),
        Fact("reduced: pole of G (18)", plain.poles[1], "rad/s"),
    ]
    for form in linearisation.CoefficientForm:
        flow = linearisation.linearise_orifice(
            parameters, orifice_state=point.orifice_state, load_pressure=load_pressure, form=form
        )
        facts += [
            Fact(f"reduced: flow gain C_q (21), {form}", flow.flow_gain, "m²/s"),
            Fact(
                f"reduced: flow-pressure coefficient C_qp (22), {form}",
                flow.flow_pressure_coefficient,
                "m³/(s Pa)",
            ),
        ]
    return [
        *facts,
        Fact("reduced with valve: eigenfrequency (24)", with_valve.eigenfrequency, "rad/s"),
        Fact("reduced with valve: damping ratio (24)", with_valve.damping_ratio, "-"),
    ]


def _full_facts(full: linearisation.FullLinearisation) -> list[Fact]:
    point, mode = full.operating_point, full.hydraulic_mode
    facts = [
        Fact("full-order: position", point.position, "m"),
        Fact("full-order: velocity", point.velocity, "m/s"),
        Fact("full-order: spool position", point.spool_position, "m"),
        Fact("full-order: orifice state", point.orifice_state, "m"),
        Fact("full-order: pressure P_A", point.pressure_a, "Pa"),
        Fact("full-order: pressure P_B", point.pressure_b, "Pa"),
    ]
    facts += [Fact("full-order: pole", complex(pole), "rad/s") for pole in full.poles]
    zeros = full.zeros(linearisation.Input.SPOOL_SETPOINT, linearisation.Output.VELOCITY)
    facts += [Fact("full-order: zero, set-point to velocity", complex(z), "rad/s") for z in zeros]
    if mode is not None:
        facts += [
            Fact("full-order: eigenfrequency", float(mode[0]), "rad/s"),
            Fact("full-order: damping ratio", float(mode[1]), "-"),
        ]
    return facts


def root_locus_study(parameters: PlantParameters, *, name: str = "root-locus") -> Study:
    """Return the root locus of k G(s) / s, and how the spool moves its limit."""
    locus, with_spool = root_locus(parameters), root_locus(parameters, with_spool=True)
    columns = {Channel("k", "m²/s"): locus.gains}
    for number, branch in enumerate(locus.poles.T, start=1):
        columns[Channel(f"pole_{number}_real", "rad/s")] = branch.real
        columns[Channel(f"pole_{number}_imaginary", "rad/s")] = branch.imag
    return Study(
        title="Root locus of k G(s) / s",
        facts=[
            *(Fact("pole of the open loop", complex(p), "rad/s") for p in locus.open_loop_poles),
            Fact("critical gain", locus.critical_gain, "m²/s"),
            Fact("frequency at the critical gain", locus.critical_frequency, "rad/s"),
            Fact("critical gain with the spool's lag", with_spool.critical_gain, "m²/s"),
            Fact("frequency there", with_spool.critical_frequency, "rad/s"),
        ],
        tables={name: make_table(columns)},
        figures={name: lambda: draw_root_locus(locus)},
    )


def flow_pressure_study(parameters: PlantParameters, *, name: str = "flow-pressure") -> Study:
    """Return the static flow-pressure curves, eq. (14)."""
    curves = flow_pressure_curves(parameters)
    columns = {Channel("P_L", "Pa"): curves.load_pressure}
    for state, flow in zip(curves.orifice_states, curves.flow, strict=True):
        columns[Channel(f"Q_L at z = {state * 1e3:.3g} mm", "m³/s")] = flow
    return Study(
        title="Static flow-pressure curves",
        facts=[
            Fact("valve flow coefficient K", parameters.K, "m²/(s sqrt(Pa))"),
            Fact("orifice state, fully open", float(curves.orifice_states[-1]), "m"),
            Fact("load flow there, no load", float(curves.flow[-1, 0]), "m³/s"),
            Fact("load pressure without flow", float(curves.load_pressure[-1]), "Pa"),
        ],
        tables={name: make_table(columns)},
        figures={name: lambda: draw_flow_pressure(curves)},
    )


def operating_points_study(
    parameters: PlantParameters, *, name: str = "frequency-response-linear"
) -> Study:
    """Return eq. (24) at the paper's four points: 5 and 95 % of valve opening and supply."""
    frequencies = np.geomspace(1.0, 1000.0, 400)
    supply = parameters.P_S - parameters.P_T
    curves, facts = [], []
    for opening, style in ((0.05, "--"), (0.95, "-")):
        for pressure, colour in ((0.05, BLUE), (0.95, RED)):
            system = linearisation.linearise_with_valve(
                parameters,
                orifice_state=opening * parameters.alpha,
                load_pressure=pressure * supply,
            )
            label = f"z = {opening:g} alpha, P_L = {pressure:g} P_S"
            drawn = f"$z = {opening:g}\\,\\alpha$, $P_L = {pressure:g}\\,P_S$"
            curves.append(
                ResponseCurve(drawn, frequencies, system.response(frequencies), colour, style)
            )
            facts += [
                Fact(f"{label}: gain", float(decibel(np.array(system.gain + 0j))), "dB of (m/s)/m"),
                Fact(f"{label}: eigenfrequency", system.eigenfrequency, "rad/s"),
                Fact(f"{label}: damping ratio", system.damping_ratio, "-"),
            ]
    return Study(
        title="Linear frequency responses, eq. (24)",
        facts=facts,
        tables={name: response_table(curves)},
        figures={
            name: lambda: draw_responses(
                curves,
                unit=VELOCITY_PER_OPENING,
                title="Orifice state to velocity, linearised, eq. (24)",
            )
        },
    )
