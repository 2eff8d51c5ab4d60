"""Bus traffic as a figure: when each identifier was on the bus, and how many frames a second."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hil_bench.errors import ConfigError
from hil_bench.figure_style import BLUE, ORANGE
from hil_bench.outside.recording.logged_frame import LoggedFrame
from hil_bench.outside.recording.plot import save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
