"""What the results of a campaign say: of each requirement, of each parameter, and the worst."""

import math
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from hil_bench.campaign.confidence import say_bound
from hil_bench.campaign.plan import Plan
from hil_bench.campaign.records import RunOutcome, RunResult, Verdict, is_exercised
from hil_bench.campaign.sampling import Point, Sampler
from hil_bench.scenario.judgement import RequirementOutcome

_FEWEST = 10  # runs for a correlation
_WORST = 10


class RequirementSummary(NamedTuple):
    """What all runs say of a requirement.

    Attributes:
        scenario: its name.
        id: of the requirement.
        outcomes: how many runs had each.
        margins: of the runs that have one.
        worst: the run with the smallest; None where none has one.
        seen: the smallest share of its time that a run showed, 0 to 1; None where none says it.
    """

    scenario: str
    id: str
    outcomes: Mapping[str, int]
    margins: tuple[float, ...]
    worst: RunResult | None
    seen: float | None

    @property
    def failures(self) -> int:
        """How many runs failed it."""
        return self.outcomes.get(RequirementOutcome.FAILED, 0)

    @property
    def is_exercised(self) -> bool:
        """Whether any run came to its trigger and its end."""
        return any(map(is_exercised, self.outcomes))

    def line(self) -> str:
        """Return it in a line."""
        counts = ", ".join(f"{count} {outcome}" for outcome, count in self.outcomes.items())
        line = f"{self.scenario}  {self.id}: {counts}"
        if self.worst is not None:
            line += f"; smallest margin {min(self.margins):+.2g} of the tolerance at "
            line += show_point(self.worst.values)
        elif not self.is_exercised:
            line += "; no run came to its trigger, so nothing is known of it"
        if self.seen is not None and self.seen < 1.0:
            line += f"; seen at least {100.0 * self.seen:.3g} % of its time"
        return line


class Correlation(NamedTuple):
    """How a parameter and a margin rise and fall together.

    Attributes:
        scenario: its name.
        requirement: whose margin.
        parameter: which.
        rank: Spearman's coefficient, -1 to 1.
        runs: how many there were.
    """

    scenario: str
    requirement: str
    parameter: str
    rank: float
    runs: int


def summarise(results: Sequence[RunResult]) -> list[RequirementSummary]:
    """Return what the runs say of each requirement, in the order of the files."""
    grouped: dict[tuple[str, str], list[tuple[RunResult, Verdict]]] = {}
    for result in results:
        for verdict in result.verdicts:
            grouped.setdefault((result.scenario, verdict.id), []).append((result, verdict))
    return [_summary(*name, found) for name, found in grouped.items()]


def correlations(results: Sequence[RunResult]) -> list[Correlation]:
    """Return the rank correlation of each parameter with each margin, the strongest first."""
    found = []
    for scenario in dict.fromkeys(each.scenario for each in results):
        of_it = [each for each in results if each.scenario == scenario]
        names = dict.fromkeys(name for each in of_it for name in each.values)
        ids = dict.fromkeys(one.id for each in of_it for one in each.verdicts)
        for requirement in ids:
            for name in names:
                pairs = _pairs(of_it, requirement, name)
                rank = _rank_correlation(pairs)
                if rank is not None:
                    found.append(Correlation(scenario, requirement, name, rank, len(pairs)))
    return sorted(found, key=lambda each: -abs(each.rank))


def worst_runs(results: Sequence[RunResult], count: int = _WORST) -> list[RunResult]:
    """Return the worst runs: those that did not come to their end, then by margin."""
    return sorted(results, key=lambda each: (severity(each), each.key))[:count]


def severity(result: RunResult) -> float:
    """Return the smallest margin of a run; less than any for one that did not come to its end."""
    if result.outcome.is_cut_off:
        return -math.inf
    return min((size_of(each) for each in result.verdicts), default=math.inf)


def size_of(verdict: Verdict) -> float:
    """Return the margin of a verdict; of one without a size, -1 for failed and 1 for all else."""
    if verdict.margin is not None:
        return verdict.margin
    return -1.0 if verdict.is_failed else 1.0


def bounds_of(plan: Plan, results: Sequence[RunResult]) -> Iterator[str]:
    """Yield the bound on the failure probability of each scenario, where runs are independent."""
    campaign = plan.campaign
    if campaign.sampler is not Sampler.MONTE_CARLO or campaign.benches or campaign.firmware:
        return
    if campaign.seeds:
        return
    for scenario in dict.fromkeys(each.scenario for each in results):
        of_it = [each for each in results if each.scenario == scenario]
        failures = sum(each.outcome.is_failure for each in of_it)
        passed = failures or "no"
        word = "failure" if failures in {0, 1} else "failures"
        yield f"{scenario}: {passed} {word} in {len(of_it)} runs; {say_bound(failures, len(of_it))}"


def count_outcomes(results: Sequence[RunResult]) -> dict[str, int]:
    """Return how many runs had each outcome, in one order."""
    found = Counter(each.outcome for each in results)
    return {outcome.value: found[outcome] for outcome in RunOutcome if found[outcome]}


def command_of(plan: Plan, result: RunResult) -> str:
    """Return the command that repeats a run."""
    paths = {group.case.name: group.case.scenario.path for group in plan.groups}
    path = paths[result.scenario]
    spaces = {name for group in plan.groups for name in group.space}
    is_plain = not result.bench and not result.firmware and set(result.values) <= spaces
    if is_plain:
        words = ["hil-bench", "test", str(path)]
        words += [f"--set={name}={value!r}" for name, value in result.values.items()]
        words += [] if result.seed is None else [f"--seed={result.seed}"]
    else:
        words = ["hil-bench", "campaign", str(plan.campaign.path), f"--run={result.key}"]
    return shlex.join(words)


def show_point(values: Point) -> str:
    """Return values as a line has them."""
    return ", ".join(f"{name}={value:.5g}" for name, value in values.items()) or "all runs"


def _summary(
    scenario: str, requirement: str, found: Sequence[tuple[RunResult, Verdict]]
) -> RequirementSummary:
    counts = Counter(verdict.outcome for _, verdict in found)
    outcomes = {each.value: counts[each.value] for each in RequirementOutcome if counts[each.value]}
    sized = [(verdict.margin, result) for result, verdict in found if verdict.margin is not None]
    worst = min(sized, key=lambda each: each[0])[1] if sized else None
    margins = tuple(margin for margin, _ in sized)
    seen = min((each.seen for _, each in found if each.seen is not None), default=None)
    return RequirementSummary(scenario, requirement, outcomes, margins, worst, seen)


def _pairs(results: Sequence[RunResult], requirement: str, name: str) -> list[tuple[float, float]]:
    return [
        (result.values[name], verdict.margin)
        for result in results
        for verdict in result.verdicts
        if verdict.id == requirement and verdict.margin is not None and name in result.values
    ]


def _rank_correlation(pairs: Sequence[tuple[float, float]]) -> float | None:
    """Return Spearman's coefficient; None where there are too few runs, or nothing varies."""
    from scipy.stats import rankdata  # noqa: PLC0415 - an extra, and slow to import

    if len(pairs) < _FEWEST:
        return None
    ranks = [rankdata(column) for column in zip(*pairs, strict=True)]
    if any(float(np.ptp(each)) == 0.0 for each in ranks):
        return None
    return float(np.corrcoef(*ranks)[0, 1])
