"""The cost about a point: what bends it where residuals hardly change."""

import numpy as np
import pytest

from hil_bench.abilities.identification.quadratic import Quadratic, find_deviations


def one_start(*own: float) -> Quadratic:
    """Return one piece whose start has these second derivatives and a gradient of 1 by each."""
    return Quadratic(
        pull=np.zeros(1),
        information=np.eye(1),
        own_pull=np.ones((1, 4)),
        own=np.diag(own)[np.newaxis],
        mixed=np.zeros((1, 4, 1)),
    )


def test_the_vaguest_direction_is_looked_at_as_far_as_its_step_goes() -> None:
    direction, size = one_start(4.0, 0.5, 9.0, 16.0).vaguest()

    assert np.abs(direction[0]) == pytest.approx([0.0, 1.0, 0.0, 0.0])
    assert size[0] == pytest.approx(1.0 / 0.5)  # gradient over second derivative


def test_the_gain_of_a_start_is_that_of_the_true_bend() -> None:
    quadratic = one_start(4.0, 0.5, 9.0, 16.0)
    direction, _ = quadratic.vaguest()

    bent = quadratic.bent(direction, np.array([100.0]))

    # A parabola of gradient g and bend b falls by g^2 / (2 b) to its bottom.
    others = 1 / 8 + 1 / 18 + 1 / 32
    assert quadratic.own_gains()[0] == pytest.approx(others + 1.0)
    assert bent.own_gains()[0] == pytest.approx(others + 1 / 200)


def test_a_cost_that_bends_less_than_the_residuals_say_changes_nothing() -> None:
    quadratic = one_start(4.0, 0.5, 9.0, 16.0)
    direction, _ = quadratic.vaguest()

    assert quadratic.bent(direction, np.array([-3.0])).own == pytest.approx(quadratic.own)


def test_steps_of_a_deviation_are_uncorrelated() -> None:
    # Units that differ by 1e5, and a correlation of 0.9.
    information = np.array([[1e10, 0.9e5, 0.0], [0.9e5, 1.0, 0.0], [0.0, 0.0, 4.0]])

    ways = find_deviations(information)

    assert ways @ information @ ways.T == pytest.approx(np.eye(3), abs=1e-9)
