"""Reports of campaigns and searches: one HTML file each, which opens without a network."""

import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hil_bench.abilities.campaign import summary
from hil_bench.abilities.campaign.falsify import Falsification
from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.records import RunResult, RunSpec
from hil_bench.abilities.campaign.search import Method, SearchResult
from hil_bench.abilities.campaign.sensitivity import Sensitivity
from hil_bench.abilities.campaign.snapshot import play_spec, verdicts_of
from hil_bench.abilities.campaign.store import program_identity
from hil_bench.abilities.campaign.table import Outcome
from hil_bench.abilities.common.figure_style import BLUE, GREEN, ORANGE, RED, STYLE, settle_layout
from hil_bench.abilities.common.files import whole_file
from hil_bench.abilities.common.page import render_page
from hil_bench.abilities.common.work import Histogram
from hil_bench.abilities.scenario.judgement import show_seen, show_share
from hil_bench.abilities.scenario.report import make_exhibit
from hil_bench.abilities.scenario.run import PlayOptions
from hil_bench.errors import (
    HilBenchError,
    about_file,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# A page from a template: values are escaped, figures are inside.


def write_page(path: Path, template: str, content: Mapping[str, object]) -> None:
    """Write a page; one that cannot be written is a `ConfigError`.

    Args:
        path: of the page.
        template: the name of the template.
        content: what it names.
    """
    shown = {"program": program_identity(), "show_share": show_share, "show_seen": show_seen}
    text = render_page(__package__, template, {**shown, **content})
    with about_file(path), whole_file(path) as file:
        file.write_text(text, encoding="utf-8")


def svg_of(figure: "Figure") -> str:
    """Return a figure as the text of an SVG element, the same for the same figure."""
    from markupsafe import Markup  # noqa: PLC0415 - comes with jinja2

    settle_layout(figure)
    out = io.StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    text = out.getvalue()
    return Markup(text[text.index("<svg") :])  # noqa: S704 - from matplotlib, which escapes texts


# Bins of margins: zero is an edge, so that no bin holds both what holds and what fails.

LARGEST = 3.0
"""A margin that has a bin, as a share of the tolerance; larger ones are counted beside them."""

_BINS = 30
_ROUND = (1.0, 2.0, 2.5, 5.0, 10.0)


def bin_margins(margins: Sequence[float], name: str = "") -> Histogram:
    """Return the distribution of a requirement's margins; NaN is left out."""
    values = np.asarray([each for each in margins if not math.isnan(each)], dtype=np.float64)
    inside = values[np.abs(values) <= LARGEST]
    low = min(0.0, float(inside.min(initial=0.0)))
    high = max(0.0, float(inside.max(initial=0.0)))
    step = _step((high - low) / _BINS)
    first = min(math.floor(low / step), -1 if low < 0.0 else 0)  # low / step may be rounded to 0
    last = max(math.floor(high / step) + 1, 1)
    edges = np.arange(first, last + 1) * step
    counts, _ = np.histogram(inside, edges)
    below, above = int((values < -LARGEST).sum()), int((values > LARGEST).sum())
    return Histogram(
        name, float(edges[0]), float(edges[-1]), [int(each) for each in counts], below, above
    )


def _step(raw: float) -> float:
    """Return the next larger round number."""
    if raw <= 0.0:
        return 0.01
    size = 10.0 ** math.floor(math.log10(raw))
    return next(each * size for each in _ROUND if each * size >= raw * (1.0 - 1e-9))


# Figures of the reports.

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
    _, low, high, counts, below, above = bin_margins(margins)
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


# A run of a campaign played again, for the picture of what went wrong in it.


class Replay(NamedTuple):
    """The result of a replayed run.

    Attributes:
        picture: of the requirement with the smallest margin, an SVG file; empty for none.
        problem: why there is none.
    """

    picture: bytes
    problem: str = ""


def replay(spec: RunSpec, result: RunResult) -> Replay:
    """Play a run again, and draw the requirement with the smallest margin.

    Args:
        spec: the run.
        result: what came of it in the campaign.
    """
    if result.outcome.is_cut_off:
        return Replay(b"", "it did not come to its end, so it is not drawn")
    try:
        run = play_spec(spec, PlayOptions(keeps_evidence=True))
    except HilBenchError as error:
        return Replay(b"", f"played again it fails otherwise: {error}")
    if verdicts_of(run) != result.verdicts or run.evidence is None:
        return Replay(b"", "played again it has other margins: the controller is not deterministic")
    sizes = [summary.size_of(each) for each in result.verdicts]
    return Replay(make_exhibit(run.findings[sizes.index(min(sizes))], run.evidence).picture)


# The report of a campaign.

_SHOWN = 20  # correlations


def write_campaign_report(
    path: Path,
    plan: Plan,
    outcome: Outcome,
    changes: Sequence[summary.Change],
    sensitivity: Sensitivity,
) -> None:
    """Write the report of a campaign.

    Args:
        path: of the HTML file.
        plan: the campaign.
        outcome: what came of it.
        changes: since another campaign; empty for none.
        sensitivity: of its margins to its parameters.
    """
    campaign, results = plan.campaign, outcome.results
    requirements = [
        {
            "scenario": each.scenario,
            "id": each.id,
            "outcomes": each.outcomes,
            "failures": each.failures,
            "tally": each.tally,
            "smallest": min(each.margins, default=None),
            "median": median(each.margins) if each.margins else None,
            "worst": summary.show_point(each.worst.values) if each.worst else "",
            "seen": each.seen,
            "figure": margin_figure(each.margins) if each.margins else "",
        }
        for each in summary.summarise(results)
    ]
    worst_results = summary.worst_runs(results)
    pictures = _pictures(plan, worst_results)
    worst = [
        {
            "result": each,
            "margin": summary.smallest_margin(each),
            "point": summary.show_point(each.values),
            "reasons": [one for one in each.verdicts if one.outcome != "passed"],
            "command": summary.command_of(plan, each),
            "replay": pictures[each.key],
        }
        for each in worst_results
    ]
    content = {
        "title": campaign.title or campaign.path.name,
        "campaign": campaign,
        "outcomes": summary.count_outcomes(results),
        "outcome": outcome,
        "requirements": requirements,
        "correlations": summary.correlations(results)[:_SHOWN],
        "sensitivity": sensitivity,
        "notes": [*summary.unjudged_of(plan), *summary.bounds_of(plan, results)],
        "worst": worst,
        "changes": changes,
    }
    write_page(path, "campaign.html", content)


def _pictures(plan: Plan, results: Sequence[RunResult]) -> dict[str, Replay]:
    wanted = {each.key: each for each in results}
    return {spec.key: replay(spec, wanted[spec.key]) for spec in plan if spec.key in wanted}


# The report of a search.


def write_search_report(path: Path, found: Falsification) -> None:
    """Write the report of a search.

    Args:
        path: of the HTML file.
        found: what came of it.
    """
    search, methods = found.search, found.plan.methods
    requirements = [
        {
            "find": each,
            "point": summary.show_point(each.worst.point) if each.worst else "",
            "first": {method: each.first.get(method) for method in methods},
            "figure": search_figure(search, each.id) if each.worst else "",
        }
        for each in search.finds
    ]
    failures = [
        {
            "name": each.target.requirement or "a run that does not come to its end",
            "files": each.files,
            "text": each.files.scenario.read_text(encoding="utf-8") if each.files else "",
        }
        for each in found.failures
    ]
    content = {
        "title": found.case.scenario.title,
        "path": found.case.scenario.path,
        "plan": found.plan,
        "runs": {method: len(search.of(method)) for method in methods},
        "lines": list(found.lines()),
        "requirements": requirements,
        "failures": failures,
    }
    write_page(path, "search.html", content)
