"""95 % intervals where the cost bends: a profile, beside what deviations say."""

import numpy as np
import pytest
from support.measured_lines import BASIS, PLACES, Lines, measure, polish_of

from hil_bench.abilities.identification.fit import Fit
from hil_bench.abilities.identification.intervals import REACH, find_end

PIECES = 8
NOISE = 0.5  # small beside the knee: the loss is the square


def fit_line() -> tuple[Fit, float]:
    """Return the fit of the logarithm of a slope, and the slope's own standard deviation."""
    polish = polish_of(Lines(measure(2.0, NOISE, PIECES)))
    optimum = polish.run(np.zeros(2), lambda: None)
    information = np.einsum("pvk,pvl->kl", optimum.slopes, optimum.slopes) + np.diag([1e-6, 1.0])
    spread = np.linalg.inv(information)
    basis, _ = np.linalg.qr(BASIS)
    alone = PLACES - basis @ (basis.T @ PLACES)
    deviation = 1.0 / np.sqrt(PIECES * (alone @ alone))
    return Fit(optimum, spread, spread, np.ones(3), 0.0, True, polish), deviation


def test_a_logarithm_has_the_ends_that_its_number_has() -> None:
    # The slope s is linear, so s - 1.96 d and s + 1.96 d are exact; the fit seeks log(s).
    fit, deviation = fit_line()
    slope = np.exp(fit.variables[0])
    exact = [np.log(slope + side * REACH * deviation) for side in (-1.0, 1.0)]

    found = [find_end(fit, 0, side, lambda: None) for side in (-1.0, 1.0)]
    straight = [fit.variables[0] + side * REACH * deviation / slope for side in (-1.0, 1.0)]

    assert found == pytest.approx(exact, abs=0.01)
    assert np.abs(np.subtract(straight, exact)).min() > 0.02  # what deviations alone would say


def test_a_profile_leaves_the_fit_as_it_is() -> None:
    fit, _ = fit_line()
    states = fit.polish.shooting.states.copy()

    find_end(fit, 0, 1.0, lambda: None)

    assert np.array_equal(fit.polish.shooting.states, states)
