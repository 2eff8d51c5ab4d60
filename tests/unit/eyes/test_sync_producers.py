"""Two producers of SYNC told from one that jitters, by the times alone."""

import random

import pytest

from hil_bench.abilities.eyes.explain.syncs import SyncProducers
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.canopen_device.frame import Frame

MS = 1_000_000
PERIOD = 20 * MS


def looked_at(times, periods=()):
    producers = SyncProducers()
    for now in sorted(times):
        sight = Sight(now, Frame(0x080), Service.SYNC, "SYNC", "", None)
        producers.hear(sight, periods)
    return producers.found


def train(begin, period, end=3000 * MS):
    return list(range(begin, end, period))


def test_a_second_one_of_another_clock_is_found_wherever_it_begins():
    """Its period is 3 % longer; from the first frame on, and in the middle."""
    for begin in (7 * MS, 1007 * MS):
        found = looked_at(train(0, PERIOD) + train(begin, PERIOD * 103 // 100))
        assert found is not None
        assert found.period == pytest.approx(PERIOD, rel=0.05)


def test_a_second_one_of_the_same_clock_shows_by_what_was_before_or_by_0x1006():
    both = train(0, PERIOD) + train(1007 * MS, PERIOD)
    assert looked_at(both) is not None
    throughout = train(0, PERIOD) + train(7 * MS, PERIOD)
    assert looked_at(throughout) is None  # 7 and 13 ms in turn may be the jitter of one
    assert looked_at(throughout, [PERIOD]) is not None


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("jitter", [0.05, 0.2, 0.45, 0.9])
def test_one_that_jitters_is_one(seed, jitter):
    draw = random.Random(seed)  # noqa: S311 - of a test
    late = [now + round(draw.random() * jitter * PERIOD) for now in train(0, PERIOD)]
    assert looked_at(late, [PERIOD]) is None


def test_one_that_begins_to_jitter_in_turn_is_one():
    """10 ms, and then 7 and 13 in turn: a loaded machine."""
    even, odd = train(0, PERIOD), train(PERIOD // 2, PERIOD)
    shifted = [now if now < 1000 * MS else now - 3 * MS for now in odd]
    assert looked_at(even + shifted) is None


def test_a_period_that_is_changed_is_one_producer():
    slow = train(0, PERIOD, 1000 * MS)
    assert looked_at(slow + train(1000 * MS, PERIOD // 2), [PERIOD]) is None
