"""Random expectations, and RTAMT to hold our evaluator against; `referee` is another one.

RTAMT knows no unknown values, and cuts windows at the end of the trace, where ours leave the margin
open: its margin then lies between our bounds.
"""

import math
import warnings
from typing import NamedTuple

import numpy as np

from hil_bench.abilities.scenario.nodes import Vocabulary

TICK = 1_000_000
NAMES = ("a", "b", "c")
VOCABULARY = Vocabulary(dict.fromkeys(NAMES, "-"), {"s": {"OFF": 0, "ON": 1}}, ("n",), True)


class Case(NamedTuple):
    """A random expectation.

    Attributes:
        ours: in our language.
        theirs: in RTAMT's; a unit of time is a tick.
        reach: ticks ahead that decide it, but for what spans the run.
    """

    ours: str
    theirs: str
    reach: int


def random_case(rng: np.random.Generator, depth: int, *, for_rtamt: bool = False) -> Case:
    """Return an expectation of at most some depth."""
    if depth == 0 or rng.random() < 0.15:
        return _atom(rng, for_rtamt=for_rtamt)
    forms = [_contrary, _pair, _span, _span, _past, _past, _until, _until, _whole, _whole]
    if not for_rtamt and rng.random() < 0.2:
        forms = [_edge, _late]
    form = forms[rng.integers(len(forms))]
    parts = [random_case(rng, depth - 1, for_rtamt=for_rtamt) for _ in range(_PARTS.get(form, 1))]
    return form(rng, *parts)


def _contrary(_rng, one: Case) -> Case:
    return Case(f"not ({one.ours})", f"not ({one.theirs})", one.reach)


def _edge(rng, one: Case) -> Case:
    word = rng.choice(["previous", "rises", "falls", "changes"])
    return Case(f"{word}({one.ours})", "", one.reach)


def _pair(rng, one: Case, other: Case) -> Case:
    word = rng.choice(["and", "or", "implies"])
    reach = max(one.reach, other.reach)
    return Case(
        f"({one.ours}) {word} ({other.ours})", f"({one.theirs}) {word} ({other.theirs})", reach
    )


def _span(rng, one: Case) -> Case:
    word = rng.choice(["always", "eventually"])
    ours, theirs, end = _window(rng)
    return Case(f"{word} {ours} ({one.ours})", f"{word}{theirs} ({one.theirs})", one.reach + end)


def _past(rng, one: Case) -> Case:
    word = rng.choice(["historically", "once"])
    ours, theirs, _ = _window(rng)
    return Case(f"{word} {ours} ({one.ours})", f"{word}{theirs} ({one.theirs})", one.reach)


def _whole(rng, one: Case) -> Case:
    word = rng.choice(["always", "eventually", "historically", "once"])
    return Case(f"{word} ({one.ours})", f"{word} ({one.theirs})", one.reach)


def _late(rng, one: Case) -> Case:
    word = rng.choice(["always", "eventually", "historically", "once"])
    return Case(f"{word} after {rng.integers(4)} ms ({one.ours})", "", one.reach)


def _until(rng, one: Case, other: Case) -> Case:
    word = rng.choice(["until", "since"])
    ours, theirs, end = _window(rng) if rng.random() < 0.7 else ("", "", 0)
    return Case(
        f"({one.ours}) {word} {ours} ({other.ours})",
        f"({one.theirs}) {word}{theirs} ({other.theirs})",
        max(one.reach, other.reach) + (end if word == "until" else 0),
    )


_PARTS = {_pair: 2, _until: 2}


def random_trace(
    rng: np.random.Generator, ticks: int, *, holes: float = 0.0
) -> dict[str, np.ndarray]:
    """Return the columns of a short run, in quarters, with holes of NaN."""
    columns = {name: np.array([rng.integers(-12, 13) / 4 for _ in range(ticks)]) for name in NAMES}
    for name in ("s", "emcy(n)", "frame(0x181)"):
        columns[name] = np.array([float(rng.integers(2)) for _ in range(ticks)])
    for column in columns.values():
        for tick in range(ticks):
            if rng.random() < holes:
                column[tick] = math.nan
    return columns


def rtamt_margins(theirs: str, names=NAMES):
    """Return a function of columns, as lists or arrays, that gives RTAMT's margin of each tick."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # its parser imports typing.io
        import rtamt  # noqa: PLC0415 - a Python that has it not yet runs the other tests

    specification = rtamt.StlDiscreteTimeSpecification()
    for name in names:
        specification.declare_var(name, "float")
    specification.declare_var("out", "float")
    specification.spec = f"out = {theirs}"
    specification.parse()

    def evaluate(columns):
        data = {name: list(columns[name]) for name in names}
        data["time"] = list(range(len(data[names[0]])))
        return [value for _, value in specification.evaluate(data)]

    return evaluate


def _atom(rng: np.random.Generator, *, for_rtamt: bool) -> Case:
    name, relation, level = rng.choice(NAMES), rng.choice(["<=", ">="]), rng.integers(-1, 2)
    theirs = f"({name} {relation} {level})"
    if for_rtamt or rng.random() < 0.6:
        return Case(f"{name} {relation} {level}", theirs, 0)
    other = rng.choice(NAMES)
    ours = rng.choice(
        [
            f"{name} < {level}",
            f"{name} == {level}",
            f"{name} > {other} + 1",
            f"abs({name} - {other}) != 2",
            f"rate({name}) > 1000 Hz",
            f"previous({name}) * {other} >= {name} / 2",
            f"-1 < {name} <= 1",
            f"rises({name})",
            f"changes({name} - {other})",
            "changes(s)",
            's == "ON"',
            's != "ON"',
            "emcy(n)",
            "frame(0x181)",
        ]
    )
    return Case(ours, "", 0)


def _window(rng) -> tuple[str, str, int]:
    """Return a window in words, with bounds that may fall between ticks, and RTAMT's; its end."""
    start = rng.integers(4)
    end = start + rng.integers(5)
    early = rng.choice([0, 0, 250, 999]) if start else 0
    late = rng.choice([0, 0, 400, 999])
    if end == start:  # a window of a tick or longer, or of an instant
        early = late = 0
    ours = f"from {start * 1000 - early} us to {end * 1000 + late} us"
    return ours, f"[{start}:{end}]", int(end)
