"""The figures of the analyses, in the form in which the paper shows them.

Every function returns a figure; the caller sets the style and writes the file (`study`).
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hil_bench.analysis.frequency_response import decibel
from hil_bench.analysis.linearisation import Frequencies, Response
from hil_bench.analysis.root_locus import RootLocus
from hil_bench.analysis.static_curves import FlowPressureCurves
from hil_bench.figure_style import BLUE, GREY, RED
from hil_bench.recording.channels import Recording
from hil_bench.units import BAR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LITRE_PER_MINUTE = 1e-3 / 60.0
_ZOOM = 0.12  # s, some cycles of the oscillation of piston on oil


class ResponseCurve(NamedTuple):
    """One curve of a Bode plot.

    Attributes:
        label: in the legend.
        frequencies: [Hz].
        response: complex.
        colour: of the line.
        style: of the line, as matplotlib names it.
        coherence: 0 to 1; None where nothing was measured.
    """

    label: str
    frequencies: Frequencies
    response: Response
    colour: str = BLUE
    style: str = "-"
    coherence: Frequencies | None = None


class TrajectoryPair(NamedTuple):
    """Both models under the same set-point.

    Attributes:
        label: of the set-point.
        full_order: run of the full-order model.
        reduced: run of the reduced model.
    """

    label: str
    full_order: Recording
    reduced: Recording


def draw_root_locus(locus: RootLocus, *, title: str = "") -> "Figure":
    """Draw the closed loop's poles over the gain in the complex plane."""
    figure, place = _one_panel()
    centre = 1.15 * float(np.abs(locus.open_loop_poles.imag).max() or 1.0)
    place.axhline(0.0, color=GREY, linewidth=0.8)
    place.axvline(0.0, color=GREY, linewidth=0.8)
    for branch in locus.poles.T:
        place.plot(branch.real, branch.imag, color=BLUE, linewidth=1.6)
    poles = locus.open_loop_poles
    place.plot(
        poles.real, poles.imag, "x", color="#222222", markersize=8, label="open loop, $k = 0$"
    )
    if math.isfinite(locus.critical_gain):
        place.plot(
            [0.0, 0.0],
            [locus.critical_frequency, -locus.critical_frequency],
            "o",
            color="#222222",
            markerfacecolor="white",
            markersize=7,
            label=f"critical gain, $k$ = {locus.critical_gain:.3f} m²/s",
        )
    place.set_xlabel("Real part [rad/s]")
    place.set_ylabel("Imaginary part [rad/s]")
    place.set_ylim(-centre, centre)
    place.legend(loc="upper left")
    place.set_title(title, loc="left")
    return figure


def draw_flow_pressure(curves: FlowPressureCurves, *, title: str = "") -> "Figure":
    """Draw load flow over load pressure, a curve an orifice state."""
    from matplotlib import colormaps  # noqa: PLC0415 - an extra, and slow to import

    figure, place = _one_panel()
    largest = float(np.abs(curves.orifice_states).max()) or 1.0
    shades = colormaps["viridis"]
    pressure = curves.load_pressure / BAR.factor
    for state, flow in zip(curves.orifice_states, curves.flow, strict=True):
        values = flow / _LITRE_PER_MINUTE
        place.plot(pressure, values, color=shades(0.85 * (1.0 - abs(state) / largest)))
        number = f"{state * 1e3:.2g}"
        place.annotate(
            f"$z$ = {number} mm" if state == curves.orifice_states[-1] else number,
            (pressure[0], values[0]),
            xytext=(-5, 0),
            textcoords="offset points",
            ha="right",
            va="center",
            fontsize=9,
            color="#444444",
        )
    place.set_xlim(left=-0.13 * float(pressure[-1]), right=1.01 * float(pressure[-1]))
    place.set_xlabel("Load pressure $P_L$ [bar]")
    place.set_ylabel("Load flow $Q_L$ [l/min]")
    place.set_title(title, loc="left")
    return figure


