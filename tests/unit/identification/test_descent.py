"""The search between bounds, on problems whose answers are known."""

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
