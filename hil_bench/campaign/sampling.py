"""Points of a space: grid, Sobol, Latin hypercube, Monte Carlo."""

from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from itertools import product

import numpy as np

from hil_bench.campaign.distributions import Distribution, Floats

Point = dict[str, float]
"""A value of each parameter, in its own unit."""

_LARGEST_POWER = 24


class Sampler(StrEnum):
    """How points are chosen."""

    GRID = "grid"
    SOBOL = "sobol"
    LATIN_HYPERCUBE = "latin_hypercube"
    MONTE_CARLO = "monte_carlo"


def sample(
    space: Mapping[str, Distribution], sampler: Sampler, count: int, seed: int, *, levels: int = 5
) -> Iterator[Point]:
    """Yield points of a space, the same ones for the same arguments.

    The first points of a longer Sobol or Monte Carlo sample are those of a shorter one.

    Args:
        space: the distribution of each parameter.
        sampler: how points are chosen.
        count: how many; a grid has as many as it has.
        seed: of the random generator.
        levels: of a grid, values a parameter.
    """
    names = list(space)
    if not names:
        yield {}
    elif sampler is Sampler.GRID:
        axes = [space[name].levels(levels).tolist() for name in names]
        for values in product(*axes):
            yield dict(zip(names, values, strict=True))
    else:
        shares = unit_points(sampler, count, len(names), seed)
        yield from points_at(space, shares)


def points_at(space: Mapping[str, Distribution], shares: Floats) -> Iterator[Point]:
    """Yield the points whose quantiles are the rows of a table.

    Args:
        space: the distribution of each parameter.
        shares: from 0 to 1, shape (points, parameters).
    """
    columns = [each.quantiles(shares[:, place]) for place, each in enumerate(space.values())]
    for row in zip(*columns, strict=True):
        yield {name: float(value) for name, value in zip(space, row, strict=True)}


def unit_points(sampler: Sampler, count: int, dimensions: int, seed: int) -> Floats:
    """Return points of the unit cube, shape (count, dimensions).

    Args:
        sampler: any but the grid.
        count: how many.
        dimensions: of the cube.
        seed: of the random generator.
    """
    generator = np.random.default_rng(seed)
    if sampler is Sampler.MONTE_CARLO:
        return generator.random((count, dimensions))
    from scipy.stats import qmc  # noqa: PLC0415 - an extra, and slow to import

    if sampler is Sampler.LATIN_HYPERCUBE:
        return np.asarray(qmc.LatinHypercube(dimensions, rng=generator).random(count))
    engine = qmc.Sobol(dimensions, scramble=True, rng=generator, bits=_LARGEST_POWER + 6)
    power = max(count - 1, 0).bit_length()  # whole powers of two keep the balance of the points
    return np.asarray(engine.random_base2(power))[:count]


def grid_size(space: Sequence[Distribution], levels: int) -> int:
    """Return how many points a grid has."""
    size = 1
    for each in space:
        size *= len(each.levels(levels))
    return size