def draw_responses(curves: Sequence[ResponseCurve], *, unit: str, title: str = "") -> "Figure":
    """Draw gain and phase over frequency, and the coherence where one was measured."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import
    from matplotlib.ticker import MultipleLocator  # noqa: PLC0415

    shares = [1.5, 1.0]
    if any(curve.coherence is not None for curve in curves):
        shares.append(0.7)
    figure = Figure(figsize=(9.0, 1.4 + 2.1 * sum(shares)), layout="constrained")
    panels = figure.subplots(len(shares), 1, sharex=True, height_ratios=shares)
    for curve in curves:
        line = {"color": curve.colour, "linestyle": curve.style, "linewidth": 1.5}
        phase = np.rad2deg(np.unwrap(np.angle(curve.response)))
        phase -= 360.0 * round(float(phase[0]) / 360.0)
        panels[0].semilogx(curve.frequencies, decibel(curve.response), label=curve.label, **line)
        panels[1].semilogx(curve.frequencies, phase, **line)
        if curve.coherence is not None:
            panels[2].semilogx(curve.frequencies, curve.coherence, **line)
            panels[2].set_ylabel("Coherence [-]")
            panels[2].set_ylim(0.0, 1.05)
    panels[0].set_ylabel(f"Gain [dB of {unit}]")
    panels[1].set_ylabel("Phase [°]")
    panels[1].yaxis.set_major_locator(MultipleLocator(90.0))
    panels[-1].set_xlabel("Frequency [Hz]")
    panels[-1].xaxis.set_major_formatter("{x:g}")
    panels[0].set_xlim(curves[0].frequencies[0], curves[0].frequencies[-1])
    panels[0].legend(loc="lower left")
    panels[0].set_title(title, loc="left")
    figure.align_ylabels()
    return figure


def draw_trajectories(pairs: Sequence[TrajectoryPair], *, title: str = "") -> "Figure":
    """Draw velocity over time beside the phase portrait, a row a set-point."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import

    figure = Figure(figsize=(12.0, 1.0 + 3.6 * len(pairs)), layout="constrained")
    grid = figure.subplots(len(pairs), 2, squeeze=False, width_ratios=[1.25, 1.0])
    for (over_time, portrait), pair in zip(grid, pairs, strict=True):
        _draw_pair(over_time, portrait, pair)
    grid[-1][0].set_xlabel("Time [s]")
    grid[-1][1].set_xlabel("Load pressure $P_L$ [bar]")
    figure.suptitle(title)
    figure.align_ylabels()
    return figure


def _draw_pair(over_time: "Axes", portrait: "Axes", pair: TrajectoryPair) -> None:
    detail = over_time.inset_axes((0.08, 0.1, 0.3, 0.34))
    steepest = int(np.argmax(np.abs(np.diff(pair.full_order["v"]))))
    middle = float(pair.full_order["time"][steepest])
    for run, label, colour in (
        (pair.full_order, "full-order", BLUE),
        (pair.reduced, "reduced", RED),
    ):
        near = np.abs(run["time"] - middle) < 0.5 * _ZOOM
        over_time.plot(run["time"], run["v"] * 1e3, color=colour, label=label, linewidth=1.1)
        detail.plot(run["time"][near], run["v"][near] * 1e3, color=colour, linewidth=1.1)
        portrait.plot(run["P_L"] / BAR.factor, run["v"] * 1e3, color=colour, linewidth=0.9)
    detail.margins(x=0.0)
    detail.locator_params(nbins=3)
    detail.tick_params(labelsize=8)
    over_time.margins(x=0.01)
    over_time.set_title(pair.label, loc="left")
    over_time.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.0)
    over_time.set_ylabel("Velocity [mm/s]")
    portrait.set_ylabel("Velocity [mm/s]")


def _one_panel() -> "tuple[Figure, Axes]":
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import

    figure = Figure(figsize=(7.5, 5.5), layout="constrained")
    return figure, figure.subplots()
