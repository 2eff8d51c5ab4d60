"""Plots of recordings: of signals, and of frames below them."""

from collections.abc import Callable, Sequence
from fnmatch import fnmatchcase
from functools import partial
from importlib.util import find_spec
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.common.figure_style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    RED,
    SKY,
    STYLE,
)
from hil_bench.abilities.common.files import whole_file
from hil_bench.abilities.common.shown_units import display_unit
from hil_bench.abilities.recording.reading import given_units
from hil_bench.errors import ConfigError, about_file
from hil_bench.outside.recording.channels import (
    TIME,
    Channel,
    LoggedFrame,
    Recording,
    Span,
    recording_channels,
)
from hil_bench.plants.hydraulic_cylinder.quantities import P_A, P_B, P_S
from hil_bench.units import COUNT, Unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# A recording as a figure: a panel a quantity, a column an axis, one time axis for all.
#
# The panels are drawn from the channels ``AXIS.position_setpoint``, ``.position``, likewise
# ``angle``, ``.P_A``, ``.P_B``, ``.P_S``, ``.spool_setpoint`` and ``.spool_position``; what a
# recording lacks is left out. Each panel is in the display unit that belongs to its channels' SI
# unit.

_SAME = 0.01  # of a panel's range: a sensor that errs by less is not drawn beside the actual value


class _Curve(NamedTuple):
    quantity: str
    label: str
    colour: str
    minus: str = ""  # the quantity to subtract, where the curve is a difference
    is_setpoint: bool = False
    is_measured: bool = False


