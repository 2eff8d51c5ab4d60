"""The report of a campaign."""

from collections.abc import Sequence
from pathlib import Path

from hil_bench.abilities.campaign.comparison import Change
from hil_bench.abilities.campaign.executing import Outcome
from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.records import RunResult
from hil_bench.abilities.campaign.replay import Replay, replay
from hil_bench.abilities.campaign.reports.figures import margin_figure
from hil_bench.abilities.campaign.reports.page import write_page
from hil_bench.abilities.campaign.sensitivity import Sensitivity
from hil_bench.abilities.campaign.summary import (
    bounds_of,
    command_of,
    correlations,
    count_outcomes,
    show_point,
    smallest_margin,
    summarise,
    worst_runs,
)

_SHOWN = 20  # correlations


def write_campaign_report(
    path: Path,
    plan: Plan,
    outcome: Outcome,
    changes: Sequence[Change],
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
            "median": sorted(each.margins)[len(each.margins) // 2] if each.margins else None,
            "worst": show_point(each.worst.values) if each.worst else "",
            "seen": each.seen,
            "figure": margin_figure(each.margins) if each.margins else "",
        }
        for each in summarise(results)
    ]
    worst_results = worst_runs(results)
    pictures = _pictures(plan, worst_results)
    worst = [
        {
            "result": each,
            "margin": smallest_margin(each),
            "point": show_point(each.values),
            "reasons": [one for one in each.verdicts if one.outcome != "passed"],
            "command": command_of(plan, each),
            "replay": pictures[each.key],
        }
        for each in worst_results
    ]
    content = {
        "title": campaign.title or campaign.path.name,
        "campaign": campaign,
        "outcomes": count_outcomes(results),
        "outcome": outcome,
        "requirements": requirements,
        "correlations": correlations(results)[:_SHOWN],
        "sensitivity": sensitivity,
        "bounds": list(bounds_of(plan, results)),
        "worst": worst,
        "changes": changes,
    }
    write_page(path, "campaign.html", content)


def _pictures(plan: Plan, results: Sequence[RunResult]) -> dict[str, Replay]:
    wanted = {each.key: each for each in results}
    return {spec.key: replay(spec, wanted[spec.key]) for spec in plan if spec.key in wanted}
