"""The search for values for which a requirement fails: its cost, its methods, its records."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from time import monotonic
from typing import Any, NamedTuple, Protocol

import numpy as np

from hil_bench.abilities.campaign import distributions
from hil_bench.abilities.campaign.plan import make_spec
from hil_bench.abilities.campaign.records import Case, RunResult, RunSpec, Verdict
from hil_bench.abilities.campaign.snapshot import Backend
from hil_bench.abilities.campaign.summary import Tally, size_of, tally_of
from hil_bench.abilities.campaign.table import Note

# The cost that a search minimises: the margin of the requirement of its turn.

CRASH = -2.0
"""Cost of a run that did not come to its end: it shows that something is wrong."""

UNKNOWN = 2.0
"""Cost of a requirement that was not decided, or whose trigger never came: look elsewhere."""


def cost_of(result: RunResult, wanted: Iterable[str]) -> float:
    """Return the smallest margin among some requirements.

    Margins are shares of tolerances, so that those of pressures and of positions have one scale.

    Args:
        result: of a run.
        wanted: the requirements.
    """
    if result.outcome.is_cut_off:
        return CRASH
    ids = set(wanted)
    return min((_cost(each) for each in result.verdicts if each.id in ids), default=UNKNOWN)


def turns(requirements: Sequence[str], failed: Iterable[str]) -> Sequence[Sequence[str]]:
    """Return the requirements that the restarts of a search minimise, in turn.

    First all that have not failed yet, of which the worst leads; then each of them alone, so that
    one with a small margin that never fails starves none of the others.

    Args:
        requirements: all.
        failed: those for which a failure is known.
    """
    known = set(failed)
    open_ones = [each for each in requirements if each not in known]
    if len(open_ones) < 2:
        return [open_ones or requirements]
    return [open_ones, *([each] for each in open_ones)]


def _cost(verdict: Verdict) -> float:
    size = size_of(verdict)
    return size if verdict.is_decided else max(UNKNOWN, size)


# The settings and the results of a search.


class Method(StrEnum):
    """The methods by which a search chooses its runs."""

    RANDOM = "random"
    SOBOL = "sobol"
    CMA_ES = "cma-es"


ALL_METHODS = tuple(Method)


@dataclass(frozen=True, slots=True)
class Budget:
    """The budget of a search.

    Attributes:
        runs: of each method.
        minutes: on the machine's clock, for all of them; None for no matter.
    """

    runs: int = 200
    minutes: float | None = None


class Trial(NamedTuple):
    """A run of a search.

    Attributes:
        method: that chose it.
        number: of the run among those of the method, from 1.
        point: the values of the parameters.
        result: what came of it.
    """

    method: Method
    number: int
    point: distributions.Point
    result: RunResult

    def margin(self, requirement: str) -> float | None:
        """Return the margin of a requirement, 1 or -1 without a size; None of an undecided one."""
        found = self.result.verdict_on(requirement)
        return size_of(found) if found is not None and found.is_decided else None


class Find(NamedTuple):
    """The finding of a search on a requirement.

    Attributes:
        id: of the requirement.
        first: the first failure of each method, by its number; those that found none are missing.
        worst: the trial with the smallest margin; None where no run was decided.
        margin: that margin.
        tally: the runs by what they say of it.
    """

    id: str
    first: dict[Method, int]
    worst: Trial | None
    margin: float
    tally: Tally

    @property
    def is_failed(self) -> bool:
        """True if the requirement fails anywhere."""
        return bool(self.first)


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The result of a search.

    Attributes:
        trials: in their order.
        finds: of each requirement, in the order of the file.
        is_interrupted: whether Ctrl-C or a signal ended it.
    """

    trials: tuple[Trial, ...]
    finds: tuple[Find, ...]
    is_interrupted: bool = False

    @property
    def crashes(self) -> tuple[Trial, ...]:
        """Runs that did not come to their end."""
        return tuple(
            each for each in self.trials if each.result.problem and not each.result.verdicts
        )

    def of(self, method: Method) -> tuple[Trial, ...]:
        """Return the trials of a method."""
        return tuple(each for each in self.trials if each.method is method)


# Searches that ask for points and are told their costs: random, Sobol, CMA-ES.

_SIGMA = 0.3  # of the first step in the unit cube: half of it is within reach
_FIRST = 16  # points before the first start of CMA-ES
_BATCH = 16  # points that a method without memory asks for at once
_STALE = 12  # generations of CMA-ES without a smaller cost, after which it starts anew
_HASTE = 4  # what a generation without any difference counts as
_FLAT = 1e-9


class Search(Protocol):
    """A way to choose runs."""

    def ask(self) -> distributions.Floats:
        """Return the next points of the unit cube, shape (points, parameters)."""

    def tell(self, points: distributions.Floats, results: Sequence[RunResult]) -> None:
        """Take what came of them."""


class Sampled:
    """Points that do not depend on what came of others: random or Sobol's.

    Args:
        sampler: which.
        count: how many there are to be.
        dimensions: of the cube.
        seed: of the random generator.
    """

    def __init__(
        self, sampler: distributions.Sampler, count: int, dimensions: int, seed: int
    ) -> None:
        self._batches = iter(_batches(distributions.unit_points(sampler, count, dimensions, seed)))

    def ask(self) -> distributions.Floats:
        """Return the next points."""
        return next(self._batches)

    def tell(self, points: distributions.Floats, results: Sequence[RunResult]) -> None:
        """Forget them."""


