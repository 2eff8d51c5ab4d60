"""Summary of a campaign's results: by requirement, by parameter, and the worst run."""

import math
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from hil_bench.abilities.campaign.confidence import Tally
from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.records import RunOutcome, RunResult, Verdict
from hil_bench.abilities.campaign.sampling import Point, Sampler
from hil_bench.abilities.campaign.store import set_words
from hil_bench.abilities.scenario.judgement import RequirementOutcome

_FEWEST = 10  # runs for a correlation
_WORST = 10
_WORST_FIRST = tuple(reversed(RunOutcome))
_FAILURES = {each.value for each in RunOutcome if each.is_failure}


class RequirementSummary(NamedTuple):
    """The summary of all runs for a requirement.

    Attributes:
        scenario: its name.
        id: of the requirement.
        outcomes: how many runs had each; of those that did not come to their end, the run's own.
        margins: of the decided runs whose margin has a size.
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
        """The number of runs that failed the requirement."""
        return self.outcomes.get(RequirementOutcome.FAILED, 0)

    @property
    def tally(self) -> Tally:
        """The runs by what they say of it."""
        return _tally_verdicts(Counter(self.outcomes).elements())

    def line(self) -> str:
        """Return it in a line."""
        counts = ", ".join(f"{count} {outcome}" for outcome, count in self.outcomes.items())
        line = f"{self.scenario}  {self.id}: {counts}"
        if self.worst is not None:
            line += f"; smallest margin {min(self.margins):+.2g} of the tolerance at "
            line += show_point(self.worst.values)
        elif not self.tally.decided:
            line += "; no run was decided, so nothing is known of it"
        if self.seen is not None and self.seen < 1.0:
            line += f"; seen at least {100.0 * self.seen:.3g} % of its time"
        return line


class Correlation(NamedTuple):
    """The rank correlation of a parameter and a margin.

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
    """Summarise the runs for each requirement, in the order of the files."""
    names = dict.fromkeys((each.scenario, one.id) for each in results for one in each.verdicts)
    return [_summary(*name, results) for name in names]


def tally_of(requirement: str, results: Iterable[RunResult]) -> Tally:
    """Count the runs of a scenario by what they say of a requirement."""
    return _tally_verdicts(each.outcome_of(requirement) for each in results)


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
    """Return the worst runs: by outcome, an undecided one before a passed one, then by margin."""

    def order(each: RunResult) -> tuple[int, float, str]:
        margin = smallest_margin(each)
        return _WORST_FIRST.index(each.outcome), math.inf if margin is None else margin, each.key

    return sorted(results, key=order)[:count]


def smallest_margin(result: RunResult) -> float | None:
    """Return the smallest margin of the requirements that a run decided; None without any."""
    known = (each.decided_margin for each in result.verdicts)
    return min((each for each in known if each is not None), default=None)


def size_of(verdict: Verdict) -> float:
    """Return the margin of a verdict; of one without a size, -1 for failed and 1 for all else."""
    if verdict.margin is not None:
        return verdict.margin
    return -1.0 if verdict.is_failed else 1.0


def bounds_of(plan: Plan, results: Sequence[RunResult]) -> Iterator[str]:
    """Yield the bound on the failure probability of each scenario, where runs are independent.

    A run failed where one of its requirements did, or where it did not come to its end; it passed
    where all of them did. Any other is not decided; each requirement then has a bound of its own.
    """
    campaign = plan.campaign
    if campaign.sampler is not Sampler.MONTE_CARLO or campaign.benches or campaign.firmware:
        return
    if campaign.seeds:
        return
    for scenario in dict.fromkeys(each.scenario for each in results):
        of_it = [each for each in results if each.scenario == scenario]
        tally = Tally.of((each.outcome.value for each in of_it), RunOutcome.PASSED, _FAILURES)
        yield f"{scenario}: {tally.failures_text()}; {tally.bound_text()}"
        own = summarise(of_it) if tally.undecided else []
        for each in own if len(own) > 1 else ():
            tally = each.tally
            yield f"{scenario}  {each.id}: {tally.failures_text()}; {tally.bound_text()}"


def count_outcomes(results: Sequence[RunResult]) -> dict[str, int]:
    """Count the runs of each outcome, in one order."""
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
        words += set_words({**plan.campaign.given, **result.values})
        words += [] if result.seed is None else [f"--seed={result.seed}"]
    else:
        words = ["hil-bench", "campaign", str(plan.campaign.path), f"--run={result.key}"]
        words += set_words(plan.campaign.given)
    return shlex.join(words)


def show_point(values: Point) -> str:
    """Return values as a line has them."""
    return ", ".join(f"{name}={value:.5g}" for name, value in values.items()) or "all runs"


def _summary(scenario: str, requirement: str, results: Sequence[RunResult]) -> RequirementSummary:
    of_it = [each for each in results if each.scenario == scenario]
    counts = Counter(each.outcome_of(requirement) for each in of_it)
    names = dict.fromkeys(each.value for each in (*RequirementOutcome, *RunOutcome))
    outcomes = {name: counts[name] for name in names if counts[name]}
    sized = [
        (margin, result)
        for result in of_it
        if (verdict := result.verdict_on(requirement)) is not None
        and (margin := verdict.decided_margin) is not None
    ]
    worst = min(sized, key=lambda each: each[0])[1] if sized else None
    margins = tuple(margin for margin, _ in sized)
    verdicts = [verdict for each in of_it if (verdict := each.verdict_on(requirement)) is not None]
    seen = min((each.seen for each in verdicts if each.seen is not None), default=None)
    return RequirementSummary(scenario, requirement, outcomes, margins, worst, seen)


def _tally_verdicts(outcomes: Iterable[str]) -> Tally:
    return Tally.of(outcomes, RequirementOutcome.PASSED, {RequirementOutcome.FAILED})


def _pairs(results: Sequence[RunResult], requirement: str, name: str) -> list[tuple[float, float]]:
    return [
        (result.values[name], margin)
        for result in results
        if (verdict := result.verdict_on(requirement)) is not None
        and (margin := verdict.decided_margin) is not None
        and name in result.values
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
