"""From a scenario to its failures, each made small and written down; or to how sure one can be."""

import shlex
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from hil_bench.abilities.campaign.plan import (
    fix_parameters,
    make_spec,
    no_range,
    own_case,
    space_of,
)
from hil_bench.abilities.campaign.records import Case, RunResult, RunSpec
from hil_bench.abilities.campaign.search import (
    ALL_METHODS,
    Budget,
    Find,
    Method,
    Searcher,
    SearchResult,
    Trial,
)
from hil_bench.abilities.campaign.shrink import (
    Files,
    Run,
    Shrunk,
    Target,
    as_found,
    load_failure,
    shrink,
    write_failure,
)
from hil_bench.abilities.campaign.snapshot import Backend
from hil_bench.abilities.campaign.store import Store, run_key
from hil_bench.abilities.campaign.summary import show_point, tally_of
from hil_bench.abilities.campaign.table import Note
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.records import Scenario
from hil_bench.errors import ConfigError

# The runs of a search that was interrupted, kept until the same search has come to its end.


class KeptRuns:
    """Does runs, but those that an earlier search has left.

    Args:
        backend: does the runs.
        parent: the folder that the kept runs have a folder in.
        case: what is searched; after a change of scenario, its parameters, bench or firmware it is
            another one.

    Attributes:
        folder: where runs are kept; only there between an interruption and the end of the search.
    """

    def __init__(self, backend: Backend, parent: Path, case: Case) -> None:
        fixed = {each.name: each.value for each in case.scenario.parameters}
        digest = run_key(case.digest, fixed, {}, None)
        self.folder = parent / f"{case.name}.{digest[:8]}.interrupted"
        self._backend = backend
        self._done: dict[str, RunResult] = {}
        if self.folder.is_dir():
            self._done = {each.key: each for each in Store(self.folder, {}).results()}
        self._fresh: dict[str, RunResult] = {}  # a run may come twice, as while a failure is shrunk

    def __call__(self, specs: Iterable[RunSpec]) -> Iterator[RunResult]:
        """Do runs, as a `Backend`.

        Yields:
            What came of each: of those that were done before, at once.
        """
        missing = []
        for spec in specs:
            if spec.key in self._done:
                yield self._done[spec.key]
            else:
                missing.append(spec)
        for result in self._backend(missing):
            self._fresh.setdefault(result.key, result)
            yield result

    def keep(self) -> str:
        """Write the runs of this search beside those of earlier ones; return why that failed."""
        try:
            if self._fresh:
                Store(self.folder, {}).write(list(self._fresh.values()))
        except ConfigError as error:
            return str(error)
        return ""

    def drop(self) -> str:
        """Remove the folder, since the search has come to its end."""
        shutil.rmtree(self.folder, ignore_errors=True)
        return ""


# From a scenario to its failures, each made small and written down; or to how sure one can be.


class SearchPlan(NamedTuple):
    """The settings of a search.

    Attributes:
        methods: one after the other.
        budget: how long.
        seed: of the random generators.
        timeout: how long a run may take [s].
        ends_at_failure: whether to end when all requirements have failed.
        given: values of parameters, which then do not vary.
    """

    methods: Sequence[Method] = ALL_METHODS
    budget: Budget = Budget()
    seed: int = 0
    timeout: float = 60.0
    ends_at_failure: bool = False
    given: Mapping[str, float] = MappingProxyType({})


class Failure(NamedTuple):
    """A failure, made small.

    Attributes:
        target: what fails.
        trial: that showed it.
        shrunk: the same, small; None where it did not fail again.
        files: where it stands; None where it was not written.
        problem: why it was not written.
    """

    target: Target
    trial: Trial
    shrunk: Shrunk | None
    files: Files | None
    problem: str = ""


class Falsification(NamedTuple):
    """The outcome of a search.

    Attributes:
        case: what was searched.
        plan: how.
        search: what it found.
        failures: the failures, small.
        is_interrupted: whether Ctrl-C or a signal ended it.
        problem: why its runs are not kept; empty where they are, or need not be.
    """

    case: Case
    plan: SearchPlan
    search: SearchResult
    failures: tuple[Failure, ...]
    is_interrupted: bool
    problem: str

    def lines(self) -> Iterator[str]:
        """Yield what was found, for people."""
        for find in self.search.finds:
            yield f"{find.id}: {self._what(find)}"
        for failure in self.failures:
            yield from _failure_lines(failure)

    def _what(self, find: Find) -> str:
        at = show_point(find.worst.point) if find.worst else ""
        reason = _reason(find)
        if find.is_failed:
            firsts = ", ".join(f"{number} of {method}" for method, number in find.first.items())
            return f"fails at {at}: {reason}; first in run {firsts}"
        if not find.tally.decided:
            return f"was never decided: {find.tally.runs_text()}; nothing is known of it"
        said = f"{find.tally.failures_text()}; smallest margin at {at}: {reason}"
        random = tally_of(find.id, (each.result for each in self.search.of(Method.RANDOM)))
        if not random.runs:
            return said
        return f"{said}; {random.bound_text()} ({random.runs_text('random runs')})"