class Evolution:
    """CMA-ES with restarts (Hansen 2016, arXiv 1604.00772), each about other requirements.

    It begins with points that fill the space evenly. A start is at the best point that is known for
    its requirements, and in every second round of turns at a random one.

    Args:
        requirements: all.
        dimensions: of the cube.
        seed: of the random generators.
    """

    def __init__(self, requirements: Sequence[str], dimensions: int, seed: int) -> None:
        self._requirements = tuple(requirements)
        self._dimensions = dimensions
        self._generator = np.random.default_rng(seed)
        self._known: list[tuple[distributions.Floats, RunResult]] = []
        self._failed: set[str] = set()
        self._starts = 0
        self._wanted: Sequence[str] = self._requirements
        self._best, self._stale = math.inf, 0
        self._cma: Any = None
        first_seed = int(self._generator.integers(2**31))
        self._first = distributions.unit_points(
            distributions.Sampler.SOBOL, _FIRST, dimensions, first_seed
        )

    def ask(self) -> distributions.Floats:
        """Return the next generation."""
        if self._cma is None:
            return self._first
        size = self._cma.population_size
        return np.array([self._cma.ask() for _ in range(size)])

    def tell(self, points: distributions.Floats, results: Sequence[RunResult]) -> None:
        """Take what came of them; start anew where that leads nowhere."""
        costs = [cost_of(each, self._wanted) for each in results]
        self._known += zip(points, results, strict=True)
        news = set(failures(results)) - self._failed
        self._failed |= news
        if self._cma is None:
            self._start(self._best_known())
            return
        if len(costs) < self._cma.population_size:
            return  # the last generation, cut off by the budget
        self._cma.tell(list(zip(points, costs, strict=True)))
        is_flat = max(costs) - min(costs) < _FLAT  # as where another requirement leads
        self._stale += _HASTE if is_flat else 1
        if min(costs) < self._best - _FLAT:
            self._best, self._stale = min(costs), 0
        if news & {*self._wanted} or self._cma.should_stop() or self._stale >= _STALE:
            self._restart()

    def _restart(self) -> None:
        self._starts += 1
        found = turns(self._requirements, self._failed)
        self._wanted = found[self._starts % len(found)]
        if self._starts // len(found) % 2:
            self._start(self._generator.random(self._dimensions))
        else:
            self._start(self._best_known())

    def _best_known(self) -> distributions.Floats:
        """Return the best point for the requirements of this turn."""
        return min(self._known, key=lambda each: cost_of(each[1], self._wanted))[0]

    def _start(self, mean: distributions.Floats) -> None:
        from cmaes import CMA  # noqa: PLC0415 - an extra

        self._best, self._stale = math.inf, 0
        bounds = np.tile([0.0, 1.0], (self._dimensions, 1))
        seed = int(self._generator.integers(2**31))
        self._cma = CMA(mean, _SIGMA, bounds=bounds, seed=seed)


def build_search(
    method: Method, requirements: Sequence[str], dimensions: int, count: int, seed: int
) -> Search:
    """Return a search.

    Args:
        method: which.
        requirements: what it is about.
        dimensions: how many parameters there are.
        count: how many runs.
        seed: of the random generators.
    """
    match method:
        case Method.RANDOM:
            return Sampled(distributions.Sampler.MONTE_CARLO, count, dimensions, seed)
        case Method.SOBOL:
            return Sampled(distributions.Sampler.SOBOL, count, dimensions, seed)
        case Method.CMA_ES:
            return Evolution(requirements, dimensions, seed)


def failures(results: Sequence[RunResult]) -> Iterator[str]:
    """Yield the requirements that fail in some runs."""
    for result in results:
        for verdict in result.verdicts:
            if verdict.is_failed:
                yield verdict.id


def _batches(points: distributions.Floats) -> Iterator[distributions.Floats]:
    for start in range(0, len(points), _BATCH):
        yield points[start : start + _BATCH]


# A search: methods one after the other, each with its runs.


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
        space: dict[str, distributions.Distribution],
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
        is_interrupted = False
        try:
            for number, method in enumerate(methods):
                share = (until - monotonic()) / (len(methods) - number)
                before = len(trials)
                for trial in self.trials(method, budget.runs, seed, monotonic() + share):
                    trials.append(trial)
                    is_over = ends_at_failure and not self._is_interrupted
                    if is_over and self._all_failed(trials[before:]):
                        break
        except KeyboardInterrupt:
            is_interrupted = True
        finds = tuple(_find(each, trials) for each in self._requirements)
        return SearchResult(tuple(trials), finds, is_interrupted)

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
            points = list(distributions.points_at(self._space, shares))
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
    points: Sequence[distributions.Point],
    specs: Sequence[RunSpec],
    found: Mapping[str, RunResult],
) -> Iterator[Trial]:
    for number, (point, spec) in enumerate(zip(points, specs, strict=True), before + 1):
        if spec.key in found:
            yield Trial(method, number, point, found[spec.key])


def _find(requirement: str, trials: Sequence[Trial]) -> Find:
    first: dict[Method, int] = {}
    worst, least = None, (True, math.inf)
    for trial in trials:
        verdict = trial.result.verdict_on(requirement)
        if verdict is None or not verdict.is_decided:
            continue
        if verdict.is_failed:
            first.setdefault(trial.method, trial.number)
        badness = not verdict.is_failed, size_of(verdict)  # failed ones first, then by margin
        if badness < least:
            worst, least = trial, badness
    tally = tally_of(requirement, (each.result for each in trials))
    return Find(requirement, first, worst, least[1], tally)
