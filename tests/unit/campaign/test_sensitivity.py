"""Sobol indices, held against the closed form of Ishigami's function and against SciPy."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import sobol_indices as by_scipy
from support.campaigns import run_result, write_rest

from hil_bench.abilities.campaign.distributions import Sampler
from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.records import Verdict, read_campaign
from hil_bench.abilities.campaign.sensitivity import sobol_indices
from hil_bench.errors import ConfigError

ISHIGAMI = """\
title = "Ishigami"
duration_s = 0.01
[parameters]
first_bar = { value = 1.0, range = [0.0, 360.0] }
second_bar = { value = 1.0, range = [0.0, 360.0] }
third_bar = { value = 1.0, range = [0.0, 360.0] }
[[expect]]
id = "R-1"
that = "always axis1.P_A < first_bar and axis1.P_B < second_bar or axis1.P_A < third_bar"
"""
A, B = 7.0, 0.1


@pytest.fixture
def plan(tmp_path):
    campaign = read_campaign(write_rest(tmp_path, ISHIGAMI))
    return Plan(replace(campaign, sampler=Sampler.SALTELLI, runs=1024))


def ishigami(values):
    """Ishigami and Homma (1990) of angles in degrees from 0 to 360."""
    x, y, z = (math.radians(values[f"{name}_bar"] - 180.0) for name in ("first", "second", "third"))
    return math.sin(x) + A * math.sin(y) ** 2 + B * z**4 * math.sin(x)


def results_of(plan, margin):
    return [
        run_result(
            Verdict("R-1", "passed", margin(spec.values), ""), key=spec.key, scenario="rest",
            values=spec.values,
        )
        for spec in plan
    ]  # fmt: skip


def test_the_intervals_hold_the_indices_of_ishigamis_function(plan):
    found = sobol_indices(plan, results_of(plan, ishigami))
    # Closed forms: V1 = (1 + b pi^4 / 5)^2 / 2, V2 = a^2 / 8, V13 = 8 b^2 pi^8 / 225.
    first = 0.5 * (1 + B * math.pi**4 / 5) ** 2
    second, mixed = A**2 / 8, 8 * B**2 * math.pi**8 / 225
    whole = first + second + mixed
    expected = {
        "first_bar": (first / whole, (first + mixed) / whole),
        "second_bar": (second / whole, second / whole),
        "third_bar": (0.0, mixed / whole),
    }
    assert found.gaps == ()
    assert [each.parameter for each in found.indices] == ["first_bar", "second_bar", "third_bar"]
    for each in found.indices:
        for estimate, share in zip((each.first, each.total), expected[each.parameter], strict=True):
            assert estimate.low < share < estimate.high
            assert estimate.high - estimate.low < 0.25


def test_the_estimates_are_those_of_scipy(plan):
    results = results_of(plan, ishigami)
    table = np.array([each.verdicts[0].margin for each in results]).reshape(-1, 5)
    blocks = {"f_A": table[:, 0][None], "f_B": table[:, 1][None], "f_AB": table[:, 2:].T[:, None]}
    oracle = by_scipy(func=blocks, n=len(table))
    found = {each.parameter: each for each in sobol_indices(plan, results).indices}
    for place, name in enumerate(("first_bar", "second_bar", "third_bar")):
        assert found[name].first.value == pytest.approx(oracle.first_order[place], abs=1e-12)
        assert found[name].total.value == pytest.approx(oracle.total_order[place], abs=1e-12)


def test_an_interval_is_as_wide_as_the_jackknife_says(plan):
    """Of a smooth statistic 95 % are 2 x 1.96 standard errors (Efron and Tibshirani 1993)."""
    results = results_of(plan, ishigami)
    table = np.array([each.verdicts[0].margin for each in results]).reshape(-1, 5)
    found = {each.parameter: each for each in sobol_indices(plan, results).indices}
    for place, name in enumerate(("first_bar", "second_bar", "third_bar"), 2):
        squares = (table[:, 0] - table[:, place]) ** 2
        without = np.array(
            [
                np.delete(squares, row).mean() / 2.0 / np.delete(table[:, :2], row, axis=0).var()
                for row in range(len(table))
            ]
        )
        total = found[name].total
        assert squares.mean() / 2.0 / table[:, :2].var() == pytest.approx(total.value, abs=1e-12)
        error = np.sqrt((len(table) - 1) * without.var())
        # 999 samples show the ends of an interval within a twentieth of its width.
        assert (total.high - total.low) / (2.0 * 1.96 * error) == pytest.approx(1.0, abs=0.1)


def test_a_line_names_the_parameters_that_matter_the_first_one_first(plan):
    def margin(values):
        return 3.0 * values["second_bar"] + 4.0 * values["first_bar"] + 0.2 * values["third_bar"]

    # Of a sum the shares are as the squares: 16, 9 and 0.04 of 25.04; 0.2 % do not matter.
    (line,) = sobol_indices(plan, results_of(plan, margin)).lines()
    begin, first, second = re.split(r" (?=first_bar|second_bar)", line)
    assert begin == "rest  R-1: shares of the margin's variance:"
    assert first.startswith("first_bar 0.64 (0.")
    assert second.startswith("second_bar 0.36 (0.")


def test_what_cannot_be_computed_is_said(plan):
    results = results_of(plan, ishigami)
    whole = len(results)
    assert sobol_indices(plan, results[3:]).gaps == (
        f"rest  R-1: 3 of {whole} runs have no margin",
    )
    flat = sobol_indices(plan, results_of(plan, lambda _values: 1.0))
    assert flat.gaps == ("rest  R-1: all margins are the same",)
    assert list(flat.lines()) == [f"{flat.gaps[0]}, so there are no Sobol indices"]


def test_other_samplers_have_no_indices(tmp_path):
    other = Plan(read_campaign(write_rest(tmp_path, ISHIGAMI)))
    assert sobol_indices(other, results_of(other, ishigami)) == ((), ())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"runs": 100},
            "runs = 100: the sampler saltelli needs a power of two, 8 or more; give 128",
        ),
        ({"runs": 4}, "runs = 4: the sampler saltelli needs a power of two, 8 or more; give 8"),
        ({"seeds": (1, 2)}, "seeds: the sampler saltelli compares a point with its neighbours"),
        ({"seed_each": True}, "give one seed, or none"),
    ],
)
def test_a_design_that_says_nothing_is_refused(tmp_path, change, message):
    campaign = read_campaign(write_rest(tmp_path, ISHIGAMI))
    with pytest.raises(ConfigError, match=message):
        Plan(replace(campaign, **{"sampler": Sampler.SALTELLI, "runs": 8, **change}))
