"""The look of every figure: palette and style, in one place."""

from typing import Any

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
