"""How uncertain a fit is: the stated deviation against the errors that are really made."""

import numpy as np
import numpy.typing as npt
import pytest

from hil_bench.identification.uncertainty import find_covariance, leave_out, leave_out_wild

GROUPS, SIZE = 40, 25
NOISE = 0.05  # small beside 1, where the loss soft_l1 bends: the fit is the mean, nearly
EXPECTED_SPREAD = 1e3  # of the variable, so wide that it says nothing

Values = npt.NDArray[np.float64]


def draw_errors(source: np.random.Generator, common: float) -> Values:
    """Return errors of measurements of 0: a part of each group's own, and one of each alone."""
    shared = common * source.standard_normal(GROUPS)
    return np.repeat(shared, SIZE) + NOISE * source.standard_normal(GROUPS * SIZE)


def fit_mean(errors: Values) -> tuple[float, Values, Values]:
    """Return the mean, its slopes and residuals, and those of what was expected of it."""
    mean = float(errors.mean())
    slopes = np.append(np.ones(len(errors)), 1.0 / EXPECTED_SPREAD)[:, np.newaxis]
    return mean, slopes, np.append(mean - errors, mean / EXPECTED_SPREAD)


@pytest.mark.parametrize("common", [0.0, 0.05])
def test_errors_are_within_two_deviations_as_often_as_they_should(common: float) -> None:
    source = np.random.default_rng(7)
    hits = naive_hits = 0
    draws = 1000
    for _ in range(draws):
        mean, slopes, residuals = fit_mean(draw_errors(source, common))
        variance = find_covariance(slopes, residuals, GROUPS, len(residuals) - 2)[0, 0]
        hits += abs(mean) < 2.0 * np.sqrt(variance)
        naive_hits += abs(mean) < 2.0 * residuals.std() / np.sqrt(len(residuals))

    # Student's t with 39 degrees of freedom: 94.8 % within two deviations; 1000 draws scatter by
    # 0.7 %. The larger of two estimates covers a little more.
    assert 0.927 < hits / draws < 0.985
    if common:
        # The mean's variance is common² / 40 + noise² / 1000, of which the independent estimate
        # (common² + noise²) / 1000 is 1 / 13: two deviations become 0.55, which 42 % are within.
        assert naive_hits / draws == pytest.approx(0.42, abs=0.05)


def test_what_groups_have_in_common_counts_by_the_number_of_groups() -> None:
    source = np.random.default_rng(8)
    variances = []
    for _ in range(400):
        _, slopes, residuals = fit_mean(draw_errors(source, 0.05))
        variances.append(leave_out(slopes, residuals, GROUPS)[0, 0])

    # 0.05² / 40 + 0.05² / 1000; a chi² of 39 degrees scatters by 23 %, the mean of 400 by 1.1 %
    assert np.mean(variances) == pytest.approx(6.5e-5, rel=0.05)


def test_independent_residuals_give_the_covariance_of_least_squares() -> None:
    source = np.random.default_rng(9)
    places = np.tile(np.linspace(-1.0, 1.0, SIZE), GROUPS)
    line = np.column_stack([np.ones_like(places), places])
    slopes = np.vstack([line, np.eye(2) / EXPECTED_SPREAD])
    found = []
    for _ in range(200):
        errors = NOISE * source.standard_normal(len(places))
        fitted = np.linalg.lstsq(line, errors, rcond=None)[0]
        residuals = np.append(line @ fitted - errors, fitted / EXPECTED_SPREAD)
        found.append(find_covariance(slopes, residuals, GROUPS, len(places) - 2))

    # noise² (XᵀX)^-1: 1 / N for the level, 1 / sum of squares for the slope; the larger of two
    # estimates that scatter by 23 % is some 10 % more
    expected = NOISE**2 / np.array([len(places), np.square(places).sum()])
    assert np.mean(found, axis=0).diagonal() == pytest.approx(1.1 * expected, rel=0.08)


def test_a_group_that_claims_to_tell_all_is_left_out():
    source = np.random.default_rng(7)
    slopes = source.standard_normal((20 * 5 + 2, 2))
    slopes[3 * 5 : 4 * 5, 1] *= 1e4  # claims 1e8 times a group's share, 5e6 times all others'
    slopes[7 * 5 : 8 * 5] *= 10.0  # tells much: 100 times a share, 5 times all others
    tamed = leave_out_wild(slopes, 20)
    assert not tamed[3 * 5 : 4 * 5].any()
    rest = np.r_[0:15, 20:102]
    assert np.array_equal(tamed[rest], slopes[rest])


def test_wild_groups_do_not_hide_each_other():
    slopes = np.ones((10 * 3 + 1, 1))
    slopes[0:3] = 1e4
    slopes[3:6] = 1e9
    tamed = leave_out_wild(slopes, 10)
    assert not tamed[:6].any()
    assert tamed[6:].all()


def test_what_one_group_alone_tells_is_kept():
    slopes = np.zeros((10 * 3 + 1, 1))
    slopes[3:6] = 1.0
    assert np.array_equal(leave_out_wild(slopes, 10), slopes)
