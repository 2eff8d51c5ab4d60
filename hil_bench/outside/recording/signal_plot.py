"""Any signals of a recording as a figure: a panel a unit, one time axis."""

from collections.abc import Sequence
from fnmatch import fnmatchcase
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

from hil_bench.errors import ConfigError
from hil_bench.figure_style import BLACK, BLUE, GREEN, ORANGE, PURPLE, RED, SKY
from hil_bench.outside.recording.channels import TIME, Channel, Recording, recording_channels
from hil_bench.outside.recording.plot import label_spans, save_figure, shade_spans
from hil_bench.outside.recording.spans import Span
from hil_bench.shown_units import display_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
    units = list(dict.fromkeys(channel.unit for channel in channels))
    figure = Figure(figsize=(9.0, 1.0 + 2.2 * len(units)), layout="constrained")
    places = figure.subplots(len(units), 1, sharex=True, squeeze=False)[:, 0]
    for place, unit in zip(places, units, strict=True):
        _draw_panel(place, recording, [c for c in channels if c.unit == unit], unit)
        shade_spans(place, spans)
    label_spans(places[0], spans)
    places[-1].set_xlabel(f"Time [{TIME.unit}]")
    figure.align_ylabels()
    figure.suptitle(title)
    return figure


def _draw_panel(
    place: "Axes", recording: Recording, channels: Sequence[Channel], symbol: str
) -> None:
    unit = display_unit(symbol)
    for channel, colour in zip(channels, cycle(_COLOURS), strict=False):
        values = recording[channel.name] / unit.factor
        place.plot(recording[TIME.name], values, color=colour, label=channel.name, linewidth=1.2)
    place.set_ylabel(f"[{unit.symbol}]")
    place.margins(x=0.01)
    place.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
