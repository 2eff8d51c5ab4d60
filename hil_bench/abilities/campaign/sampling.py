"""Points of a space: grid, Sobol, Latin hypercube, Monte Carlo, Saltelli."""

import math
from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from itertools import product

import numpy as np

from hil_bench.abilities.campaign.distributions import Distribution, Floats

Point = dict[str, float]
"""A value of each parameter, in its own unit."""

_LARGEST_POWER = 24


class Sampler(StrEnum):
    """The methods of choosing points."""

    GRID = "grid"
    SOBOL = "sobol"
    LATIN_HYPERCUBE = "latin_hypercube"
    MONTE_CARLO = "monte_carlo"
    SALTELLI = "saltelli"


def sample(
    space: Mapping[str, Distribution], sampler: Sampler, count: int, seed: int, *, levels: int = 5
) -> Iterator[Point]:
    """Yield points of a space, the same ones for the same arguments.

    The first points of a longer Sobol, Monte Carlo or Saltelli sample are those of a shorter one.

    Args:
        space: the distribution of each parameter.
        sampler: how points are chosen.
        count: how many; a grid has as many as it has, Saltelli's design `size_of_sample`.
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
    elif sampler is Sampler.SALTELLI:
        yield from points_at(space, _saltelli_points(count, len(names), seed))
    else:
        yield from points_at(space, unit_points(sampler, count, len(names), seed))


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
        sampler: Sobol, Latin hypercube or Monte Carlo.
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


def size_of_sample(space: Sequence[Distribution], sampler: Sampler, count: int, levels: int) -> int:
    """Return the number of points that `sample` yields."""
    if not space:
        return 1
    match sampler:
        case Sampler.GRID:
            return math.prod(len(each.levels(levels)) for each in space)
        case Sampler.SALTELLI:
            return count * (len(space) + 2)
        case _:
            return count


def _saltelli_points(count: int, dimensions: int, seed: int) -> Floats:
    """Return the design of Saltelli et al. (2010) for Sobol indices.

    Each of `count` blocks has a point A, a point B, and for each parameter A with that of B.

    Returns:
        Points of the unit cube, shape (count * (dimensions + 2), dimensions).
    """
    pairs = unit_points(Sampler.SOBOL, count, 2 * dimensions, seed)
    first, second = pairs[:, :dimensions], pairs[:, dimensions:]
    blocks = np.repeat(first[:, np.newaxis, :], dimensions + 2, axis=1)
    blocks[:, 1, :] = second
    for place in range(dimensions):
        blocks[:, place + 2, place] = second[:, place]
    return blocks.reshape(-1, dimensions)
