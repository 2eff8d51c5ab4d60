"""A campaign as those see it who watch: how far it is, verdicts, and the worst margins."""

from collections import Counter

from hil_bench.abilities.campaign.records import RunResult, Verdict
from hil_bench.abilities.campaign.summary import show_point, size_of
from hil_bench.abilities.scenario.judgement import WORST_FIRST, RequirementOutcome
from hil_bench.cli.work_side import WorkView
from hil_bench.session.work_feed import WorkItem


class CampaignView:
    """Shows the runs of a campaign as they end.

    Args:
        view: where it is shown.
        total: how many runs there are.
    """

    def __init__(self, view: WorkView, total: int) -> None:
        self._view = view
        self._done = 0
        self._counts: Counter[str] = Counter()
        self._worst: dict[tuple[str, str], tuple[tuple[int, float], WorkItem]] = {}
        view.show(total=total)

    def note(self, result: RunResult | None) -> None:
        """Take the result of a run; None for one that was done before."""
        self._done += 1
        if not self._view.is_watched:
            return
        self._counts["done before" if result is None else str(result.outcome)] += 1
        if result is not None:
            self._take(result)
        worst = sorted(self._worst.values(), key=lambda each: each[0])
        self._view.show(
            done=self._done, counts=dict(self._counts), items=[item for _, item in worst]
        )

    def _take(self, result: RunResult) -> None:
        if not result.verdicts:
            item = WorkItem(result.scenario, str(result.outcome), result.problem)
            self._worst[result.scenario, ""] = (-1, 0.0), item
        for verdict in result.verdicts:
            self._keep(result, verdict)

    def _keep(self, result: RunResult, verdict: Verdict) -> None:
        """Keep a verdict where none of its requirement has been worse."""
        margin = verdict.decided_margin
        badness = WORST_FIRST.index(RequirementOutcome(verdict.outcome)), size_of(verdict)
        place = result.scenario, verdict.id
        if place in self._worst and self._worst[place][0] <= badness:
            return
        text = "" if margin is None else f"smallest margin {margin:+.2g} of the tolerance"
        if result.values:
            text += f" at {show_point(result.values)}"
        item = WorkItem(f"{result.scenario} {verdict.id}", verdict.outcome, text.strip())
        self._worst[place] = badness, item
