"""The report as one HTML file that opens offline: no script, nothing from elsewhere."""

from hil_bench.abilities.scenario.report.content import Report
from hil_bench.outside.page import render_page


def report_html(report: Report) -> str:
    """Return a report as HTML."""
    return render_page(__package__, "report.html.j2", {"report": report}, _shown)


def _shown(value: object) -> object:
    return f"{value:.4g}" if isinstance(value, float) else "" if value is None else value
