"""Our evaluator against RTAMT, and against itself in blocks; `referee` has the definitions."""

import re
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.expectations import (
    TICK,
    VOCABULARY,
    random_case,
    random_trace,
    rtamt_margins,
)

from hil_bench.abilities.scenario.monitor import AT_START, Monitor, StreamBuilder
from hil_bench.abilities.scenario.parse import parse_expectation
from hil_bench.abilities.scenario.values import Block

SPANS_THE_RUN = re.compile(r"(always|eventually|until) +\(")
NO_MARGIN = 1e-323  # where RTAMT says 0, ours is the smallest number either side of it
SEEDS = st.integers(0, 2**32)


def margins(node, columns, blocks=None):
    """Return lower and upper bound of each tick, the run given in blocks of some lengths."""
    stream = StreamBuilder(TICK).build(node, AT_START)
    found, start, ticks = [], 0, len(columns["a"])
    for size in blocks or [ticks]:
        end = min(start + size, ticks)
        part = {name: column[start:end] for name, column in columns.items()}
        found.append(stream.push(Block(part, end - start)))
        start = end
    found.append(stream.finish())
    return [pair for part in found for pair in zip(part.low, part.high, strict=True)]


@given(SEEDS)
@settings(max_examples=120, deadline=None)
def test_blocks_of_any_length_give_the_same(seed):
    rng = np.random.default_rng(seed)
    case = random_case(rng, int(rng.integers(0, 5)))
    ticks = int(rng.integers(1, 41))
    columns = random_trace(rng, ticks, holes=rng.choice([0.0, 0.1]))
    node = parse_expectation(case.ours, VOCABULARY)
    blocks = _blocks(rng, ticks)
    whole, parts = Monitor(node, TICK), Monitor(node, TICK)
    whole.push(columns, ticks)
    whole.finish()
    start = 0
    for size in blocks:
        parts.push({name: c[start : start + size] for name, c in columns.items()}, size)
        start += size
    parts.finish()
    assert (whole.margin, whole.exercises) == (parts.margin, parts.exercises), case.ours
    assert margins(node, columns, blocks) == margins(node, columns), case.ours
    assert margins(node, columns)[0] == whole.margin


@pytest.mark.skipif(sys.version_info >= (3, 13), reason="RTAMT 0.4 ends with Python 3.12")
@given(SEEDS)
@settings(max_examples=40, deadline=None)
def test_rtamt_says_the_same(seed):
    rng = np.random.default_rng(seed)
    case = random_case(rng, int(rng.integers(1, 5)), for_rtamt=True)
    columns = random_trace(rng, case.reach + int(rng.integers(2, 21)))  # of one tick, RTAMT fails
    node = parse_expectation(case.ours, VOCABULARY)
    theirs = rtamt_margins(case.theirs)(columns)
    ours = margins(node, columns)
    for (low, high), expected in zip(ours, theirs, strict=True):
        assert low - NO_MARGIN <= expected <= high + NO_MARGIN, (case.ours, case.theirs)
    if not SPANS_THE_RUN.search(case.ours):
        decided = len(theirs) - case.reach
        assert all(low == high for low, high in ours[:decided])


def _blocks(rng, ticks):
    blocks = []
    while sum(blocks) < ticks:
        blocks.append(min(int(rng.integers(1, 10)), ticks - sum(blocks)))
    return blocks
