"""Figures of the reports."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hil_bench.abilities.campaign.reports.margin_bins import LARGEST, bin_margins
from hil_bench.abilities.campaign.reports.page import svg_of
from hil_bench.abilities.campaign.search.records import Method, SearchResult
from hil_bench.figure_style import BLUE, GREEN, ORANGE, RED, STYLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STYLE = STYLE | {"svg.fonttype": "none", "font.size": 9}
_COLOURS = {Method.RANDOM: ORANGE, Method.SOBOL: GREEN, Method.CMA_ES: BLUE}


def margin_figure(margins: Sequence[float]) -> str:
    """Return the distribution of some margins as SVG; what failed is in another colour."""
    import matplotlib as mpl  # noqa: PLC0415 - an extra, and slow to import
    from matplotlib.figure import Figure  # noqa: PLC0415

    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(6.4, 1.7), layout="constrained")
        axes = figure.add_subplot()
        _draw_bins(axes, margins)
        axes.axvline(0.0, color="#222222", linewidth=1.0)
        axes.set(xlabel="margin [% of the tolerance]", ylabel="runs")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        return svg_of(figure)


def _draw_bins(axes: "Axes", margins: Sequence[float]) -> None:
    """Draw the bins, and beside them, hatched, the margins that lie beyond."""
    low, high, counts, below, above = bin_margins(margins)
    width = (high - low) / len(counts)
    lefts = low + width * np.arange(len(counts))
    fails = lefts < -0.5 * width
    failed = sum(margin < 0.0 for margin in margins)
    holding = sum(margin >= 0.0 for margin in margins)
    groups = ((~fails, BLUE, f"holds ({holding})"), (fails, RED, f"fails ({failed})"))
    for chosen, colour, label in groups:
        if chosen.any():
            heights = np.asarray(counts)[chosen]
            axes.bar(
                100 * lefts[chosen], heights, 100 * width, align="edge", color=colour, label=label
            )
    for count, left, colour, words in (
        (below, low - 2 * width, RED, f"below {-100 * LARGEST:g} %"),
        (above, high + width, BLUE, f"above {100 * LARGEST:g} %"),
    ):
        if count:
            axes.bar(
                100 * left,
                count,
                100 * width,
                align="edge",
                color="none",
                edgecolor=colour,
                hatch="////",
                label=f"{words} ({count})",
            )


def beyond(margins: Sequence[float]) -> str:
    """Return the number of margins outside the figure, which its first and last bin hold."""
    counts = (sum(m < -LARGEST for m in margins), sum(m > LARGEST for m in margins))
    pairs = zip(counts, (f"below {-LARGEST:g}", f"above {LARGEST:g}"), strict=True)
    outside = [f"{count} {where}" for count, where in pairs if count]
    return f" ({' and '.join(outside)}: shown at the end)" if outside else ""


def search_figure(found: SearchResult, requirement: str) -> str:
    """Return the course of each method's smallest margin, as SVG."""
    import matplotlib as mpl  # noqa: PLC0415 - an extra, and slow to import
    from matplotlib.figure import Figure  # noqa: PLC0415

    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(6.4, 2.2), layout="constrained")
        axes = figure.add_subplot()
        for method, colour in _COLOURS.items():
            _draw_method(axes, found, requirement, method, colour)
        axes.axhline(0.0, color="#222222", linewidth=1.0)
        margins = [m for each in found.trials if (m := each.margin(requirement)) is not None]
        axes.set(xlabel="run" + beyond(margins), ylabel="smallest margin so far")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        return svg_of(figure)


def _draw_method(
    axes: "Axes", found: SearchResult, requirement: str, method: Method, colour: str
) -> None:
    points = [
        (trial.number, margin)
        for trial in found.of(method)
        if (margin := trial.margin(requirement)) is not None
    ]
    if not points:
        return
    numbers, margins = zip(*points, strict=True)
    best = np.minimum.accumulate(np.clip(margins, -LARGEST, LARGEST))
    axes.step(numbers, best, where="post", color=colour, label=method.value)
    axes.plot(numbers, np.clip(margins, -LARGEST, LARGEST), ".", color=colour, markersize=2)
