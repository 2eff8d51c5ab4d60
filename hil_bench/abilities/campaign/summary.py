"""The summary of a campaign, its bounds of confidence, and its comparison with another."""

import math
import shlex
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple, Self

import numpy as np

from hil_bench.abilities.campaign.distributions import Point, Sampler
from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.records import RunOutcome, RunResult, Verdict
from hil_bench.abilities.campaign.store import set_words
from hil_bench.abilities.scenario.judgement import RequirementOutcome, show_seen, show_share
from hil_bench.abilities.scenario.results import UNJUDGED
from hil_bench.errors import ConfigError

# Confidence bounds on a probability after a number of runs.

CONFIDENCE = 0.95


def failure_bound(failures: int, runs: int) -> float:
    """Return the upper bound on a probability, one-sided (Clopper and Pearson, Biometrika 1934).

    It is exact for independent runs: with the true probability above it, as few failures come with
    a probability of at most 1 - `CONFIDENCE`.

    Args:
        failures: how many runs failed.
        runs: how many there were.
    """
    if failures >= runs:
        return 1.0
    if failures == 0:
        return float(1.0 - (1.0 - CONFIDENCE) ** (1.0 / runs))
    from scipy.stats import beta  # noqa: PLC0415 - an extra, and slow to import

    return float(beta.ppf(CONFIDENCE, failures + 1, runs - failures))


class Tally(NamedTuple):
    """Runs by what they say; those that are not decided bear on no probability.

    Attributes:
        passed: runs.
        failed: likewise.
        undecided: the number of all other runs by their outcome.
    """

    passed: int
    failed: int
    undecided: Mapping[str, int]

    @classmethod
    def of(cls, outcomes: Iterable[str], passing: str, failing: Container[str]) -> Self:
        """Count runs.

        Args:
            outcomes: of each run.
            passing: the outcome of a run that passed.
            failing: those of one that failed.
        """
        counts = Counter(outcomes)
        failed = sum(count for outcome, count in counts.items() if outcome in failing)
        others = {k: n for k, n in counts.items() if k != passing and k not in failing}
        return cls(counts[passing], failed, others)

    @property
    def decided(self) -> int:
        """The number of runs that passed or failed."""
        return self.passed + self.failed

    @property
    def runs(self) -> int:
        """The number of all runs."""
        return self.decided + sum(self.undecided.values())

    def runs_text(self, kind: str = "runs") -> str:
        """Say how many of how many runs are decided, as in "24 decided runs of 30 (6 crashed)"."""
        if not self.undecided:
            return f"{self.runs} {kind}"
        others = ", ".join(f"{count} {outcome}" for outcome, count in self.undecided.items())
        return f"{self.decided} decided {kind} of {self.runs} ({others})"

    def failures_text(self) -> str:
        """Say how many runs failed, of how many."""
        word = "failure" if self.failed < 2 else "failures"
        return f"{self.failed or 'no'} {word} in {self.runs_text()}"

    def bound_text(self) -> str:
        """Say the bound on the failure probability, which decided runs alone have."""
        if not self.decided:
            return "so there is no bound on the failure probability"
        of_what = " of decided runs" if self.undecided else ""
        return (
            f"{CONFIDENCE:.0%} upper bound on the failure probability{of_what} under the sampled "
            f"distribution {failure_bound(self.failed, self.decided):.2g}"
        )


# Summary of a campaign's results: by requirement, by parameter, and the worst run.

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
            line += f"; smallest margin {show_share(min(self.margins))} of the tolerance at "
            line += show_point(self.worst.values)
        elif not self.tally.decided:
            line += "; no run was decided, so nothing is known of it"
        if self.seen is not None and self.seen < 1.0:
            line += f"; seen at least {show_seen(self.seen)} of its time"
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


def unjudged_of(plan: Plan) -> Iterator[str]:
    """Yield the requirements that a scenario is about and does not judge, a line each."""
    for name, scenario in {group.case.name: group.case.scenario for group in plan.groups}.items():
        yield from (f"{name}  {one}: not judged; {UNJUDGED}" for one in scenario.unjudged)


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


# Two campaigns side by side: before and after a change of firmware, bench or program.


class Change(NamedTuple):
    """The change of a requirement between two campaigns.

    Attributes:
        scenario: its name.
        id: of the requirement.
        runs: how many both campaigns have.
        broken: runs that fail it now, and did not before.
        mended: runs that failed it before, and pass it now.
        undecided: how many runs either campaign did not decide.
        margins: median of the margins of those that both decided, before and now; None where
            there are none.
    """

    scenario: str
    id: str
    runs: int
    broken: tuple[RunResult, ...]
    mended: tuple[RunResult, ...]
    undecided: int
    margins: tuple[float, float] | None

    def line(self) -> str:
        """Return it in a line."""
        counts = f"{len(self.broken)} newly failed, {len(self.mended)} no longer"
        line = f"{self.scenario}  {self.id}: of {self.runs} common runs {counts}"
        if self.undecided:
            line += f", {self.undecided} not decided before or now"
        if self.margins is not None:
            before, now = (show_share(margin, 3) for margin in self.margins)
            line += f"; median margin {before} before, {now} now"
        if self.broken:
            line += f"; first at {show_point(self.broken[0].values)}"
        return line


def compare(before: Iterable[RunResult], now: Sequence[RunResult]) -> list[Change]:
    """Return the changes between two campaigns, requirement by requirement.

    Runs are the same where scenario, bench, seed and values are; firmware may have another name.

    Args:
        before: the results of the first campaign.
        now: of the second.

    Raises:
        ConfigError: the campaigns have no run in common.
    """
    old = {_place(each): each for each in before}
    pairs = [(old[_place(each)], each) for each in now if _place(each) in old]
    if not pairs:
        raise ConfigError("--compare: no run is in both campaigns; sample with the same seed")
    names = dict.fromkeys(
        (each.scenario, one.id)
        for pair in pairs
        for each in reversed(pair)
        for one in each.verdicts
    )
    return [_change(*name, pairs) for name in names]


def _change(
    scenario: str, requirement: str, pairs: Sequence[tuple[RunResult, RunResult]]
) -> Change:
    found = [
        (old, new, result)
        for before, result in pairs
        if result.scenario == scenario
        and (old := _verdict(before, requirement)) is not None
        and (new := _verdict(result, requirement)) is not None
    ]
    decided = [each for each in found if each[0].is_decided and each[1].is_decided]
    broken = [each for old, new, each in found if new.is_failed and not old.is_failed]
    mended = [each for old, new, each in decided if old.is_failed and not new.is_failed]
    sized = [
        (old.margin, new.margin)
        for old, new, _ in decided
        if old.margin is not None and new.margin is not None
    ]
    margins = None
    if sized:
        first, second = (float(np.median(column)) for column in zip(*sized, strict=True))
        margins = first, second
    undecided = len(found) - len(decided)
    counts = len(found), tuple(broken), tuple(mended), undecided
    return Change(scenario, requirement, *counts, margins)


def _verdict(result: RunResult, requirement: str) -> Verdict | None:
    """Return the verdict of a run, undecided where the run was cut off; None without such one."""
    if result.outcome.is_cut_off:
        return Verdict(requirement, result.outcome.value, None, result.problem)
    return result.verdict_on(requirement)


def _place(result: RunResult) -> tuple[object, ...]:
    return result.scenario, result.bench, result.seed, *sorted(result.values.items())
