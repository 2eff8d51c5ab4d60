"""Record against model, on the parts of the record that the fit has not seen, as a figure."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.identify import Identification
from hil_bench.abilities.identification.trial import Run
from hil_bench.figure_style import BLUE, GREEN, GREY, ORANGE, RED
from hil_bench.units import BAR, MICROMETRE, MILLIMETRE, Unit

Values = npt.NDArray[np.float64]

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN = 4.0  # of a part [s]
_PARTS = 3
_NARROWEST = 0.4  # column, of the widest


class _Column(NamedTuple):
    """One part of the record, and its pieces."""

    found: Identification
    run: Run
    pieces: npt.NDArray[np.int64]  # their numbers

    @property
    def rows(self) -> npt.NDArray[np.int64]:
        """The rows of its pieces."""
        return np.asarray(self.found.trial.rows[self.pieces])

    def times(self, rows: npt.NDArray[np.int64]) -> Values:
        """Return the times of rows [s]."""
        return np.asarray(self.found.record.times[rows])

    def measured(self, rows: npt.NDArray[np.int64], signal: int) -> Values:
        """Return the record's values of a signal in rows."""
        return np.asarray(self.found.record.measured[rows, signal])

    def model(self, signal: int) -> Values:
        """Return the model's values of a signal in the pieces."""
        return np.asarray(self.found.trial.model[self.pieces, :, signal])


def draw_trial(found: Identification) -> "Figure":
    """Return the figure: position, its residual, pressures, set-point; a part a column.

    At most three parts are shown, those in which the piston goes farthest.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import

    columns = _columns(found)
    spans = [len(column.run.rows) for column in columns]
    figure = Figure(figsize=(9.0, 9.0), layout="constrained")
    grid = figure.subplots(
        4,
        len(columns),
        sharex="col",
        sharey="row",
        squeeze=False,
        height_ratios=[1.5, 1.0, 1.3, 0.8],
        width_ratios=[max(span, _NARROWEST * max(spans)) for span in spans],
    )
    for places, column in zip(grid.T, columns, strict=True):
        for place, draw in zip(places, _PANELS, strict=True):
            draw(place, column)
        places[-1].set_xlabel("Time [s]")
        places[-1].margins(x=0.0)
    for places, label in zip(grid, _LABELS, strict=True):
        places[0].set_ylabel(label)
    for places, count in zip(grid[:3], (3, 2, 3), strict=True):
        legend = places[0].legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.0, ncols=count
        )
        legend.set_in_layout(False)  # it may reach over the next column,
        places[0].set_title(" ")  # and has its height from here
    figure.align_ylabels()
    figure.suptitle(f"{found.record.axis}: record and model where nothing was fitted")
    return figure


def _columns(found: Identification) -> list[_Column]:
    """Return the parts to show, in the order of time."""
    position = found.record.measured[:, 0]
    farthest = sorted(
        found.trial.runs, key=lambda run: float(np.abs(np.diff(position[run.rows])).sum())
    )
    columns = []
    for run in sorted(farthest[-_PARTS:], key=lambda run: int(run.rows[0])):
        shown = run.rows[: round(_SHOWN / found.record.interval)]
        ends = found.trial.rows[:, -1]
        pieces = np.flatnonzero((ends >= shown[0]) & (ends <= shown[-1]))
        columns.append(_Column(found, Run(shown, run.model[: len(shown)]), pieces))
    return columns


def _draw_position(place: "Axes", column: _Column) -> None:
    times, (rows, model) = column.times(column.run.rows), column.run
    _line(place, times, column.measured(rows, 0), MILLIMETRE, color=GREY, lw=3.0, label="record")
    label = "model, started once"
    _line(place, times, model[:, 0], MILLIMETRE, color=ORANGE, ls="--", lw=1.2, label=label)
    _draw_pieces(place, column, 0, MILLIMETRE, (BLUE, "model, started at each dot"))
    starts = column.times(column.rows[:, 0])
    _line(place, starts, column.model(0)[:, 0], MILLIMETRE, color=BLUE, ls="", marker="o", ms=3.0)


def _draw_residual(place: "Axes", column: _Column) -> None:
    deviation = column.model(0) - column.measured(column.rows, 0)
    limit = 3.0 * MICROMETRE.from_si(column.found.record.noise[0])
    place.axhspan(-limit, limit, color=GREY, alpha=0.25, linewidth=0.0, label="3 times the noise")
    label = "model started at each dot, less record"
    times = _broken(column.times(column.rows))
    _line(place, times, _broken(deviation), MICROMETRE, color=RED, lw=0.7, label=label)


def _draw_pressures(place: "Axes", column: _Column) -> None:
    rows = column.run.rows
    for signal, colour, label in ((1, ORANGE, "model, $P_A$"), (2, GREEN, "model, $P_B$")):
        values = column.measured(rows, signal)
        _line(place, column.times(rows), values, BAR, color=GREY, lw=2.4)
        _draw_pieces(place, column, signal, BAR, (colour, label))
    place.plot([], [], color=GREY, linewidth=2.4, label="record")


def _draw_setpoint(place: "Axes", column: _Column) -> None:
    rows = column.run.rows
    setpoints = column.found.record.setpoints[rows]
    _line(place, column.times(rows), setpoints, MILLIMETRE, color=BLUE, lw=1.2)


def _draw_pieces(
    place: "Axes", column: _Column, signal: int, unit: Unit, look: tuple[str, str]
) -> None:
    colour, label = look
    times, values = _broken(column.times(column.rows)), _broken(column.model(signal))
    _line(place, times, values, unit, color=colour, lw=1.2, label=label)


def _line(place: "Axes", times: Values, values: Values, unit: Unit, **look: object) -> None:
    place.plot(times, values / unit.factor, **look)  # type: ignore[arg-type]  # Line2D's own


def _broken(values: Values) -> Values:
    """Return pieces as one line with gaps between them."""
    gaps = np.full((len(values), 1), np.nan)
    return np.asarray(np.hstack([values, gaps]).reshape(-1))


_PANELS = (_draw_position, _draw_residual, _draw_pressures, _draw_setpoint)
_LABELS = (
    f"Position [{MILLIMETRE.symbol}]",
    f"Position [{MICROMETRE.symbol}]",
    f"Pressure [{BAR.symbol}]",
    f"Set-point [{MILLIMETRE.symbol}]",
)
