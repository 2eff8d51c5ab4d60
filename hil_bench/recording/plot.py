"""A recording as a figure: a panel a quantity, a column an axis, one time axis for all.

The panels are drawn from the channels ``AXIS.position_setpoint``, ``.position``, ``.pressure_a``,
``.pressure_b``, ``.spool_setpoint`` and ``.spool_position``; what a recording lacks is left out.
"""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.errors import ConfigError
from hil_bench.recording.channels import TIME, Recording
from hil_bench.units import BAR, MILLIMETRE, PERCENT, Unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's palette, which colour-blind readers can tell apart.
_BLUE, _ORANGE, _GREEN, _RED, _GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#9A9A9A"


class _Curve(NamedTuple):
    quantity: str
    label: str
    colour: str
    is_setpoint: bool = False


class _Panel(NamedTuple):
    label: str
    unit: Unit
    curves: tuple[_Curve, ...]
    share: float  # of the figure's height


_TRACKING_ERROR = "tracking_error"

_PANELS = (
    _Panel(
        "Position",
        MILLIMETRE,
        (
            _Curve("position_setpoint", "set-point", _GREY, is_setpoint=True),
            _Curve("position", "actual", _BLUE),
        ),
        share=1.5,
    ),
    _Panel("Tracking error", MILLIMETRE, (_Curve(_TRACKING_ERROR, "", _RED),), share=0.8),
    _Panel(
        "Pressure",
        BAR,
        (_Curve("pressure_a", "$P_A$", _ORANGE), _Curve("pressure_b", "$P_B$", _GREEN)),
        share=1.0,
    ),
    _Panel(
        "Spool",
        PERCENT,
        (
            _Curve("spool_setpoint", "set-point", _GREY, is_setpoint=True),
            _Curve("spool_position", "actual", _BLUE),
        ),
        share=1.0,
    ),
)

_STYLE = {
    "axes.edgecolor": "#444444",
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.labelcolor": "#222222",
    "axes.spines.right": False,
    "axes.spines.top": False,
    "font.size": 10,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
}


def plot_result(recording: Recording, path: Path, *, title: str = "") -> None:
    """Write a recording as a picture; the suffix of `path` is its format.

    Raises:
        ConfigError: matplotlib is not installed, the recording has nothing to draw, or the file
            cannot be written.
    """
    axes = _axis_names(recording)
    if not axes:
        raise ConfigError(f"{path}: the recording has no axis to plot; record its channels")
    try:
        import matplotlib as mpl  # noqa: PLC0415 - an extra, and slow to import
    except ImportError:
        right = "install it with: pip install 'hil-bench[plot]'"
        raise ConfigError(f"{path}: a plot needs matplotlib; {right}") from None
    with mpl.rc_context(_STYLE):
        figure = _draw(recording, axes, title)
        try:
            figure.savefig(path, dpi=150)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise ConfigError(f"{path}: cannot be written: {reason}; give a .png file") from None


def _draw(recording: Recording, axes: list[str], title: str) -> "Figure":
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import

    panels = [panel for panel in _PANELS if any(_curves(recording, axis, panel) for axis in axes)]
    height = 1.0 + 1.9 * sum(panel.share for panel in panels)
    figure = Figure(
        figsize=(9.0 if len(axes) == 1 else 6.5 * len(axes), height), layout="constrained"
    )
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
        column[-1].set_xlabel("Time [s]")
    for place, panel in zip(grid[:, 0], panels, strict=True):
        place.set_ylabel(f"{panel.label} [{panel.unit.symbol}]")
    figure.align_ylabels()
    figure.suptitle(title)
    return figure


def _draw_panel(place: "Axes", recording: Recording, axis: str, panel: _Panel) -> None:
    curves = _curves(recording, axis, panel)
    for curve, values in curves:
        place.plot(
            recording[TIME.name],
            values / panel.unit.factor,
            color=curve.colour,
            label=curve.label,
            linestyle="--" if curve.is_setpoint else "-",
            # Wider than the actual value, or good tracking would hide it.
            linewidth=2.6 if curve.is_setpoint else 1.3,
            zorder=1.5 if curve.is_setpoint else 2.0,
        )
    place.margins(x=0.01)
    if len(curves) > 1:
        place.legend(loc="lower right", bbox_to_anchor=(1.0, 0.96), ncols=2, borderaxespad=0.0)


def _curves(
    recording: Recording, axis: str, panel: _Panel
) -> list[tuple[_Curve, npt.NDArray[np.float64]]]:
    found = [(curve, _values(recording, axis, curve.quantity)) for curve in panel.curves]
    return [(curve, values) for curve, values in found if values is not None]


def _values(recording: Recording, axis: str, quantity: str) -> npt.NDArray[np.float64] | None:
    if quantity == _TRACKING_ERROR:
        setpoint = _values(recording, axis, "position_setpoint")
        position = _values(recording, axis, "position")
        return None if setpoint is None or position is None else setpoint - position
    name = f"{axis}.{quantity}"
    return recording[name] if name in (recording.dtype.names or ()) else None


def _axis_names(recording: Recording) -> list[str]:
    quantities = {curve.quantity for panel in _PANELS for curve in panel.curves}
    parts = [name.rpartition(".") for name in recording.dtype.names or ()]
    return list(dict.fromkeys(axis for axis, _, quantity in parts if quantity in quantities))
