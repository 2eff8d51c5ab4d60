"""A campaign or a search as those see it who watch: progress, margins, failures, best so far."""

import argparse
from collections import Counter
from collections.abc import Callable, Iterator
from time import monotonic

from hil_bench.abilities.campaign.records import RunResult, Verdict
from hil_bench.abilities.campaign.reports import bin_margins
from hil_bench.abilities.campaign.summary import show_point, size_of, smallest_margin
from hil_bench.abilities.campaign.table import Note
from hil_bench.abilities.common.arguments import count_from_zero, count_processors
from hil_bench.abilities.common.progress import Work
from hil_bench.abilities.common.work import (
    MOST_ITEMS,
    Course,
    Failure,
    Histogram,
    WorkItem,
    WorkView,
)
from hil_bench.abilities.scenario.judgement import WORST_FIRST, RequirementOutcome

_PERIOD = 0.5  # between two pictures [s]


class CampaignView:
    """Shows the runs of a campaign or a search as they end.

    Args:
        view: where it is shown.
        total: how many runs there are.
        command: returns what repeats a run in a shell.
        is_search: whether the best margin so far is of interest.
        clock: of the machine [s].
    """

    def __init__(
        self,
        view: WorkView,
        total: int,
        command: Callable[[RunResult], str] = lambda _result: "",
        *,
        is_search: bool = False,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self._view = view
        self._total = total
        self._command = command
        self._is_search = is_search
        self._clock = clock
        self._begin = self._shown = clock()
        self._done = self._fresh = 0
        self._counts: Counter[str] = Counter()
        self._worst: dict[tuple[str, str], tuple[tuple[int, float], WorkItem]] = {}
        self._margins: dict[tuple[str, str], list[float]] = {}
        self._best: dict[tuple[str, str], list[tuple[float, float]]] = {}
        self._failures: list[tuple[float, Failure]] = []
        view.show(total=total, unit="runs")

    def note(self, result: RunResult | None) -> None:
        """Take the result of a run; None for one that was done before."""
        self._done += 1
        if not self._view.is_watched:
            return
        self._counts["done before" if result is None else str(result.outcome)] += 1
        if result is not None:
            self._fresh += 1
            self._take(result)
        if self._clock() - self._shown >= _PERIOD or self._done == self._total:
            self.show()

    def show(self) -> None:
        """Show all that was noted so far."""
        if not self._view.is_watched:
            return
        self._shown = self._clock()
        worst = sorted(self._worst.values(), key=lambda each: each[0])
        failures = sorted(self._failures, key=lambda each: each[0])
        self._view.show(
            done=self._done,
            left=self._left(),
            counts=dict(self._counts),
            items=[item for _, item in worst],
            histograms=list(self._histograms()),
            courses=list(self._courses()) if self._is_search else [],
            failures=[failure for _, failure in failures],
        )

    def _left(self) -> float | None:
        """Return the remaining time by the pace so far [s]; None before the first run."""
        if not self._fresh:
            return None
        return (self._clock() - self._begin) / self._fresh * (self._total - self._done)

    def _histograms(self) -> Iterator[Histogram]:
        for (scenario, requirement), margins in self._margins.items():
            yield bin_margins(margins, f"{scenario} {requirement}")

    def _courses(self) -> Iterator[Course]:
        for (scenario, requirement), points in self._best.items():
            last = (float(self._done), points[-1][1])
            yield Course(f"{scenario} {requirement}", [*points, last])

    def _take(self, result: RunResult) -> None:
        if result.outcome.is_failure:
            self._fail(result)
        if not result.verdicts:
            item = WorkItem(result.scenario, str(result.outcome), result.problem)
            self._worst[result.scenario, ""] = (-1, 0.0), item
        for verdict in result.verdicts:
            self._keep(result, verdict)
            margin = verdict.decided_margin
            if margin is not None:
                place = result.scenario, verdict.id
                self._margins.setdefault(place, []).append(margin)
                best = self._best.setdefault(place, [])
                if not best or margin < best[-1][1]:
                    best.append((float(self._done), margin))

    def _fail(self, result: RunResult) -> None:
        """Keep a run that failed, where it is among the worst."""
        reasons = [f"{each.id}: {each.reason}" for each in result.verdicts if each.is_failed]
        text = result.problem or "; ".join(reasons)
        name = f"{result.scenario} {show_point(result.values)}"
        margin = smallest_margin(result)
        badness = float("-inf") if margin is None else margin
        self._failures.append((badness, Failure(result.key, name, text, self._command(result))))
        if len(self._failures) > 2 * MOST_ITEMS:
            self._failures = sorted(self._failures, key=lambda each: each[0])[:MOST_ITEMS]

    def _keep(self, result: RunResult, verdict: Verdict) -> None:
        """Keep a verdict where none of its requirement has been worse."""
        margin = verdict.decided_margin
        badness = WORST_FIRST.index(RequirementOutcome(verdict.outcome)), size_of(verdict)
        place = result.scenario, verdict.id
        if place in self._worst and self._worst[place][0] <= badness:
            return
        text = "" if margin is None else f"smallest margin {100.0 * margin:+.0f} % of the tolerance"
        if result.values:
            text += f" at {show_point(result.values)}"
        item = WorkItem(f"{result.scenario} {verdict.id}", verdict.outcome, text.strip())
        self._worst[place] = badness, item


# Arguments that `campaign` and `falsify` share, and their runs as they are counted.


def add_jobs_argument(parser: argparse.ArgumentParser) -> None:
    """Add --jobs."""
    parser.add_argument(
        "--jobs",
        type=count_from_zero,
        metavar="N",
        default=count_processors(),
        help="number of processes (default: %(default)s); 0 runs in this one, without time-outs",
    )


def count_runs(work: Work) -> Note:
    """Return a function that counts the runs of a campaign or a search, and those that fail."""
    failures = 0

    def note(result: RunResult | None) -> None:
        nonlocal failures
        work.done += 1
        if result is not None and result.outcome.is_failure:
            failures += 1
            work.remark = f"{failures} failed"

    return note
