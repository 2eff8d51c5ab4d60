"""From a scenario to its failures, each made small and written down; or to how sure one can be."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from hil_bench.campaign.confidence import say_bound
from hil_bench.campaign.executing import Note
from hil_bench.campaign.plan import make_spec, no_range, own_case, space_of
from hil_bench.campaign.pool import Backend
from hil_bench.campaign.records import Case, RunResult
from hil_bench.campaign.search.records import (
    ALL_METHODS,
    Budget,
    Find,
    Method,
    SearchResult,
    Trial,
)
from hil_bench.campaign.search.search import Searcher
from hil_bench.campaign.search.shrink import Shrunk, Target, shrink
from hil_bench.campaign.search.writing import Files, load_failure, write_failure
from hil_bench.campaign.summary import show_point
from hil_bench.errors import ConfigError
from hil_bench.scenario.load import load_scenario
from hil_bench.scenario.records import Scenario


class SearchPlan(NamedTuple):
    """How to search.

    Attributes:
        methods: one after the other.
        budget: how long.
        seed: of the random generators.
        timeout: how long a run may take [s].
        ends_at_failure: whether to end when all requirements have failed.
    """

    methods: Sequence[Method] = ALL_METHODS
    budget: Budget = Budget()
    seed: int = 0
    timeout: float = 60.0
    ends_at_failure: bool = False


class Failure(NamedTuple):
    """A failure, made small.

    Attributes:
        target: what fails.
        trial: that showed it.
        shrunk: the same, small; None where it did not fail again.
        files: where it stands; None where it was not written.
    """

    target: Target
    trial: Trial
    shrunk: Shrunk | None
    files: Files | None


class Falsification(NamedTuple):
    """What came of a search.

    Attributes:
        case: what was searched.
        plan: how.
        search: what it found.
        failures: the failures, small.
    """

    case: Case
    plan: SearchPlan
    search: SearchResult
    failures: tuple[Failure, ...]

    def lines(self) -> Iterator[str]:
        """Yield what was found, for people."""
        for find in self.search.finds:
            yield f"{find.id}: {self._what(find)}"
        for failure in self.failures:
            yield from _failure_lines(failure)

    def _what(self, find: Find) -> str:
        trials = len(self.search.trials)
        at = show_point(find.worst.point) if find.worst else ""
        reason = _reason(find)
        if find.is_failed:
            firsts = ", ".join(f"{number} of {method}" for method, number in find.first.items())
            return f"fails at {at}: {reason}; first in run {firsts}"
        if not find.is_exercised:
            return f"was never exercised in {trials} runs; nothing is known of it"
        said = f"no failure in {trials} runs; smallest margin at {at}: {reason}"
        random = self.search.of(Method.RANDOM)
        return (
            f"{said}; {say_bound(0, len(random))} ({len(random)} random runs)" if random else said
        )


def falsify(
    path: Path, plan: SearchPlan, backend: Backend, folder: Path | None, note: Note
) -> Falsification:
    """Search a scenario for failures.

    Args:
        path: of the scenario.
        plan: how to search.
        backend: does the runs.
        folder: where failures go; None for nowhere, and then they are not made small.
        note: is told of each result of the search.

    Raises:
        ConfigError: nothing in the scenario varies.
    """
    scenario = load_scenario(path)
    space = space_of(scenario)
    if not space:
        raise ConfigError(no_range(scenario))
    case = own_case(scenario)
    searcher = Searcher(case, space, backend, plan.timeout, note)
    found = searcher.search(
        plan.methods, plan.budget, plan.seed, ends_at_failure=plan.ends_at_failure
    )
    failures = tuple(
        _failure(scenario, target, trial, plan, backend, folder)
        for target, trial in _to_shrink(found)
        if folder is not None
    )
    return Falsification(case, plan, found, failures)


def _to_shrink(found: SearchResult) -> Iterator[tuple[Target, Trial]]:
    if found.crashes:
        yield Target(""), found.crashes[0]
    for find in found.finds:
        if find.is_failed and find.worst is not None:
            yield Target(find.id), find.worst


def _failure(
    scenario: Scenario,
    target: Target,
    trial: Trial,
    plan: SearchPlan,
    backend: Backend,
    folder: Path | None,
) -> Failure:
    def run(candidate: Scenario) -> RunResult:
        spec = make_spec(own_case(candidate), {}, {}, None, plan.timeout)
        (result,) = backend([spec])
        return result

    shrunk = shrink(scenario, trial.point, target, run)
    if shrunk is None or folder is None:
        return Failure(target, trial, shrunk, None)
    files = write_failure(shrunk, target, folder, (trial.method, trial.number))
    again = run(load_failure(files))
    if again.verdicts != shrunk.result.verdicts or again.outcome is not shrunk.result.outcome:
        raise ConfigError(f"{files.scenario}: does not fail as it did; is the controller random?")
    return Failure(target, trial, shrunk, files)


def _reason(find: Find) -> str:
    if find.worst is None:
        return "no run came to its end"
    return next(each.reason for each in find.worst.result.verdicts if each.id == find.id)


def _failure_lines(failure: Failure) -> Iterator[str]:
    name = failure.target.requirement or "a run that does not come to its end"
    if not failure.target.requirement:
        yield f"{failure.trial.result.outcome}: {failure.trial.result.problem.splitlines()[0]}"
    if failure.shrunk is None:
        yield f"  {name}: did not fail by itself again; is the controller random?"
    elif failure.files is not None:
        small = failure.shrunk.scenario
        size = f"{small.duration:g} s, {len(small.steps)} steps"
        yield f"  {name}: shrunk in {failure.shrunk.runs} runs to {size}"
        yield f"  repeat it: hil-bench test {failure.files.scenario}"
