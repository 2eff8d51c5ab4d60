"""The search between bounds, on problems whose answers are known."""

import itertools

import numpy as np
import pytest

from hil_bench.abilities.identification.descent import descend


def test_a_curved_valley_is_followed_to_its_end():
    """Rosenbrock's function in its form of least squares: the minimum is at (1, 1)."""

    def residuals(x):
        return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])

    def slopes(x):
        return np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])

    bounds = (np.full(2, -2.0), np.full(2, 2.0))
    found = descend(residuals, slopes, np.array([-1.2, 1.0]), bounds, 60, 1e-12)

    assert found == pytest.approx([1.0, 1.0], abs=1e-6)


def test_a_bound_holds_one_variable_and_not_the_others():
    """Least |A x - b| with x_1 >= 0: held there, x_2 is the mean that b leaves it."""
    matrix = np.array([[1.0, 1.0], [0.0, 1.0], [1.0, 0.0]])
    target = np.array([1.0, 3.0, -1.0])
    bounds = (np.zeros(2), np.full(2, 10.0))

    found = descend(
        lambda x: matrix @ x - target, lambda _: matrix, np.array([5.0, 0.0]), bounds, 20, 1e-12
    )

    assert found == pytest.approx([0.0, 2.0], abs=1e-6)


def test_it_leaves_a_bound_at_which_it_begins():
    found = descend(
        lambda x: x - 3.0,
        lambda _: np.eye(1),
        np.array([0.0]),
        (np.zeros(1), np.full(1, 10.0)),
        20,
        1e-12,
    )

    assert found == pytest.approx([3.0], abs=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_it_finds_the_least_squares_in_a_box_that_trying_all_sides_finds(seed):
    """Each variable is free, at its lower or at its upper bound: of all 27 ways the best."""
    random = np.random.default_rng(seed)
    matrix, target = random.standard_normal((5, 3)), 3.0 * random.standard_normal(5)
    low, high = np.full(3, -0.5), np.full(3, 0.7)
    costs = []
    for sides in itertools.product((np.nan, -0.5, 0.7), repeat=3):
        there = np.array(sides)
        free = np.isnan(there)
        held = matrix[:, ~free] @ there[~free]
        there[free] = np.linalg.lstsq(matrix[:, free], target - held, rcond=None)[0]
        if (there >= low).all() and (there <= high).all():
            costs.append((float(np.sum((matrix @ there - target) ** 2)), there.tolist()))

    begin = random.choice([-0.5, 0.1, 0.7], 3)
    found = descend(lambda x: matrix @ x - target, lambda _: matrix, begin, (low, high), 60, 1e-14)

    assert found == pytest.approx(min(costs)[1], abs=1e-5)


def test_a_step_that_goes_too_far_is_made_shorter():
    """Newton's steps to the zero of the arc tangent go further off each time from 1.4 on."""
    bounds = (np.full(1, -100.0), np.full(1, 100.0))

    found = descend(
        np.arctan, lambda x: np.diag(1.0 / (1.0 + x**2)), np.array([50.0]), bounds, 60, 1e-12
    )

    assert found == pytest.approx([0.0], abs=1e-6)
