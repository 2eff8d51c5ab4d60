"""Figures of the reports."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hil_bench.abilities.campaign.reports.page import svg_of
from hil_bench.abilities.campaign.search.records import Method, SearchResult
from hil_bench.figure_style import BLUE, GREEN, ORANGE, RED, STYLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BINS = 40
_LARGEST = 3.0  # a margin that is shown as it is; larger ones are in the last bin
_STYLE = STYLE | {"svg.fonttype": "none", "font.size": 9}
_COLOURS = {Method.RANDOM: ORANGE, Method.SOBOL: GREEN, Method.CMA_ES: BLUE}


def margin_figure(margins: Sequence[float]) -> str:
    """Return the distribution of some margins as SVG; what failed is in another colour."""
    import matplotlib as mpl  # noqa: PLC0415 - an extra, and slow to import
    from matplotlib.figure import Figure  # noqa: PLC0415

    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(6.4, 1.7), layout="constrained")
        axes = figure.add_subplot()
        values = np.clip(margins, -_LARGEST, _LARGEST)
        ends = min(values.min(), 0.0), max(values.max(), 0.0) + 1e-9
        edges: list[float] = np.linspace(*ends, _BINS).tolist()
        failed = values[values < 0.0]
        axes.hist(
            values[values >= 0.0], edges, color=BLUE, label=f"holds ({len(values) - len(failed)})"
        )
        if len(failed):
            axes.hist(failed, edges, color=RED, label=f"fails ({len(failed)})")
        axes.axvline(0.0, color="#222222", linewidth=1.0)
        label = "margin, as a share of the tolerance" + beyond(margins)
        axes.set(xlabel=label, ylabel="runs")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        return svg_of(figure)


def beyond(margins: Sequence[float]) -> str:
    """Return the number of margins outside the figure, which its first and last bin hold."""
    counts = (sum(m < -_LARGEST for m in margins), sum(m > _LARGEST for m in margins))
    pairs = zip(counts, (f"below {-_LARGEST:g}", f"above {_LARGEST:g}"), strict=True)
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
    best = np.minimum.accumulate(np.clip(margins, -_LARGEST, _LARGEST))
    axes.step(numbers, best, where="post", color=colour, label=method.value)
    axes.plot(numbers, np.clip(margins, -_LARGEST, _LARGEST), ".", color=colour, markersize=2)
