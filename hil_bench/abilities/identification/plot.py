"""Record and model stroke by stroke, and what is left of each signal, as a figure."""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.common.figure_style import BLUE, GREEN, GREY, ORANGE, RED
from hil_bench.abilities.identification.identify import Identification
from hil_bench.abilities.identification.strokes import Stroke
from hil_bench.units import BAR, MILLIMETRE

Values = npt.NDArray[np.float64]

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 6
_LABELS = ("Position [mm]", "Pressure [bar]", "Position,\nmodel less record [mm]", "Set-point [%]")


def draw_strokes(found: Identification) -> "Figure":
    """Return the figure: a column a stroke, at most six, spread over directions and openings."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import

    bench = found.bench
    strokes = _choose(bench.course.strokes)
    shown = bench.run(bench.machine(found.fit.values), bench.cuts())
    models = dict(zip((one.number for one in bench.course.strokes), shown, strict=True))
    figure = Figure(figsize=(2.2 * max(len(strokes), 3) + 1.2, 8.6), layout="constrained")
    shape = len(_LABELS), len(strokes)
    ratios = [1.4, 1.4, 1.0, 0.7]
    grid = figure.subplots(*shape, sharex="col", sharey="row", squeeze=False, height_ratios=ratios)
    for places, stroke in zip(grid.T, strokes, strict=True):
        _draw(places, found, stroke, models[stroke.number])
        way = "out" if stroke.is_forth else "in"
        places[0].set_title(f"stroke {stroke.number}, {way}", fontsize=10)
        places[-1].set_xlabel("Time [s]")
    for places, label in zip(grid, _LABELS, strict=True):
        places[0].set_ylabel(label)
    handles, labels = grid[1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3)
    figure.align_ylabels()
    figure.suptitle(f"{found.record.axis}: record and model", x=0.01, ha="left")
    return figure


def _choose(strokes: tuple[Stroke, ...]) -> list[Stroke]:
    """Return strokes of each direction and of small to large openings."""
    order = sorted(strokes, key=lambda one: (one.is_forth, one.opening))
    places = np.unique(np.linspace(0, len(order) - 1, min(_COLUMNS, len(order))).astype(int))
    return sorted((order[place] for place in places.tolist()), key=lambda one: one.number)


def _draw(places: "list[Axes]", found: Identification, stroke: Stroke, model: Values) -> None:
    bench, record = found.bench, found.record
    measured = np.where(bench.counts(stroke), bench.measured(stroke), np.nan)
    times = np.arange(1, len(measured) + 1) * record.interval
    position, pressure, off, command = places
    scale = np.array([MILLIMETRE.from_si(1.0), BAR.from_si(1.0), BAR.from_si(1.0)])
    measured, model = scale * measured, scale * model
    position.plot(times, measured[:, 0], color=GREY, linewidth=3.2)
    position.plot(times, model[:, 0], color=BLUE, linewidth=1.2)
    pressure.plot(times, measured[:, 1:], color=GREY, linewidth=2.6, label=["record", "_"])
    for signal, colour, name in ((1, ORANGE, "P_A"), (2, GREEN, "P_B")):
        pressure.plot(times, model[:, signal], color=colour, linewidth=1.1, label=f"model, {name}")
    off.axhline(0.0, color=GREY, linewidth=0.8)
    off.plot(times, (model - measured)[:, 0], color=RED, linewidth=1.0)
    rows = slice(stroke.rows.start + 1, stroke.rows.stop)
    command.plot(times, 100.0 * record.setpoints[rows] / record.full_opening, color=BLUE, lw=1.2)
    command.margins(x=0.0)