class _Panel(NamedTuple):
    label: str
    curves: tuple[_Curve, ...]
    share: float  # of the figure's height
    measured: str = ""  # SI unit of the sensors that belong here


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
        measured="m",
    ),
    _Panel(
        "Tracking error",
        (_Curve("position_setpoint", "", RED, minus="position"),),
        share=0.8,
    ),
    _Panel(
        "Angle",
        (
            _Curve("angle_setpoint", "set-point", GREY, is_setpoint=True),
            _Curve("angle", "actual", BLUE),
        ),
        share=1.0,
        measured="rad",
    ),
    _Panel(
        "Angular error",
        (_Curve("angle_setpoint", "", RED, minus="angle"),),
        share=0.8,
    ),
    _Panel(
        "Pressure",
        (
            _Curve(P_A, "$P_A$", ORANGE),
            _Curve(P_B, "$P_B$", GREEN),
            _Curve(P_S, "$P_S$", PURPLE),
        ),
        share=1.0,
        measured="Pa",
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


class MotionPanel(NamedTuple):
    """A panel of a figure of several.

    Attributes:
        share: its height, beside that of others.
        draw: draws it.
    """

    share: float
    draw: "Callable[[Axes], None]"


def plot_result(
    recording: Recording, path: Path, *, title: str = "", spans: Sequence[Span] = ()
) -> None:
    """Write a recording as a picture; the suffix of `path` is its format.

    Args:
        recording: what to draw.
        path: the picture.
        title: above it.
        spans: times to shade.

    Raises:
        ConfigError: the recording has nothing to draw.
    """
    if not has_axis(recording):
        raise ConfigError(f"{path}: the recording has no axis to plot; record its channels")
    save_figure(lambda: result_figure(recording, title=title, spans=spans), path)


def draw_motion(recording: Recording, path: Path, *, title: str, spans: Sequence[Span]) -> bool:
    """Write a recording as a picture where matplotlib is there and it has an axis; True if so."""
    drawn = find_spec("matplotlib") is not None and bool(recording.size) and has_axis(recording)
    if drawn:
        plot_result(recording, path, title=title, spans=spans)
    return drawn


def table_figure(recording: Recording, patterns: Sequence[str]) -> "Figure":
    """Return the motion of the axes as a figure, or the signals that patterns name."""
    if patterns or not has_axis(recording):
        return styled(lambda: signal_figure(recording, patterns=patterns))
    return styled(lambda: result_figure(recording))


def save_figure(draw: Callable[[], "Figure"], path: Path) -> None:
    """Draw a figure in our style and write it; the suffix of `path` is its format."""

    def draw_and_write() -> "Figure":
        figure = draw()
        right = "give a file in a directory of yours"
        with about_file(path, right=right), whole_file(path) as file:
            try:
                figure.savefig(file, dpi=150)
            except ValueError as error:
                text = f"{path}: cannot be written: {error}; give a .png file"
                raise ConfigError(text) from None
        return figure

    styled(draw_and_write, what=f"{path}: a plot")


def styled(draw: Callable[[], "Figure"], *, what: str = "a plot") -> "Figure":
    """Return a figure, drawn in our style.

    Args:
        draw: draws it.
        what: how the error names it.

    Raises:
        ConfigError: matplotlib is not installed.
    """
    try:
        import matplotlib as mpl  # noqa: PLC0415 - an extra, and slow to import
    except ImportError:
        right = "install it with: pip install 'hil-bench[plot]'"
        raise ConfigError(f"{what} needs matplotlib; {right}") from None
    with mpl.rc_context(STYLE):
        return draw()


def has_axis(recording: Recording) -> bool:
    """Return True if a recording has what `plot_result` draws."""
    return bool(_axis_names(recording))


def result_figure(recording: Recording, *, title: str = "", spans: Sequence[Span] = ()) -> "Figure":
    """Return the motion of all axes as a figure; see `plot_result`."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import

    axes = _axis_names(recording)
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
            shade_spans(place, spans)
        label_spans(column[0], spans)
        column[0].set_title(axis if len(axes) > 1 else "", loc="left", fontweight="bold")
    figure.align_ylabels()
    figure.suptitle(title)
    return figure


def shade_spans(place: "Axes", spans: Sequence[Span]) -> None:
    """Shade times in which something was otherwise."""
    for span in spans:
        place.axvspan(span.begin, span.end, color=RED, alpha=0.12, linewidth=0.0)


def label_spans(place: "Axes", spans: Sequence[Span]) -> None:
    """Write the label of each span at its begin."""
    for span in spans:
        place.annotate(
            f" {span.label}".replace("$", r"\$"),
            (span.begin, 0.04),
            xycoords=("data", "axes fraction"),
            rotation=90.0,
            fontsize=8,
            color=RED,
        )


def motion_panels(recording: Recording, preferred: Sequence[str] = ()) -> list[MotionPanel]:
    """Return the panels of one axis: of the first preferred one, else of the first of all."""
    axes = _axis_names(recording)
    shown = next((name for name in (*preferred, *axes) if name in axes), "")
    return [
        MotionPanel(panel.share, partial(_draw_panel, recording=recording, axis=shown, panel=panel))
        for panel in _PANELS
        if _lines(recording, shown, panel)
    ]


def _draw_panel(place: "Axes", recording: Recording, axis: str, panel: _Panel) -> None:
    lines = _lines(recording, axis, panel)
    for curve, values, unit in lines:
        place.plot(
            recording[TIME.name],
            values,
            color=curve.colour,
            label=curve.label,
            linestyle="--" if curve.is_setpoint else ":" if curve.is_measured else "-",
            # Wider than the actual value, or good tracking would hide it.
            linewidth=2.6 if curve.is_setpoint else 1.0 if curve.is_measured else 1.3,
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
            unit = display_unit(symbol)
            values = recording[names[0]] - (recording[names[1]] if curve.minus else 0.0)
            lines.append(_Line(curve, values / unit.factor, unit))
    if lines and panel.measured and len(_axis_names(recording)) == 1:
        lines += _measured_lines(recording, lines, panel.measured)
    return lines


def _measured_lines(recording: Recording, shown: list[_Line], symbol: str) -> list[_Line]:
    """The lines of the sensors that differ from what they measure; others would hide it."""
    lines = []
    for channel in recording_channels(recording):
        if not channel.name.endswith(".measured") or channel.unit != symbol:
            continue
        values = recording[channel.name] / shown[0].unit.factor
        apart = min(float(np.nanmax(np.abs(values - line.values))) for line in shown)
        if not apart <= _SAME * max(float(np.ptp(line.values)) for line in shown):
            label = channel.name.replace(".", " ")
            curve = _Curve(channel.name, label, BLACK, is_measured=True)
            lines.append(_Line(curve, values, shown[0].unit))
    return lines


def _axis_names(recording: Recording) -> list[str]:
    quantities = {curve.quantity for panel in _PANELS for curve in panel.curves}
    parts = [name.rpartition(".") for name in recording.dtype.names or ()]
    return list(dict.fromkeys(axis for axis, _, quantity in parts if quantity in quantities))


# Any signals of a recording as a figure: a panel a unit, one time axis.

_COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, BLACK)


def choose_channels(recording: Recording, patterns: Sequence[str]) -> list[Channel]:
    """Return the signals whose names fit a pattern such as ``axis1.P_*``; all without patterns.

    Raises:
        ConfigError: a pattern fits none.
    """
    channels = [channel for channel in recording_channels(recording) if channel != TIME]
    for pattern in patterns:
        if not any(fnmatchcase(channel.name, pattern) for channel in channels):
            names = ", ".join(channel.name for channel in channels) or "none at all"
            raise ConfigError(f"no signal fits {pattern}; the recording has {names}")
    return [
        channel
        for channel in channels
        if not patterns or any(fnmatchcase(channel.name, pattern) for pattern in patterns)
    ]


def plot_signals(
    recording: Recording,
    path: Path,
    *,
    patterns: Sequence[str] = (),
    title: str = "",
    spans: Sequence[Span] = (),
) -> None:
    """Write signals as a picture; the suffix of `path` is its format.

    Raises:
        ConfigError: there is nothing to draw.
    """
    if not choose_channels(recording, patterns) or not len(recording):
        raise ConfigError(f"{path}: the recording has no signals to plot")
    save_figure(lambda: signal_figure(recording, patterns=patterns, title=title, spans=spans), path)


def signal_figure(
    recording: Recording,
    *,
    patterns: Sequence[str] = (),
    title: str = "",
    spans: Sequence[Span] = (),
) -> "Figure":
    """Return signals as a figure; see `plot_signals`."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import

    channels = choose_channels(recording, patterns)
    given = given_units(recording)
    panels: dict[str, list[Channel]] = {}
    for channel in channels:
        is_count = given.get(channel.name) == COUNT
        panels.setdefault(COUNT if is_count else channel.unit, []).append(channel)
    figure = Figure(figsize=(9.0, 1.0 + 2.2 * len(panels)), layout="constrained")
    places = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for place, (unit, of_unit) in zip(places, panels.items(), strict=True):
        _draw_unit(place, recording, of_unit, unit)
        shade_spans(place, spans)
    label_spans(places[0], spans)
    places[-1].set_xlabel(f"Time [{TIME.unit}]")
    figure.align_ylabels()
    figure.suptitle(title)
    return figure


def _draw_unit(
    place: "Axes", recording: Recording, channels: Sequence[Channel], symbol: str
) -> None:
    unit = display_unit(symbol)
    for channel, colour in zip(channels, cycle(_COLOURS), strict=False):
        values = recording[channel.name] / unit.factor
        place.plot(recording[TIME.name], values, color=colour, label=channel.name, linewidth=1.2)
    place.set_ylabel("[-]" if symbol == COUNT else f"[{unit.symbol}]")
    place.margins(x=0.01)
    place.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")


# Bus traffic as a figure: when each identifier was on the bus, and how many frames a second.

_BINS = 200


def plot_frames(
    frames: Sequence[LoggedFrame],
    path: Path,
    *,
    title: str = "",
    name_of: Callable[[int], str] = "0x{:03X}".format,
) -> None:
    """Write traffic as a picture; the suffix of `path` is its format.

    Args:
        frames: the traffic.
        path: the picture.
        title: above it.
        name_of: what an identifier is called.

    Raises:
        ConfigError: there are no frames.
    """
    if not frames:
        raise ConfigError(f"{path}: the recording has no frames to plot")
    save_figure(lambda: _draw(frames, title, name_of), path)


def _draw(frames: Sequence[LoggedFrame], title: str, name_of: Callable[[int], str]) -> "Figure":
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import

    identifiers = sorted({logged.frame.can_id for logged in frames}, reverse=True)
    height = max(1.5, 0.22 * len(identifiers))
    figure = Figure(figsize=(9.0, 2.8 + height), layout="constrained")
    raster, rate = figure.subplots(2, 1, sharex=True, height_ratios=[height, 1.6])
    _draw_raster(raster, frames, identifiers)
    raster.set_yticks(range(len(identifiers)), list(map(name_of, identifiers)))
    _draw_rate(rate, frames)
    figure.suptitle(title)
    return figure


def _draw_raster(place: "Axes", frames: Sequence[LoggedFrame], identifiers: list[int]) -> None:
    rows = {can_id: row for row, can_id in enumerate(identifiers)}
    for is_received, colour, label in (
        (True, ORANGE, "received"),
        (False, BLUE, "sent"),
        (None, BLUE, "received or sent"),
    ):
        chosen = [logged for logged in frames if logged.is_received is is_received]
        if not chosen:
            continue
        place.plot(
            [logged.now * 1e-9 for logged in chosen],
            [rows[logged.frame.can_id] for logged in chosen],
            color=colour,
            label=label,
            linestyle="",
            marker="|",
            markersize=7,
        )
    place.set_ylabel("CAN identifier")
    place.margins(x=0.01)
    place.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.0)


def _draw_rate(place: "Axes", frames: Sequence[LoggedFrame]) -> None:
    times = np.array([logged.now for logged in frames]) * 1e-9
    counts, edges = np.histogram(times, bins=_BINS)
    width = edges[1] - edges[0]
    if width > 0.0:
        place.stairs(counts / width, edges, color=BLUE)
    place.set_ylabel("Frames [1/s]")
    place.set_xlabel("Time [s]")
    place.set_ylim(bottom=0.0)
