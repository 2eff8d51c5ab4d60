"""Distributions of parameters, and samples of them."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import product
from types import MappingProxyType
from typing import Any, Final, Protocol

import numpy as np

from hil_bench.config.values import describe, number
from hil_bench.errors import ConfigError

# Distributions of a parameter's values: quantiles, and levels for grids.

Floats = np.ndarray[Any, np.dtype[np.float64]]

Span = tuple[float, float]
"""Lowest and highest value."""


class Distribution(Protocol):
    """The distribution of a parameter's values, in its own unit."""

    def quantiles(self, shares: Floats) -> Floats:
        """Return the values below which these shares of all values lie."""

    def levels(self, count: int) -> Floats:
        """Return the values of a grid."""

    @property
    def bounds(self) -> Span:
        """Lowest and highest value; infinite for none."""


class _Between:
    """Lies between `low` and `high`."""

    __slots__ = ()
    low: float
    high: float

    @property
    def bounds(self) -> Span:
        """Lowest and highest value."""
        return self.low, self.high


@dataclass(frozen=True, slots=True)
class Uniform(_Between):
    """All values between two are equally likely."""

    low: float
    high: float

    def quantiles(self, shares: Floats) -> Floats:
        """Return the values below which these shares of all values lie."""
        return np.clip(self.low + (self.high - self.low) * shares, self.low, self.high)

    def levels(self, count: int) -> Floats:
        """Return evenly spaced values, both ends included."""
        return np.linspace(self.low, self.high, count)


@dataclass(frozen=True, slots=True)
class LogUniform(_Between):
    """All orders of magnitude between two positive values are equally likely."""

    low: float
    high: float

    def quantiles(self, shares: Floats) -> Floats:
        """Return the values below which these shares of all values lie."""
        return np.clip(self.low * (self.high / self.low) ** shares, self.low, self.high)

    def levels(self, count: int) -> Floats:
        """Return values with one ratio from each to the next, both ends included."""
        return np.geomspace(self.low, self.high, count)


@dataclass(frozen=True, slots=True)
class Normal(_Between):
    """A normal distribution, cut off at the bounds.

    Attributes:
        mean: of the distribution before it is cut off.
        deviation: its standard deviation.
        low: no value is below.
        high: no value is above.
    """

    mean: float
    deviation: float
    low: float = -math.inf
    high: float = math.inf

    def quantiles(self, shares: Floats) -> Floats:
        """Return the values below which these shares of all values lie."""
        from scipy.stats import truncnorm  # noqa: PLC0415 - an extra, and slow to import

        ends = ((end - self.mean) / self.deviation for end in (self.low, self.high))
        inner = np.clip(shares, 1e-12, 1.0 - 1e-12)  # the tails of the normal end nowhere
        found = truncnorm.ppf(inner, *ends, loc=self.mean, scale=self.deviation)
        return np.asarray(found, dtype=np.float64)

    def levels(self, count: int) -> Floats:
        """Return values with the same share of all between each and the next."""
        return _evenly(self, count)


@dataclass(frozen=True, slots=True)
class Triangular(_Between):
    """The density rises from `low` to `mode`, and falls to `high`."""

    low: float
    mode: float
    high: float

    def quantiles(self, shares: Floats) -> Floats:
        """Return the values below which these shares of all values lie."""
        width, rise, fall = self.high - self.low, self.mode - self.low, self.high - self.mode
        rising = self.low + np.sqrt(shares * width * rise)
        falling = self.high - np.sqrt((1.0 - shares) * width * fall)
        return np.where(shares * width < rise, rising, falling)

    def levels(self, count: int) -> Floats:
        """Return values with the same share of all between each and the next."""
        return _evenly(self, count)


@dataclass(frozen=True, slots=True)
class Choices:
    """Some values, all equally likely."""

    values: tuple[float, ...]

    @property
    def bounds(self) -> Span:
        """Lowest and highest value."""
        return min(self.values), max(self.values)

    def quantiles(self, shares: Floats) -> Floats:
        """Return the values below which these shares of all values lie."""
        places = np.minimum((shares * len(self.values)).astype(np.int64), len(self.values) - 1)
        return np.array(self.values, dtype=np.float64)[places]

    def levels(self, count: int) -> Floats:
        """Return all values, however many."""
        del count
        return np.array(self.values, dtype=np.float64)


def _evenly(distribution: Distribution, count: int) -> Floats:
    return distribution.quantiles((np.arange(count) + 0.5) / count)


def read_distribution(value: object) -> Distribution:
    """Return the distribution of a table such as ``{ range = [20, 180] }``.

    Raises:
        ConfigError: the value is something else.
    """
    right = f"give a table of one of {', '.join(_FORMS)}, as in {{ range = [20, 180] }}"
    if not isinstance(value, Mapping):
        raise ConfigError(f"{describe(value)} is not a distribution; {right}")
    if len(value) != 1 or next(iter(value)) not in _FORMS:
        names = " and ".join(sorted(value)) or "nothing"
        raise ConfigError(f"has {names}; {right}")
    ((form, numbers),) = value.items()
    if not isinstance(numbers, list) or not numbers:
        raise ConfigError(f"{form}: {describe(numbers)} is not a list of numbers")
    return _FORMS[form]([number()(each) for each in numbers])


def _uniform(numbers: Sequence[float]) -> Distribution:
    return Uniform(*_ends("range", numbers))


def _log_uniform(numbers: Sequence[float]) -> Distribution:
    low, high = _ends("log_range", numbers)
    if low <= 0.0:
        raise ConfigError(f"log_range: {low:g} is not positive; give [lowest, highest] above 0")
    return LogUniform(low, high)


def _normal(numbers: Sequence[float]) -> Distribution:
    if len(numbers) != 2 or numbers[1] <= 0.0:
        raise ConfigError("normal: give [mean, standard deviation], the deviation above 0")
    return Normal(*numbers)


def _triangular(numbers: Sequence[float]) -> Distribution:
    if len(numbers) != 3 or not numbers[0] <= numbers[1] <= numbers[2] > numbers[0]:
        raise ConfigError("triangular: give [lowest, most likely, highest]")
    return Triangular(*numbers)


def _choices(numbers: Sequence[float]) -> Distribution:
    if len(set(numbers)) < len(numbers):
        raise ConfigError("values: one is there twice; give each once")
    return Choices(tuple(numbers))


def _ends(form: str, numbers: Sequence[float]) -> Span:
    if len(numbers) != 2 or numbers[0] >= numbers[1]:
        raise ConfigError(f"{form}: give [lowest, highest], the lowest below the highest")
    return numbers[0], numbers[1]


_FORMS: Final[Mapping[str, Callable[[Sequence[float]], Distribution]]] = MappingProxyType(
    {
        "range": _uniform,
        "log_range": _log_uniform,
        "normal": _normal,
        "triangular": _triangular,
        "values": _choices,
    }
)


# Points of a space: grid, Sobol, Latin hypercube, Monte Carlo, Saltelli.

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
