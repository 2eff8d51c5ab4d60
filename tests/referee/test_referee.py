"""`judge`, the monitor, `test` and campaigns against the referee, on cases drawn from a seed."""

import pytest

from referee.agreement import (
    ROUNDED,
    differences_in_memory,
    differences_of_file,
    differences_of_verb,
)
from referee.cases import draw
from referee.played import Played

SEED = 27


def disagreements(found):
    """Return what is more than the rounding of doubles."""
    return [each for each in found if not each.startswith(ROUNDED)]


@pytest.mark.parametrize("first", range(0, 200, 20))
def test_judge_and_the_monitor_agree_with_the_referee(first):
    for number in range(first, first + 20):
        assert not disagreements(differences_in_memory(draw(SEED, number))), number


@pytest.mark.parametrize("first", range(200, 240, 20))
def test_judged_files_agree_with_the_referee(first, tmp_path):
    for number in range(first, first + 20):
        assert not disagreements(differences_of_file(draw(SEED, number), tmp_path)), number


def test_the_verb_judge_agrees_with_the_referee(tmp_path):
    for number in range(300, 310):
        assert not disagreements(differences_of_verb(draw(SEED, number), tmp_path)), number


@pytest.mark.long
@pytest.mark.parametrize("first", range(1000, 4000, 500))
def test_thousands_of_cases_agree_with_the_referee(first, tmp_path):
    for number in range(first, first + 500):
        case = draw(SEED, number)
        found = [*differences_in_memory(case), *differences_of_file(case, tmp_path)]
        assert not disagreements(found), number


@pytest.mark.long
def test_what_is_played_agrees_with_the_referee(tmp_path):
    played = Played(f"{SEED}", tmp_path, 25)
    assert not disagreements(played.differences_in_test())
    assert not disagreements(played.differences_in_verb())
    assert not disagreements(played.differences_in_campaign(tmp_path / "results", 4))
