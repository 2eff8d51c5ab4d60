"""Record against model, on the part of the record that the fit has not seen, as a figure."""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from hil_bench.figure_style import BLUE, GREEN, GREY, ORANGE, RED
from hil_bench.identification.identify import Identification
from hil_bench.units import BAR, MICROMETRE, MILLIMETRE

Values = npt.NDArray[np.float64]

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN = 4.0  # [s]


def draw_trial(found: Identification) -> "Figure":
    """Return the figure: position, its residual, both pressures, spool set-point."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import

    figure = Figure(figsize=(9.0, 9.0), layout="constrained")
    places = figure.subplots(4, 1, sharex=True, height_ratios=[1.5, 1.0, 1.3, 0.8])
    _draw_position(places[0], found)
    _draw_residual(places[1], found)
    _draw_pressures(places[2], found)
    _draw_setpoint(places[3], found)
    first = found.record.times[found.trial.run_rows[0]]
    last = found.record.times[found.trial.run_rows[-1]]
    places[3].set_xlim(first, min(last, first + _SHOWN))
    figure.align_ylabels()
    figure.suptitle(f"{found.record.axis}: record and model where nothing was fitted")
    return figure


def _draw_position(place: "Axes", found: Identification) -> None:
    record, trial = found.record, found.trial
    rows = trial.run_rows
    measured = MILLIMETRE.from_si(1.0) * record.measured[rows, 0]
    place.plot(record.times[rows], measured, color=GREY, linewidth=3.0, label="record")
    place.plot(
        record.times[rows],
        MILLIMETRE.from_si(1.0) * trial.run[:, 0],
        color=ORANGE,
        linestyle="--",
        linewidth=1.2,
        label="model, started once",
    )
    _draw_pieces(place, found, 0, MILLIMETRE.from_si(1.0), BLUE, "model, started at each dot")
    place.plot(
        record.times[trial.rows[:, 0]],
        MILLIMETRE.from_si(1.0) * trial.model[:, 0, 0],
        color=BLUE,
        linestyle="",
        marker="o",
        markersize=3.0,
    )
    place.set_ylabel("Position [mm]")
    place.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, ncols=3)


def _draw_residual(place: "Axes", found: Identification) -> None:
    record, trial = found.record, found.trial
    deviation = trial.model[:, :, 0] - record.measured[trial.rows, 0]
    limit = 3.0 * MICROMETRE.from_si(record.noise[0])
    place.axhspan(-limit, limit, color=GREY, alpha=0.25, linewidth=0.0, label="3 times the noise")
    place.plot(
        _broken(record.times[trial.rows]),
        _broken(MICROMETRE.from_si(1.0) * deviation),
        color=RED,
        linewidth=0.7,
        label="model started at each dot, less record",
    )
    place.set_ylabel(f"Position [{MICROMETRE.symbol}]")
    place.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, ncols=2)


def _draw_pressures(place: "Axes", found: Identification) -> None:
    record, rows = found.record, found.trial.run_rows
    for signal, colour, name in ((1, ORANGE, "A"), (2, GREEN, "B")):
        values = BAR.from_si(1.0) * record.measured[rows, signal]
        place.plot(record.times[rows], values, color=GREY, linewidth=2.4)
        label = f"model, $P_{name}$"
        _draw_pieces(place, found, signal, BAR.from_si(1.0), colour, label)
    place.plot([], [], color=GREY, linewidth=2.4, label="record")
    place.set_ylabel("Pressure [bar]")
    place.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, ncols=3)


def _draw_setpoint(place: "Axes", found: Identification) -> None:
    record, rows = found.record, found.trial.run_rows
    setpoints = MILLIMETRE.from_si(1.0) * record.setpoints[rows]
    place.plot(record.times[rows], setpoints, color=BLUE, linewidth=1.2)
    place.set_ylabel("Set-point [mm]")
    place.set_xlabel("Time [s]")
    place.margins(x=0.0)


def _draw_pieces(
    place: "Axes", found: Identification, signal: int, factor: float, colour: str, label: str
) -> None:
    trial = found.trial
    place.plot(
        _broken(found.record.times[trial.rows]),
        _broken(factor * trial.model[:, :, signal]),
        color=colour,
        linewidth=1.2,
        label=label,
    )


def _broken(values: Values) -> Values:
    """Return pieces as one line with gaps between them."""
    gaps = np.full((len(values), 1), np.nan)
    return np.asarray(np.hstack([values, gaps]).reshape(-1))
