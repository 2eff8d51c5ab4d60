"""Points of a space, held against closed forms of their distributions."""

import math

import numpy as np
import pytest

from hil_bench.abilities.campaign.distributions import (
    Choices,
    LogUniform,
    Normal,
    Sampler,
    Triangular,
    Uniform,
    read_distribution,
    sample,
    size_of_sample,
    unit_points,
)
from hil_bench.abilities.campaign.summary import failure_bound
from hil_bench.errors import ConfigError

SALTELLI = Sampler.SALTELLI
SHARES = np.array([0.0, 0.25, 0.5, 0.75, 1.0])


def test_levels_of_an_uneven_distribution_are_the_middles_of_equal_shares():
    """Quantiles of 1/4 and 3/4: F(1) = 1/4, and 1 - (4 - x)² / 12 = 3/4."""
    levels = read_distribution({"triangular": [0, 1, 4]}).levels(2)
    assert levels == pytest.approx([1.0, 4 - math.sqrt(3)])


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ({"range": [20, 180]}, [20.0, 60.0, 100.0, 140.0, 180.0]),
        ({"log_range": [1, 16]}, [1.0, 2.0, 4.0, 8.0, 16.0]),
        ({"values": [0, 1]}, [0.0, 0.0, 1.0, 1.0, 1.0]),
        # F(x) = x² / (1 · 4) up to the mode, 1 - (4 - x)² / (4 · 3) behind it
        ({"triangular": [0, 1, 4]}, [0.0, 1.0, 4 - math.sqrt(6), 4 - math.sqrt(3), 4.0]),
    ],
)
def test_quantiles_are_those_of_the_distribution(table, expected):
    assert read_distribution(table).quantiles(SHARES) == pytest.approx(expected)


def test_a_normal_distribution_is_cut_off_at_its_bounds():
    # Symmetric bounds leave the median; of the standard normal 0.975 lie below 1.959964.
    cut = Normal(10.0, 2.0, 9.0, 11.0).quantiles(np.array([0.0, 0.5, 1.0]))
    assert cut == pytest.approx([9.0, 10.0, 11.0])
    free = Normal(0.0, 1.0).quantiles(np.array([0.975, 0.0, 1.0]))
    assert free[0] == pytest.approx(1.959964, abs=1e-6)
    assert np.isfinite(free).all()


@pytest.mark.parametrize(
    ("value", "wrong"),
    [
        (3.0, "3.0 is not a distribution"),
        ({}, "has nothing"),
        ({"range": [1, 2], "normal": [1, 2]}, "has normal and range"),
        ({"range": [2, 1]}, "range: give [lowest, highest]"),
        ({"range": 3}, "range: 3 is not a list of numbers"),
        ({"range": ["a", 1]}, '"a" is not a number'),
        ({"log_range": [0, 1]}, "0 is not positive"),
        ({"normal": [1, 0]}, "the deviation above 0"),
        *[
            ({"triangular": numbers}, "triangular: give [lowest, most likely, highest]")
            for numbers in ([1, 0, 2], [1, 1, 1], [0, 2, 1], [0, 1], [0, 1, 2, 3])
        ],
        ({"range": [1, 1]}, "range: give [lowest, highest], the lowest below"),
        ({"range": [1, 2, 3]}, "range: give [lowest, highest]"),
        ({"range": []}, "is not a list of numbers"),
        ({"log_range": [2, 2]}, "log_range: give [lowest, highest]"),
        ({"normal": [1, 2, 3]}, "normal: give [mean, standard deviation]"),
        ({"values": [1, 1]}, "one is there twice"),
    ],
)
def test_what_is_no_distribution_is_refused_in_a_line(value, wrong):
    with pytest.raises(ConfigError) as caught:
        read_distribution(value)
    assert wrong in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("numbers", [[0, 0, 1], [0, 1, 1], [-2, -1, 0]])
def test_the_most_likely_value_may_be_an_end(numbers):
    assert read_distribution({"triangular": numbers}).quantiles(np.array([0.0, 1.0])).tolist() == [
        numbers[0],
        numbers[2],
    ]


def test_a_grid_has_every_combination():
    space = {"a": Uniform(0.0, 2.0), "b": Choices((5.0, 7.0))}
    points = list(sample(space, Sampler.GRID, 0, 0, levels=3))
    assert [(each["a"], each["b"]) for each in points] == [
        (a, b) for a in (0.0, 1.0, 2.0) for b in (5.0, 7.0)
    ]


def test_a_latin_hypercube_has_a_point_in_every_slice():
    points = unit_points(Sampler.LATIN_HYPERCUBE, 20, 3, seed=1)
    slices = np.sort(np.floor(points * 20).astype(int), axis=0)
    assert (slices == np.arange(20)[:, None]).all()


def test_sobol_points_fill_every_box_of_a_sixteenth():
    # A (0, 4, 2)-net: 16 points, one in each of 4 x 4 boxes (Sobol 1967).
    boxes = np.floor(unit_points(Sampler.SOBOL, 16, 2, seed=3) * 4).astype(int)
    assert len({tuple(each) for each in boxes}) == 16


@pytest.mark.parametrize("sampler", [Sampler.SOBOL, Sampler.MONTE_CARLO])
def test_a_longer_sample_begins_with_the_shorter(sampler):
    space = {"a": LogUniform(1.0, 10.0), "b": Triangular(0.0, 1.0, 2.0)}
    short = list(sample(space, sampler, 5, 9))
    assert list(sample(space, sampler, 40, 9))[:5] == short
    assert list(sample(space, sampler, 5, 10)) != short


def test_bounds_are_those_of_clopper_and_pearson():
    # No failure in n runs: (1 - p)^n = 0.05, so p = 3 / n nearly (the rule of three).
    assert failure_bound(0, 10_000) == pytest.approx(-math.log(0.05) / 10_000, rel=2e-4)
    # One failure in 10: the p for which P(X <= 1) = (1 - p)^10 + 10 p (1 - p)^9 = 0.05.
    bound = failure_bound(1, 10)
    assert (1 - bound) ** 10 + 10 * bound * (1 - bound) ** 9 == pytest.approx(0.05)
    assert failure_bound(7, 7) == 1.0


def test_each_block_of_saltellis_design_changes_one_parameter_at_a_time():
    space = {name: Uniform(0.0, 1.0) for name in "abc"}
    points = list(sample(space, SALTELLI, 16, seed=3))
    assert len(points) == 16 * (3 + 2) == size_of_sample(list(space.values()), SALTELLI, 16, 5)
    for start in range(0, len(points), 5):
        first, second, *mixed = points[start : start + 5]
        for name, point in zip("abc", mixed, strict=True):
            assert point == {**first, name: second[name]}
    assert list(sample(space, SALTELLI, 8, seed=3)) == points[:40]
