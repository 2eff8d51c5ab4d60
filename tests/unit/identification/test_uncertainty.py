"""How uncertain a fit is: the stated deviation against the errors that are really made."""

import numpy as np
import numpy.typing as npt
import pytest

from hil_bench.abilities.identification.uncertainty import (
    Evidence,
    find_colour,
    find_covariance,
    invert,
    leave_out,
    leave_out_wild,
)

GROUPS, SIZE = 40, 25
NOISE = 0.05  # small beside 3, where the loss bends: the fit is the mean, nearly
EXPECTED_SPREAD = 1e3  # of the variable, so wide that it says nothing

Values = npt.NDArray[np.float64]


def draw_errors(source: np.random.Generator, common: float) -> Values:
    """Return errors of measurements of 0: a part of each group's own, and one of each alone."""
    shared = common * source.standard_normal(GROUPS)
    return np.repeat(shared, SIZE) + NOISE * source.standard_normal(GROUPS * SIZE)


def fit_mean(errors: Values) -> tuple[float, Evidence]:
    """Return the mean, and what its fit leaves."""
    mean = float(errors.mean())
    return mean, Evidence(
        residuals=(mean - errors).reshape(GROUPS, SIZE),
        slopes=np.ones((GROUPS, SIZE, 1)),
        spreads=np.array([EXPECTED_SPREAD]),
        freedom=len(errors) - 1,
    )


@pytest.mark.long
@pytest.mark.parametrize(("common", "is_white"), [(0.0, True), (0.0, False), (0.05, False)])
def test_errors_are_within_two_deviations_as_often_as_they_should(
    common: float, is_white: bool
) -> None:
    source = np.random.default_rng(7)
    draws = 1000
    hits = 0
    for _ in range(draws):
        mean, evidence = fit_mean(draw_errors(source, common))
        variance = find_covariance(evidence, is_white=is_white)[0, 0]
        hits += abs(mean) < 2.0 * np.sqrt(variance)

    # Student's t with 39 degrees of freedom: 94.8 % within two deviations; 1000 draws scatter by
    # 0.7 %. The larger of two estimates, where residuals are not white, covers a little more.
    assert 0.927 < hits / draws < 0.985


def test_what_groups_have_in_common_needs_more_than_independence() -> None:
    source = np.random.default_rng(7)
    hits = 0
    for _ in range(1000):
        mean, evidence = fit_mean(draw_errors(source, 0.05))
        hits += abs(mean) < 2.0 * np.sqrt(find_covariance(evidence, is_white=True)[0, 0])

    # The mean's variance is common² / 40 + noise² / 1000, of which the independent estimate
    # (common² + noise²) / 1000 is 1 / 13: two deviations become 0.55, which 42 % are within.
    assert hits / 1000 == pytest.approx(0.42, abs=0.05)


def test_what_groups_have_in_common_counts_by_the_number_of_groups() -> None:
    source = np.random.default_rng(8)
    variances = []
    for _ in range(400):
        _, evidence = fit_mean(draw_errors(source, 0.05))
        variances.append(leave_out(evidence)[0, 0])

    # 0.05² / 40 + 0.05² / 1000; a chi² of 39 degrees scatters by 23 %, the mean of 400 by 1.1 %
    assert np.mean(variances) == pytest.approx(6.5e-5, rel=0.05)


def test_white_residuals_give_the_covariance_of_least_squares() -> None:
    source = np.random.default_rng(9)
    places = np.tile(np.linspace(-1.0, 1.0, SIZE), GROUPS)
    line = np.column_stack([np.ones_like(places), places])
    found = []
    for _ in range(50):
        errors = NOISE * source.standard_normal(len(places))
        fitted = np.linalg.lstsq(line, errors, rcond=None)[0]
        evidence = Evidence(
            residuals=(line @ fitted - errors).reshape(GROUPS, SIZE),
            slopes=line.reshape(GROUPS, SIZE, 2),
            spreads=np.full(2, EXPECTED_SPREAD),
            freedom=len(places) - 2,
        )
        found.append(find_covariance(evidence, is_white=True))

    # noise² (XᵀX)^-1: 1 / N for the level, 1 / sum of squares for the slope; 50 means of 1000
    # squares scatter by 0.6 %
    expected = NOISE**2 / np.array([len(places), np.square(places).sum()])
    assert np.mean(found, axis=0).diagonal() == pytest.approx(expected, rel=0.02)


