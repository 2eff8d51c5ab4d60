"""The product's verdict on a case, beside the referee's."""

import math
import random
from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from referee.cases import Case, bits
from referee.evaluator import FAILED, INCONCLUSIVE, Ruling, Run

from hil_bench.scenario.judgement import Judgement, judge
from hil_bench.scenario.monitor import Monitor
from hil_bench.scenario.parse import parse_expectation
from hil_bench.scenario.vocabulary import Vocabulary

SI = {
    "pressure": "Pa",
    "length": "m",
    "speed": "m/s",
    "pressure rate": "Pa/s",
    "force": "N",
    "time": "s",
    "flow": "m³/s",
    "plain": "-",
}
"""The symbol of the SI unit of each kind."""


def ruling_of(case: Case) -> Ruling:
    """Return what the referee says."""
    return Run(case.values(), case.ticks, case.tick).rule(case.tree)


def disagreements(case: Case) -> Iterator[str]:
    """Yield each point in which the product and the referee differ on a case."""
    ruling = ruling_of(case)
    parameters = {name: float(number.size) for name, number in case.parameters.items()}
    vocabulary = Vocabulary({n: SI[k] for n, k in case.kinds.items()}, parameters=parameters)
    requirement = parse_expectation(case.text, vocabulary)
    columns = {name: np.array([bits(x) for x in c]) for name, c in case.values().items()}
    tick_ns = int(case.tick * 10**9)
    judgement = judge(requirement, columns, ticks=case.ticks, tick_ns=tick_ns)
    yield from differences(ruling, judgement, case.tick)
    monitor = Monitor(requirement, tick_ns)
    start, chance = 0, random.Random(case.number)  # noqa: S311 - a sample, no secret
    while start < case.ticks:
        end = min(start + chance.randrange(1, 10), case.ticks)
        monitor.push({name: c[start:end] for name, c in columns.items()}, end - start)
        low, high = monitor.margin
        if low > upper(ruling.margin.low) or high < lower(ruling.margin.high):
            yield f"monitor: after {end} ticks bounds that are too narrow: {low}, {high}"
        start = end
    monitor.finish()
    for name, ours, theirs in zip(("low", "high"), monitor.margin, ruling.margin, strict=True):
        if not is_margin(ours, theirs):
            yield f"monitor: {name} {ours}, the referee says {theirs}"


def differences(ruling: Ruling, judgement: Judgement, tick: Fraction) -> Iterator[str]:
    """Yield each point in which a judgement and the referee's ruling differ."""
    if judgement.outcome != ruling.outcome:
        yield f"{judgement.outcome}, the referee says {ruling.outcome}"
        return
    if judgement.triggered != ruling.triggered:
        yield f"triggered {judgement.triggered} times, the referee says {ruling.triggered}"
    if ruling.outcome == INCONCLUSIVE:
        if judgement.margin is not None:
            yield f"margin {judgement.margin} of what is not decided"
        return
    bound = ruling.margin.high if ruling.outcome == FAILED else ruling.margin.low
    size = math.inf if judgement.margin is None else judgement.margin
    if not is_margin(math.copysign(size, bound[1]), bound):
        yield f"margin {size}, the referee says {bound}"
    if ruling.first is not None and not is_close(judgement.first, ruling.first * tick):
        yield f"first violated at {judgement.first} s, the referee says {ruling.first} ticks"
    if ruling.first is not None and not is_close(judgement.duration, ruling.violated * tick):
        yield f"violated for {judgement.duration} s, the referee says {ruling.violated} ticks"


def is_close(one: float | None, other: float | Fraction) -> bool:
    """Return whether two numbers are the same but for rounding."""
    return one is not None and math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-12)


def is_margin(ours: float, theirs: tuple) -> bool:
    """Return whether a margin is the referee's, sign and all."""
    size, sign = theirs
    return (ours > 0) == (sign > 0) and math.isclose(ours, size, rel_tol=1e-9, abs_tol=1e-9)


def upper(bound: tuple) -> float:
    return float(bound[0]) + 1e-9


def lower(bound: tuple) -> float:
    return float(bound[0]) - 1e-9
