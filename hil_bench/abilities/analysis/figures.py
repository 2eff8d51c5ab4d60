"""The figures of the analyses, in the form in which the paper shows them.

Every function returns a figure; the caller sets the style and writes the file (`study`).
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hil_bench.abilities.analysis.frequency_response import RootLocus, decibel
from hil_bench.abilities.analysis.linearisation import Frequencies, Response
from hil_bench.abilities.analysis.operating_point import FlowPressureCurves
from hil_bench.abilities.common.figure_style import BLUE, GREY, RED
from hil_bench.outside.recording.channels import Recording
from hil_bench.units import BAR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LITRE_PER_MINUTE = 1e-3 / 60.0
_ZOOM = 0.12  # s, some cycles of the oscillation of piston on oil
_DAMPING_RATIOS = (0.1, 0.2, 0.4, 0.6)
_COHERENT = 0.5  # where less of the output follows the input linearly, a response says little
_FAINT = {"alpha": 0.45, "linewidth": 0.8}


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


def draw_root_locus(locus: RootLocus) -> "Figure":
    """Draw the closed loop's poles over the gain in the complex plane."""
    figure, place = _one_panel()
    centre = 1.15 * float(np.abs(locus.open_loop_poles.imag).max() or 1.0)
    place.axhline(0.0, color=GREY, linewidth=0.8)
    place.axvline(0.0, color=GREY, linewidth=0.8)
    _draw_damping(place, centre)
    for branch in locus.poles.T:
        place.plot(branch.real, branch.imag, color=BLUE, linewidth=1.6)
    _draw_gains(place, locus)
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
    place.set_xlim(-0.9 * centre, 0.6 * centre)
    place.set_aspect("equal")
    place.plot([], [], "|", color=BLUE, markersize=7, label="gain $k$ [m²/s]")
    place.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0))
    place.set_title("Root locus of $k\\,G(s)\\,s^{-1}$", loc="left")
    return figure


def _draw_damping(place: "Axes", height: float) -> None:
    """Draw lines of constant damping ratio up to a height [rad/s]."""
    for ratio, share in zip(_DAMPING_RATIOS, (0.72, 0.55, 0.65, 0.8), strict=True):
        reach = -height * ratio / math.sqrt(1.0 - ratio * ratio)
        place.plot([reach, 0.0, reach], [height, 0.0, -height], ":", color=GREY, linewidth=0.9)
        place.annotate(
            f"$\\zeta$ = {ratio:g}",
            (share * reach, -share * height),
            fontsize=8,
            color="#666666",
            ha="center",
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
        )


def _draw_gains(place: "Axes", locus: RootLocus) -> None:
    """Mark round gains on the branches, with their values at the upper half-plane's."""
    from matplotlib.ticker import MaxNLocator  # noqa: PLC0415 - an extra, and slow to import

    for gain in MaxNLocator(nbins=3).tick_values(0.0, float(locus.gains[-1]))[1:]:
        if gain > locus.gains[-1]:
            continue
        for branch in locus.poles.T:
            real = float(np.interp(gain, locus.gains, branch.real))
            imaginary = float(np.interp(gain, locus.gains, branch.imag))
            place.plot([real], [imaginary], "|", color=BLUE, markersize=7)
            if imaginary >= 0.0:
                place.annotate(
                    f"{gain:.3g}",
                    (real, imaginary),
                    xytext=(0, 6),
                    textcoords="offset points",
                    fontsize=8,
                    color=BLUE,
                    ha="center",
                )


def draw_flow_pressure(curves: FlowPressureCurves) -> "Figure":
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
    place.set_title("Static load flow over load pressure", loc="left")
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
        gain = decibel(curve.response)
        if curve.coherence is not None:
            for panel, values in zip(panels, (gain, phase), strict=False):
                panel.semilogx(curve.frequencies, values, **line | _FAINT)
            is_vague = curve.coherence < _COHERENT
            gain, phase = (np.where(is_vague, np.nan, values) for values in (gain, phase))
        panels[0].semilogx(curve.frequencies, gain, label=curve.label, **line)
        panels[1].semilogx(curve.frequencies, phase, **line)
        if curve.coherence is not None:
            panels[2].semilogx(curve.frequencies, curve.coherence, **line)
            panels[2].set_ylabel("Coherence [-]")
            panels[2].set_ylim(0.0, 1.05)
            panels[2].axhline(_COHERENT, color=GREY, linewidth=0.8)
    panels[0].set_ylabel(f"Gain [dB of {unit}]")
    panels[1].set_ylabel("Phase [°]")
    panels[1].yaxis.set_major_locator(MultipleLocator(90.0))
    panels[-1].set_xlabel("Frequency [Hz]")
    panels[-1].xaxis.set_major_formatter("{x:g}")
    panels[0].set_xlim(curves[0].frequencies[0], curves[0].frequencies[-1])
    faint = "faint: coherence below 0.5" if len(panels) > 2 else None
    panels[0].legend(loc="lower left", title=faint, alignment="left")
    panels[0].set_title(title, loc="left")
    figure.align_ylabels()
    return figure


def draw_trajectories(pairs: Sequence[TrajectoryPair]) -> "Figure":
    """Draw velocity over time, a panel a model, beside the phase portrait of both."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import

    figure = Figure(figsize=(12.0, 1.0 + 4.4 * len(pairs)), layout="constrained")
    grid = figure.add_gridspec(2 * len(pairs), 2, width_ratios=[1.25, 1.0])
    for number, pair in enumerate(pairs):
        upper = figure.add_subplot(grid[2 * number, 0])
        lower = figure.add_subplot(grid[2 * number + 1, 0], sharex=upper, sharey=upper)
        portrait = figure.add_subplot(grid[2 * number : 2 * number + 2, 1])
        _draw_pair(upper, lower, portrait, pair)
    figure.suptitle("Velocity and phase portrait under a sinusoidal set-point")
    figure.align_ylabels()
    return figure


def _draw_pair(upper: "Axes", lower: "Axes", portrait: "Axes", pair: TrajectoryPair) -> None:
    steepest = int(np.argmax(np.abs(np.diff(pair.full_order["v"]))))
    middle = float(pair.full_order["time"][steepest])
    for place, run, label, colour in (
        (upper, pair.full_order, "full-order", BLUE),
        (lower, pair.reduced, "reduced", RED),
    ):
        place.plot(run["time"], run["v"] * 1e3, color=colour, label=label, linewidth=1.1)
        place.margins(x=0.01)
        place.set_ylabel("Velocity [mm/s]")
        near = np.abs(run["time"] - middle) < 0.5 * _ZOOM
        detail = place.inset_axes((0.08, 0.12, 0.3, 0.34))
        detail.plot(run["time"][near], run["v"][near] * 1e3, color=colour, linewidth=1.1)
        detail.margins(x=0.0)
        detail.locator_params(nbins=3)
        detail.tick_params(labelsize=8)
        portrait.plot(
            run["P_L"] / BAR.factor, run["v"] * 1e3, color=colour, label=label, linewidth=0.9
        )
    upper.tick_params(labelbottom=False)
    upper.set_title(pair.label, loc="left")
    lower.set_xlabel("Time [s]")
    portrait.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.0)
    portrait.set_xlabel("Load pressure $P_L$ [bar]")
    portrait.set_ylabel("Velocity [mm/s]")


def _one_panel() -> "tuple[Figure, Axes]":
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import

    figure = Figure(figsize=(7.5, 5.5), layout="constrained")
    return figure, figure.subplots()