def falsify(
    path: Path, plan: SearchPlan, backend: Backend, folder: Path, note: Note
) -> Falsification:
    """Search a scenario for failures.

    A KeyboardInterrupt ends the search. What was found until then is returned, and written where it
    is a failure; the runs are kept in the folder, and the same search goes on from there.

    Args:
        path: of the scenario.
        plan: how to search.
        backend: does the runs.
        folder: where failures go, made small.
        note: is told of each result of the search.

    Raises:
        ConfigError: nothing in the scenario varies.
    """
    scenario = fix_parameters(load_scenario(path), plan.given)
    space = space_of(scenario)
    if not space:
        raise ConfigError(no_range(scenario))
    case = own_case(scenario)
    kept = KeptRuns(backend, folder, case)
    searcher = Searcher(case, space, kept, plan.timeout, note)
    found = searcher.search(
        plan.methods, plan.budget, plan.seed, ends_at_failure=plan.ends_at_failure
    )
    failures: list[Failure] = []
    is_interrupted = found.is_interrupted
    for target, trial in _to_shrink(found):
        if is_interrupted:
            shrunk: Shrunk | None = as_found(scenario, trial, target)
        else:
            shrunk = shrink(scenario, trial, target, partial(_play, kept, plan.timeout))
            is_interrupted = shrunk is not None and shrunk.is_interrupted
        failures.append(_write(target, trial, shrunk, folder))
        if not is_interrupted:
            is_interrupted = not _check(failures[-1], partial(_play, backend, plan.timeout))
    problem = kept.keep() if is_interrupted else kept.drop()
    return Falsification(case, plan, found, tuple(failures), is_interrupted, problem)


def _to_shrink(found: SearchResult) -> Iterator[tuple[Target, Trial]]:
    if found.crashes:
        crash = found.crashes[0]
        yield Target("", crash.result.outcome), crash
    for find in found.finds:
        if find.is_failed and find.worst is not None:
            yield Target(find.id), find.worst


def _play(backend: Backend, timeout: float, scenario: Scenario) -> RunResult:
    """Play a scenario with the values of its file."""
    (result,) = backend([make_spec(own_case(scenario), {}, {}, None, timeout)])
    return result


def _write(target: Target, trial: Trial, shrunk: Shrunk | None, folder: Path) -> Failure:
    """Return a failure with its files; what cannot be written is said of it, and no error."""
    if shrunk is None:
        return Failure(target, trial, None, None)
    try:
        files = write_failure(shrunk, target, folder, (trial.method, trial.number))
    except ConfigError as error:
        return Failure(target, trial, shrunk, None, str(error))
    return Failure(target, trial, shrunk, files)


def _check(failure: Failure, run: Run) -> bool:
    """Return True if a failure was played again from its file; False where that was interrupted.

    Raises:
        ConfigError: it does not fail as it did.
    """
    if failure.files is None or failure.shrunk is None:
        return True
    try:
        again, before = run(load_failure(failure.files)), failure.shrunk.result
    except KeyboardInterrupt:
        return False
    if again.verdicts != before.verdicts or again.outcome is not before.outcome:
        right = "is the controller random?"
        raise ConfigError(f"{failure.files.scenario}: does not fail as it did; {right}")
    return True


def _reason(find: Find) -> str:
    if find.worst is None:
        return "no run was decided"
    return next(each.reason for each in find.worst.result.verdicts if each.id == find.id)


def _failure_lines(failure: Failure) -> Iterator[str]:
    name = failure.target.requirement or "a run that does not come to its end"
    if not failure.target.requirement:
        yield f"{failure.trial.result.outcome}: {failure.trial.result.problem.splitlines()[0]}"
    if failure.shrunk is None:
        yield f"  {name}: did not fail by itself again; is the controller random?"
        return
    small = failure.shrunk.scenario
    size = f"{small.duration:g} s, {len(small.steps)} steps"
    so_far = ", and interrupted" if failure.shrunk.is_interrupted else ""
    yield f"  {name}: shrunk in {failure.shrunk.runs} runs to {size}{so_far}"
    if failure.files is not None:
        yield f"  repeat it: hil-bench test {shlex.quote(str(failure.files.scenario))}"
    else:
        yield f"  not written: {failure.problem}"
