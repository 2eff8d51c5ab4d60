"""The report of a search."""

from pathlib import Path

from hil_bench.abilities.campaign.reports.figures import search_figure
from hil_bench.abilities.campaign.reports.page import write_page
from hil_bench.abilities.campaign.search.falsify import Falsification
from hil_bench.abilities.campaign.summary import show_point


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
            "point": show_point(each.worst.point) if each.worst else "",
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
