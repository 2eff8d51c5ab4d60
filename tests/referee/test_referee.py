"""`judge` and the online monitor against the referee, on cases drawn from a seed."""

import pytest
from referee.agreement import differences_in_memory, differences_of_file
from referee.cases import draw

SEED = 27


@pytest.mark.parametrize("first", range(0, 150, 50))
def test_judge_and_the_monitor_agree_with_the_referee(first):
    found = {n: list(differences_in_memory(draw(SEED, n))) for n in range(first, first + 50)}
    assert not {n: each for n, each in found.items() if each}


def test_judged_files_agree_with_the_referee(tmp_path):
    found = {n: list(differences_of_file(draw(SEED, n), tmp_path)) for n in range(200, 250)}
    assert not {n: each for n, each in found.items() if each}


@pytest.mark.long
@pytest.mark.parametrize("first", range(1000, 4000, 500))
def test_thousands_of_cases_agree_with_the_referee(first, tmp_path):
    for number in range(first, first + 500):
        case = draw(SEED, number)
        assert not [*differences_in_memory(case), *differences_of_file(case, tmp_path)], number
