"""A recording as a figure: a panel a quantity, a column an axis, one time axis for all.

The panels are drawn from the channels ``AXIS.position_setpoint``, ``.position``, ``.P_A``,
``.P_B``, ``.spool_setpoint`` and ``.spool_position``; what a recording lacks is left out. Each
panel is in the display unit that belongs to its channels' SI unit.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.errors import ConfigError
from hil_bench.figure_style import BLUE, GREEN, GREY, ORANGE, RED, STYLE
from hil_bench.recording.channels import TIME, Recording, recording_channels
from hil_bench.units import BAR, MILLIMETRE, MILLIMETRE_PER_SECOND, PERCENT, Unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DISPLAY_UNITS = {"m": MILLIMETRE, "m/s": MILLIMETRE_PER_SECOND, "Pa": BAR, "-": PERCENT}
"""In which unit a figure shows a quantity, by the symbol of the SI unit."""


class _Curve(NamedTuple):
    quantity: str
    label: str
    colour: str
    minus: str = ""  # the quantity to subtract, where the curve is a difference
    is_setpoint: bool = False


class _Panel(NamedTuple):
    label: str
    curves: tuple[_Curve, ...]
    share: float  # of the figure's height


class _Line(NamedTuple):
    curve: _Curve
    values: npt.NDArray[np.float64]  # in the display unit
    unit: Unit


_PANELS = (
    _Panel(
        "Position",
        (
            _Curve("position_setpoint", "set-point", GREY, is_setpoint=True),
            _Curve("position", "actual", BLUE),
        ),
        share=1.5,
    ),
    _Panel(
        "Tracking error",
        (_Curve("position_setpoint", "", RED, minus="position"),),
        share=0.8,
    ),
    _Panel(
        "Pressure",
        (_Curve("P_A", "$P_A$", ORANGE), _Curve("P_B", "$P_B$", GREEN)),
        share=1.0,
    ),
    _Panel(
        "Spool",
        (
            _Curve("spool_setpoint", "set-point", GREY, is_setpoint=True),
            _Curve("spool_position", "actual", BLUE),
        ),
        share=1.0,
    ),
)


def plot_result(recording: Recording, path: Path, *, title: str = "") -> None:
    """Write a recording as a picture; the suffix of `path` is its format.

    Raises:
        ConfigError: the recording has nothing to draw.
    """
    axes = _axis_names(recording)
    if not axes:
        raise ConfigError(f"{path}: the recording has no axis to plot; record its channels")
    save_figure(lambda: _draw(recording, axes, title), path)


def save_figure(draw: Callable[[], "Figure"], path: Path) -> None:
    """Draw a figure in our style and write it; the suffix of `path` is its format.

    Raises:
        ConfigError: matplotlib is not installed, or the file cannot be written.
    """
    try:
        import matplotlib as mpl  # noqa: PLC0415 - an extra, and slow to import
    except ImportError:
        right = "install it with: pip install 'hil-bench[plot]'"
        raise ConfigError(f"{path}: a plot needs matplotlib; {right}") from None
    with mpl.rc_context(STYLE):
        figure = draw()
        try:
            figure.savefig(path, dpi=150)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise ConfigError(f"{path}: cannot be written: {reason}; give a .png file") from None


def has_axis(recording: Recording) -> bool:
    """Return whether a recording has what `plot_result` draws."""
    return bool(_axis_names(recording))


def _draw(recording: Recording, axes: list[str], title: str) -> "Figure":
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import

    panels = [panel for panel in _PANELS if any(_lines(recording, axis, panel) for axis in axes)]
    width = 9.0 if len(axes) == 1 else 6.5 * len(axes)
    height = 1.0 + 1.9 * sum(panel.share for panel in panels)
    figure = Figure(figsize=(width, height), layout="constrained")
    grid = figure.subplots(
        len(panels),
        len(axes),
        sharex=True,
        sharey="row",
        squeeze=False,
        height_ratios=[panel.share for panel in panels],
    )
    for column, axis in zip(grid.T, axes, strict=True):
        for place, panel in zip(column, panels, strict=True):
            _draw_panel(place, recording, axis, panel)
        column[0].set_title(axis if len(axes) > 1 else "", loc="left", fontweight="bold")
    figure.align_ylabels()
    figure.suptitle(title)
    return figure


def _draw_panel(place: "Axes", recording: Recording, axis: str, panel: _Panel) -> None:
    lines = _lines(recording, axis, panel)
    for curve, values, unit in lines:
        place.plot(
            recording[TIME.name],
            values,
            color=curve.colour,
            label=curve.label,
            linestyle="--" if curve.is_setpoint else "-",
            # Wider than the actual value, or good tracking would hide it.
            linewidth=2.6 if curve.is_setpoint else 1.3,
            zorder=1.5 if curve.is_setpoint else 2.0,
        )
        place.set_ylabel(f"{panel.label} [{unit.symbol}]")
    place.set_xlabel("Time [s]")
    place.label_outer()
    place.margins(x=0.01)
    if len(lines) > 1:
        place.legend(loc="lower right", bbox_to_anchor=(1.0, 0.96), ncols=2, borderaxespad=0.0)


def _lines(recording: Recording, axis: str, panel: _Panel) -> list[_Line]:
    """The lines of a panel for which the recording has the channels."""
    units = {channel.name: channel.unit for channel in recording_channels(recording)}
    lines = []
    for curve in panel.curves:
        names = [f"{axis}.{quantity}" for quantity in (curve.quantity, curve.minus) if quantity]
        if all(name in units for name in names):
            symbol = units[names[0]]
            unit = DISPLAY_UNITS.get(symbol, Unit(symbol, ""))
            values = recording[names[0]] - (recording[names[1]] if curve.minus else 0.0)
            lines.append(_Line(curve, values / unit.factor, unit))
    return lines


def _axis_names(recording: Recording) -> list[str]:
    quantities = {curve.quantity for panel in _PANELS for curve in panel.curves}
    parts = [name.rpartition(".") for name in recording.dtype.names or ()]
    return list(dict.fromkeys(axis for axis, _, quantity in parts if quantity in quantities))