def test_the_loss_of_unit_noise_costs_no_more_than_it_says() -> None:
    # The optimum of the loss is not the mean; its true scatter must be what is stated.
    from scipy.optimize import minimize_scalar  # noqa: PLC0415 - an extra

    from hil_bench.abilities.identification.loss import cost_of  # noqa: PLC0415

    source = np.random.default_rng(10)
    ends, stated = [], []
    for _ in range(300):
        errors = source.standard_normal(GROUPS * SIZE)
        end = minimize_scalar(lambda mean, seen=errors: cost_of(mean - seen).sum()).x
        evidence = Evidence(
            (end - errors).reshape(GROUPS, SIZE), np.ones((GROUPS, SIZE, 1)), np.array([1e3]), 999
        )
        ends.append(end)
        stated.append(find_covariance(evidence, is_white=True)[0, 0])

    # a deviation from 300 draws scatters by 4 %
    assert np.sqrt(np.mean(stated)) == pytest.approx(np.std(ends), rel=0.12)


def test_what_nothing_is_known_of_is_not_exactly_known() -> None:
    # A pseudo-inverse drops the small eigenvalue and calls the second variable exact.
    information = np.diag([1e18, 1.0])

    assert np.sqrt(np.diag(invert(information))) == pytest.approx([1e-9, 1.0])
    blind = invert(np.array([[1.0, 1.0], [1.0, 1.0]]))
    assert np.sqrt(np.diag(blind)).min() > 1e5  # only their sum is known


def test_a_variable_without_slopes_keeps_its_expected_spread() -> None:
    source = np.random.default_rng(11)
    slopes = np.zeros((GROUPS, SIZE, 2))
    slopes[..., 0] = 1e9
    evidence = Evidence(source.standard_normal((GROUPS, SIZE)), slopes, np.ones(2), GROUPS * SIZE)

    for is_white in (True, False):
        deviation = np.sqrt(find_covariance(evidence, is_white=is_white)[1, 1])
        assert deviation == pytest.approx(1.0, rel=0.1)


def test_white_noise_is_found_white_and_filtered_noise_is_not() -> None:
    source = np.random.default_rng(12)
    white = source.standard_normal((100, 200, 3))
    filtered = white.copy()
    # One signal through a filter of first order with a pole at 0.2: correlated by 0.2 row to row.
    for row in range(1, 200):
        filtered[:, row, 1] += 0.2 * filtered[:, row - 1, 1]

    for residuals, is_white in ((white, True), (filtered, False)):
        colour, limit = find_colour(residuals)
        assert (colour <= limit) == is_white
    assert colour == pytest.approx(0.2, abs=0.02)


def test_a_group_that_claims_to_tell_all_is_left_out() -> None:
    source = np.random.default_rng(7)
    slopes = source.standard_normal((20, 5, 2))
    slopes[3, :, 1] *= 1e4  # claims 1e8 times a group's share, 5e6 times all others'
    slopes[7] *= 10.0  # says much: 100 times a share, 5 times all others

    assert np.flatnonzero(~leave_out_wild(slopes)).tolist() == [3]


def test_wild_groups_do_not_hide_each_other() -> None:
    slopes = np.ones((10, 3, 1))
    slopes[0] = 1e4
    slopes[1] = 1e9

    assert np.flatnonzero(~leave_out_wild(slopes)).tolist() == [0, 1]


def test_what_one_group_alone_tells_is_kept() -> None:
    slopes = np.zeros((10, 3, 1))
    slopes[1] = 1.0

    assert leave_out_wild(slopes).all()
