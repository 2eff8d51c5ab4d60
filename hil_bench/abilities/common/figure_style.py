"""The look of every figure, and how it is written: palette and style, in one place."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hil_bench.abilities.common.files import whole_file
from hil_bench.errors import about_file, require_extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito's palette, which colour-blind readers can tell apart.
BLUE, ORANGE, GREEN, RED, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#9A9A9A"
PURPLE, SKY, BLACK = "#CC79A7", "#56B4E9", "#222222"

STYLE: dict[Any, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": "#444444",
    "axes.formatter.useoffset": False,  # or a reader has to add what stands above the axis
    "axes.grid": True,
    "axes.labelcolor": "#222222",
    "axes.spines.right": False,
    "axes.spines.top": False,
    "font.size": 10,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "svg.hashsalt": "hil-bench",  # or each SVG file of the same figure has other identifiers
    "xtick.color": "#444444",
    "ytick.color": "#444444",
}
"""Settings for `matplotlib.rc_context`."""

_METADATA: Mapping[str, Mapping[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
}


def settle_layout(figure: "Figure") -> None:
    """Lay a figure out and round the places of its axes, so that its file has the same bytes.

    The solver of the layout differs by rounding from process to process, and an SVG file names each
    clip path by a hash of its place.
    """
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes in figure.axes:
        left, bottom, width, height = (round(each, 6) for each in axes.get_position().bounds)
        axes.set_position((left, bottom, width, height))


def write_figure(draw: Callable[[], "Figure"], stem: Path) -> list[Path]:
    """Draw a figure in the house style and write it as `stem`.png and `stem`.svg."""
    require_extra("matplotlib", "a figure")
    import matplotlib as mpl  # noqa: PLC0415 - an extra, and slow to import

    files = []
    with mpl.rc_context(STYLE):
        figure = draw()
        settle_layout(figure)
        for suffix, metadata in _METADATA.items():
            path = stem.with_name(f"{stem.name}.{suffix}")
            options: dict[str, Any] = {"dpi": 150, "metadata": dict(metadata)}
            with about_file(path, right="give a directory of yours"), whole_file(path) as file:
                figure.savefig(file, **options)
            files.append(path)
    return files
