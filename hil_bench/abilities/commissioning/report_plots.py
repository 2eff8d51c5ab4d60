"""The pictures of a commissioning's report: a step's samples, and its characteristics."""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from hil_bench.abilities.commissioning.measures import Curve, StepResult
from hil_bench.figure_style import BLUE, GREEN, GREY, ORANGE, RED
from hil_bench.outside.recording.channels import Recording
from hil_bench.outside.recording.plot import save_figure
from hil_bench.plants.hydraulic_cylinder.quantities import P_A, P_B
from hil_bench.shown_units import display_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class _Panel(NamedTuple):
    label: str
    symbol: str  # of the SI unit
    lines: tuple[tuple[str, str, str, str], ...]  # channel, label, colour, style


_PANELS = (
    _Panel("Position", "m", (("position", "", BLUE, "-"),)),
    _Panel("Speed", "m/s", (("speed", "", GREEN, "-"),)),
    _Panel("Pressure", "Pa", ((P_A, "$P_A$", ORANGE, "-"), (P_B, "$P_B$", GREEN, "-"))),
    _Panel(
        "Spool",
        "-",
        (
            ("spool_setpoint", "set-point", GREY, "--"),
            ("spool_position", "actual", BLUE, "-"),
        ),
    ),
)


def plot_step(result: StepResult, path: Path) -> None:
    """Write the samples of a step, and beside them its characteristics."""
    save_figure(lambda: _draw(result), path)


def _draw(result: StepResult) -> "Figure":
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import

    figure = Figure(figsize=(11.0 if result.curves else 7.0, 6.4), layout="constrained")
    left, *right = figure.subfigures(1, 2 if result.curves else 1, squeeze=False)[0]
    if result.trace is not None:
        _draw_trace(left.subplots(len(_PANELS), 1, sharex=True), result.trace)
    left.align_ylabels()
    for side in right:
        places = side.subplots(len(result.curves), 1, squeeze=False)[:, 0]
        for place, curve in zip(places, result.curves, strict=True):
            _draw_curve(place, curve)
    return figure


def _draw_trace(places: "list[Axes]", trace: Recording) -> None:
    for place, panel in zip(places, _PANELS, strict=True):
        unit = display_unit(panel.symbol)
        for channel, label, colour, style in panel.lines:
            place.plot(
                trace["time"],
                trace[channel] / unit.factor,
                color=colour,
                label=label,
                linestyle=style,
                linewidth=2.2 if style == "--" else 1.1,
                zorder=1.5 if style == "--" else 2.0,
            )
        place.set_ylabel(f"{panel.label} [{unit.symbol}]")
        place.margins(x=0.01)
        if len(panel.lines) > 1:
            place.legend(loc="lower right", bbox_to_anchor=(1.0, 0.94), ncols=2, fontsize="small")
    places[-1].set_xlabel("Time [s]")


def _draw_curve(place: "Axes", curve: Curve) -> None:
    place.plot(curve.x, curve.y, color=BLUE, linewidth=0.9, label="measured")
    if curve.fit_x.size:
        marker = "o" if curve.fit_x.size == 2 else ""
        place.plot(
            curve.fit_x,
            curve.fit_y,
            color=RED,
            linestyle="" if marker else "--",
            marker=marker,
            label="found" if marker else "fitted",
        )
        place.legend(loc="best", fontsize="small")
    place.set_title(curve.title, loc="left", fontsize="medium")
    place.set_xlabel(curve.x_label)
    place.set_ylabel(curve.y_label)
    if curve.is_frequency:
        place.set_xscale("log")
        place.grid(visible=True, which="minor", linewidth=0.3)
