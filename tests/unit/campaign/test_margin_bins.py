"""Bins of margins: nothing is clipped in silence, and zero parts what holds from what fails."""

import math

import pytest

from hil_bench.abilities.campaign.reports import LARGEST, bin_margins


@pytest.mark.parametrize(
    "margins",
    [
        [],
        [0.0],
        [0.5, 0.5],
        [-0.25, 0.0, 1.0, 2.9],
        [-7.0, -3.0, 3.0, 9.0, math.inf, -math.inf],
        [-1e-9, 1e-9],
    ],
)
def test_every_margin_is_counted_once(margins):
    found = bin_margins(margins)
    assert sum(found.counts) + found.below + found.above == len(margins)
    assert found.low <= 0.0 <= found.high
    assert found.high > found.low


def test_what_lies_beyond_is_counted_beside():
    found = bin_margins([-7.0, -math.inf, 1.0, 9.0])
    assert (found.below, found.above) == (2, 1)
    assert -LARGEST <= found.low
    assert sum(found.counts) == 1


def test_zero_is_an_edge_so_that_no_bin_mixes_verdicts():
    found = bin_margins([-0.31, -1e-6, 1e-6, 0.77])
    width = (found.high - found.low) / len(found.counts)
    place = round(-found.low / width)
    assert place * width == pytest.approx(-found.low)
    assert sum(found.counts[:place]) == 2  # the two that fail


@pytest.mark.parametrize(("largest", "width"), [(1.0, 0.05), (0.6, 0.02), (2.9, 0.1), (0.7, 0.025)])
def test_a_bin_has_the_next_round_width_of_a_thirtieth(largest, width):
    """1/30 = 0.0333 of the way, and so on, rounded up to 1, 2, 2.5 or 5 times a power of ten."""
    found = bin_margins([0.0, largest])
    assert (found.high - found.low) / len(found.counts) == pytest.approx(width)


def test_what_is_no_number_is_left_out():
    assert sum(bin_margins([math.nan, 0.5]).counts) == 1


def test_bins_have_the_next_round_width_that_makes_no_more_than_thirty():
    for margin in (10.0**-power * digits for power in range(3) for digits in range(1, 300, 7)):
        if margin > 3.0:
            continue
        low, high, counts, _, _ = bin_margins([margin])
        width = (high - low) / len(counts)
        digits = width / 10.0 ** math.floor(math.log10(width) + 1e-9)
        rounds = [r for r in (1.0, 2.0, 2.5, 5.0, 10.0) if r == pytest.approx(digits)]
        assert rounds, width
        before = {1.0: 0.5, 2.0: 1.0, 2.5: 2.0, 5.0: 2.5, 10.0: 5.0}[rounds[0]] / rounds[0]
        assert before * width < margin / 30 * (1 + 1e-9) <= width * (1 + 2e-9)
