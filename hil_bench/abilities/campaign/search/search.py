"""A search: methods one after the other, each with its runs."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from time import monotonic

from hil_bench.abilities.campaign.distributions import Distribution
from hil_bench.abilities.campaign.executing import Note
from hil_bench.abilities.campaign.plan import make_spec
from hil_bench.abilities.campaign.pool import Backend
from hil_bench.abilities.campaign.records import Case, RunResult, RunSpec
from hil_bench.abilities.campaign.sampling import Point, points_at
from hil_bench.abilities.campaign.search.methods import build_search
from hil_bench.abilities.campaign.search.records import Budget, Find, Method, SearchResult, Trial
from hil_bench.abilities.campaign.summary import tally_of


class Searcher:
    """Looks for values for which a requirement fails.

    Args:
        case: what is run.
        space: the distribution of each parameter.
        backend: does the runs.
        timeout: how long a run may take [s].
        note: is told of each result.
    """

    def __init__(
        self,
        case: Case,
        space: dict[str, Distribution],
        backend: Backend,
        timeout: float = 60.0,
        note: Note = lambda _result: None,
    ) -> None:
        self._case, self._space, self._backend = case, space, backend
        self._timeout, self._note = timeout, note
        self._is_interrupted = False
        self._requirements = [each.id for each in case.scenario.expectations]

    def search(
        self, methods: Sequence[Method], budget: Budget, seed: int, *, ends_at_failure: bool = False
    ) -> SearchResult:
        """Search with all methods; return the results so far where interrupted.

        Args:
            methods: one after the other.
            budget: how long.
            seed: of the random generators.
            ends_at_failure: whether a method ends when it has failed all requirements.
        """
        until = monotonic() + 60.0 * budget.minutes if budget.minutes else float("inf")
        trials: list[Trial] = []
        has_ended_early = is_interrupted = False
        try:
            for number, method in enumerate(methods):
                share = (until - monotonic()) / (len(methods) - number)
                before = len(trials)
                for trial in self.trials(method, budget.runs, seed, monotonic() + share):
                    trials.append(trial)
                    is_over = ends_at_failure and not self._is_interrupted
                    if is_over and self._all_failed(trials[before:]):
                        break
                has_ended_early |= len(trials) - before < budget.runs
        except KeyboardInterrupt:
            has_ended_early = is_interrupted = True
        finds = tuple(_find(each, trials) for each in self._requirements)
        return SearchResult(tuple(trials), finds, has_ended_early, is_interrupted)

    def trials(
        self, method: Method, runs: int, seed: int, until: float = float("inf")
    ) -> Iterator[Trial]:
        """Do the runs of a method.

        Args:
            method: which.
            runs: how many.
            seed: of its random generators.
            until: when no other batch begins, on the machine's clock [s].

        Yields:
            Each run with what came of it; of a batch that is interrupted, those that are done.

        Raises:
            KeyboardInterrupt: as it came, after these.
        """
        search = build_search(method, self._requirements, len(self._space), runs, seed)
        done = 0
        while done < runs and monotonic() < until:
            shares = search.ask()[: runs - done]
            points = list(points_at(self._space, shares))
            specs = [
                make_spec(self._case, point, self._space, None, self._timeout) for point in points
            ]
            found: dict[str, RunResult] = {}
            try:
                for result in self._backend({spec.key: spec for spec in specs}.values()):
                    found[result.key] = result
                    self._note(result)
            except KeyboardInterrupt:
                self._is_interrupted = True
                yield from _trials_of(method, done, points, specs, found)
                raise
            search.tell(shares, [found[spec.key] for spec in specs])
            yield from _trials_of(method, done, points, specs, found)
            done += len(points)

    def _all_failed(self, trials: Sequence[Trial]) -> bool:
        return all(_find(each, trials).is_failed for each in self._requirements)


def _trials_of(
    method: Method,
    before: int,
    points: Sequence[Point],
    specs: Sequence[RunSpec],
    found: Mapping[str, RunResult],
) -> Iterator[Trial]:
    for number, (point, spec) in enumerate(zip(points, specs, strict=True), before + 1):
        if spec.key in found:
            yield Trial(method, number, point, found[spec.key])


def _find(requirement: str, trials: Sequence[Trial]) -> Find:
    first: dict[Method, int] = {}
    for trial in trials:
        verdict = trial.result.verdict_on(requirement)
        if verdict is not None and verdict.is_failed:
            first.setdefault(trial.method, trial.number)
    known = [each for each in trials if each.margin(requirement) is not None]
    worst = min(known, key=_by_margin(requirement), default=None)
    margin = worst.margin(requirement) if worst else None
    tally = tally_of(requirement, (each.result for each in trials))
    return Find(requirement, first, worst, float("inf") if margin is None else margin, tally)


def _by_margin(requirement: str) -> Callable[[Trial], tuple[bool, float]]:
    """Return the order of trials: failed ones first, then by margin."""

    def order(trial: Trial) -> tuple[bool, float]:
        is_failed = any(v.is_failed for v in trial.result.verdicts if v.id == requirement)
        return not is_failed, trial.margin(requirement) or 0.0

    return order
