"""Searches that ask for points and are told their costs: random, Sobol, CMA-ES."""

import math
from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import numpy as np

from hil_bench.abilities.campaign.distributions import Floats
from hil_bench.abilities.campaign.records import RunResult
from hil_bench.abilities.campaign.sampling import Sampler, unit_points
from hil_bench.abilities.campaign.search.cost import cost_of, turns
from hil_bench.abilities.campaign.search.records import Method

_SIGMA = 0.3  # of the first step in the unit cube: half of it is within reach
_FIRST = 16  # points before the first start of CMA-ES
_BATCH = 16  # points that a method without memory asks for at once
_STALE = 12  # generations of CMA-ES without a smaller cost, after which it starts anew
_HASTE = 4  # what a generation without any difference counts as
_FLAT = 1e-9


class Search(Protocol):
    """A way to choose runs."""

    def ask(self) -> Floats:
        """Return the next points of the unit cube, shape (points, parameters)."""

    def tell(self, points: Floats, results: Sequence[RunResult]) -> None:
        """Take what came of them."""


class Sampled:
    """Points that do not depend on what came of others: random or Sobol's.

    Args:
        sampler: which.
        count: how many there are to be.
        dimensions: of the cube.
        seed: of the random generator.
    """

    def __init__(self, sampler: Sampler, count: int, dimensions: int, seed: int) -> None:
        self._batches = iter(_batches(unit_points(sampler, count, dimensions, seed)))

    def ask(self) -> Floats:
        """Return the next points."""
        return next(self._batches)

    def tell(self, points: Floats, results: Sequence[RunResult]) -> None:
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
        self._known: list[tuple[Floats, RunResult]] = []
        self._failed: set[str] = set()
        self._starts = 0
        self._wanted: Sequence[str] = self._requirements
        self._best, self._stale = math.inf, 0
        self._cma: Any = None
        first_seed = int(self._generator.integers(2**31))
        self._first = unit_points(Sampler.SOBOL, _FIRST, dimensions, first_seed)

    def ask(self) -> Floats:
        """Return the next generation."""
        if self._cma is None:
            return self._first
        size = self._cma.population_size
        return np.array([self._cma.ask() for _ in range(size)])

    def tell(self, points: Floats, results: Sequence[RunResult]) -> None:
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

    def _best_known(self) -> Floats:
        """Return the best point for the requirements of this turn."""
        return min(self._known, key=lambda each: cost_of(each[1], self._wanted))[0]

    def _start(self, mean: Floats) -> None:
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
            return Sampled(Sampler.MONTE_CARLO, count, dimensions, seed)
        case Method.SOBOL:
            return Sampled(Sampler.SOBOL, count, dimensions, seed)
        case Method.CMA_ES:
            return Evolution(requirements, dimensions, seed)


def failures(results: Sequence[RunResult]) -> Iterator[str]:
    """Yield the requirements that fail in some runs."""
    for result in results:
        for verdict in result.verdicts:
            if verdict.is_failed:
                yield verdict.id


def _batches(points: Floats) -> Iterator[Floats]:
    for start in range(0, len(points), _BATCH):
        yield points[start : start + _BATCH]
