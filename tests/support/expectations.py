"""Random expectations, and two evaluators to hold ours against.

`margin` follows the definitions of docs/expectations.md word by word, tick by tick, in quadratic
time. RTAMT is another tool's evaluator; it knows no unknown values, and cuts windows at the end of
the trace, where ours leave the margin open: its margin then lies between our bounds.
"""

import math
import random
import warnings
from typing import NamedTuple

import numpy as np

from hil_bench.scenario import nodes
from hil_bench.scenario.vocabulary import Vocabulary

TICK = 1_000_000
NAMES = ("a", "b", "c")
VOCABULARY = Vocabulary(dict.fromkeys(NAMES, "-"), {"s": {"OFF": 0, "ON": 1}}, ("n",), True)
_END = (-math.inf, math.inf)  # what is known behind the end of a run


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


def random_case(rng: random.Random, depth: int, *, for_rtamt: bool = False) -> Case:
    """Return an expectation of at most some depth."""
    if depth == 0 or rng.random() < 0.15:
        return _atom(rng, for_rtamt=for_rtamt)
    pick = rng.choice(
        ["not", "and", "or", "implies", "span", "span", "past", "past", "until", "since"]
        + ["whole", "from start"]
        + ([] if for_rtamt else ["previous", "edge"])
    )
    one = random_case(rng, depth - 1, for_rtamt=for_rtamt)
    start = rng.randint(0, 3)
    end = start + rng.randint(0, 4)
    match pick:
        case "not":
            return Case(f"not ({one.ours})", f"not ({one.theirs})", one.reach)
        case "previous" | "edge":
            word = "previous" if pick == "previous" else rng.choice(["rises", "falls", "changes"])
            return Case(f"{word}({one.ours})", "", one.reach)
        case "span":
            word = rng.choice(["always", "eventually"])
            ours = f"{word} from {_jitter(rng, start, end)} ({one.ours})"
            return Case(ours, f"{word}[{start}:{end}] ({one.theirs})", one.reach + end)
        case "past":
            word = rng.choice(["historically", "once"])
            ours = f"{word} from {_jitter(rng, start, end)} ({one.ours})"
            return Case(ours, f"{word}[{start}:{end}] ({one.theirs})", one.reach)
        case "whole":
            word = rng.choice(["always", "eventually"])
            return Case(f"{word} ({one.ours})", f"{word} ({one.theirs})", one.reach)
        case "from start":
            word = rng.choice(["historically", "once"])
            return Case(f"{word} ({one.ours})", f"{word} ({one.theirs})", one.reach)
    other = random_case(rng, depth - 1, for_rtamt=for_rtamt)
    reach = max(one.reach, other.reach)
    if pick in {"until", "since"}:
        window, theirs = f"from {_jitter(rng, start, end)}", f"[{start}:{end}]"
        if rng.random() < 0.3:
            window, theirs, end = "", "", 0
        ahead = end if pick == "until" else 0
        return Case(
            f"({one.ours}) {pick} {window} ({other.ours})",
            f"({one.theirs}) {pick}{theirs} ({other.theirs})",
            reach + ahead,
        )
    return Case(
        f"({one.ours}) {pick} ({other.ours})", f"({one.theirs}) {pick} ({other.theirs})", reach
    )


def random_trace(rng: random.Random, ticks: int, *, holes: float = 0.0) -> dict[str, np.ndarray]:
    """Return the columns of a short run, in quarters, with holes of NaN."""
    columns = {
        name: np.array([rng.randint(-12, 12) / 4 for _ in range(ticks)]) for name in NAMES
    }
    for name in ("s", "emcy(n)", "frame(0x181)"):
        columns[name] = np.array([float(rng.randint(0, 1)) for _ in range(ticks)])
    for column in columns.values():
        for tick in range(ticks):
            if rng.random() < holes:
                column[tick] = math.nan
    return columns


def rtamt_margins(theirs: str):
    """Return a function of columns that gives RTAMT's margin of each tick."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # its parser imports typing.io
        import rtamt

    specification = rtamt.StlDiscreteTimeSpecification()
    for name in NAMES:
        specification.declare_var(name, "float")
    specification.declare_var("out", "float")
    specification.spec = f"out = {theirs}"
    specification.parse()

    def evaluate(columns):
        ticks = len(columns["a"])
        data = {"time": list(range(ticks))} | {name: columns[name].tolist() for name in NAMES}
        return [value for _, value in specification.evaluate(data)]

    return evaluate


def _atom(rng: random.Random, *, for_rtamt: bool) -> Case:
    name, relation, level = rng.choice(NAMES), rng.choice(["<=", ">="]), rng.randint(-1, 1)
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


def _jitter(rng: random.Random, start: int, end: int) -> str:
    """Return a window in words, with bounds between ticks that hold the same ticks."""
    early = rng.choice([0, 0, 250, 999]) if start else 0
    return f"{start * 1000 - early} us to {end * 1000 + rng.choice([0, 0, 400, 999])} us"


# The oracle, by the definitions.


def margin(node, tick: int, columns, ticks: int, memo: dict) -> tuple[float, float]:
    """Return the bounds of a condition's margin at a tick."""
    if tick >= ticks:
        return _END
    key = (id(node), tick)
    if key not in memo:
        memo[key] = _margin(node, tick, columns, ticks, memo)
    return memo[key]


def _margin(node, tick, columns, ticks, memo):
    def at(operand, when):
        return margin(operand, when, columns, ticks, memo)

    def ahead(window):
        last = ticks - 1 if window.end is None else tick + window.end // TICK
        return [k for k in range(tick, last + 1) if (k - tick) * TICK >= window.start]

    def back(window):
        first = 0 if window.end is None else tick - window.end // TICK
        return [k for k in range(max(0, first), tick + 1) if (tick - k) * TICK >= window.start]

    match node:
        case nodes.Not():
            low, high = at(node.operand, tick)
            return -high, -low
        case nodes.All():
            return _least([at(each, tick) for each in node.operands])
        case nodes.Any():
            return _most([at(each, tick) for each in node.operands])
        case nodes.Implies():
            low, high = at(node.trigger, tick)
            return _most([(-high, -low), at(node.response, tick)])
        case nodes.PreviousCondition():
            return at(node.operand, max(0, tick - 1))
        case nodes.ConditionEdge():
            return _turn(node.turn, at(node.operand, tick), at(node.operand, max(0, tick - 1)))
        case nodes.Always():
            return _least([at(node.operand, k) for k in ahead(node.window)] or [_END])
        case nodes.Eventually():
            return _most([at(node.operand, k) for k in ahead(node.window)] or [_END])
        case nodes.Historically():
            return _least([at(node.operand, k) for k in back(node.window)])
        case nodes.Once():
            return _most([at(node.operand, k) for k in back(node.window)])
        case nodes.Until():
            found = [
                _least([at(node.goal, k), *(at(node.operand, j) for j in range(tick, k))])
                for k in ahead(node.window)
            ]
            return _most(found)
        case nodes.Since():
            found = [
                _least([at(node.goal, k), *(at(node.operand, j) for j in range(k + 1, tick + 1))])
                for k in back(node.window)
            ]
            return _most(found)
        case _:
            return _atom_margin(node, tick, columns)


def _least(pairs):
    return min([math.inf, *(a for a, _ in pairs)]), min([math.inf, *(b for _, b in pairs)])


def _most(pairs):
    return max([-math.inf, *(a for a, _ in pairs)]), max([-math.inf, *(b for _, b in pairs)])


def _turn(turn, now, before):
    if any(low < 0 < high for low, high in (now, before)):
        return _END
    one, other = now[0] > 0, before[0] > 0
    is_true = {"rises": one and not other, "falls": other and not one, "changes": one != other}
    return (math.inf, math.inf) if is_true[turn] else (-math.inf, -math.inf)


def _atom_margin(node, tick, columns):
    match node:
        case nodes.Comparison():
            left, right = (_value(side, tick, columns) for side in (node.left, node.right))
            if math.isnan(left) or math.isnan(right):
                return _END
            is_true = {
                "<": left < right,
                "<=": left <= right,
                ">": left > right,
                ">=": left >= right,
                "==": left == right,
                "!=": left != right,
            }[node.relation]
            size = abs(left - right) / node.scale or 5e-324
        case nodes.Edge():
            now, before = (_value(node.operand, k, columns) for k in (tick, max(0, tick - 1)))
            if math.isnan(now) or math.isnan(before):
                return _END
            pairs = {"rises": now > before, "falls": now < before, "changes": now != before}
            is_true, size = pairs[node.turn], math.inf
        case _:
            value = columns[node.name][tick]
            if math.isnan(value):
                return _END
            is_true = value == node.code if isinstance(node, nodes.StateIs) else value > 0
            size = math.inf
    return (size, size) if is_true else (-size, -size)


def _value(node, tick, columns):
    match node:
        case nodes.Number():
            return node.value
        case nodes.Reading():
            return float(columns[node.name][tick])
        case nodes.Magnitude():
            return abs(_value(node.operand, tick, columns))
        case nodes.PreviousValue():
            return _value(node.operand, max(0, tick - 1), columns)
        case nodes.Rate():
            now, before = (_value(node.operand, k, columns) for k in (tick, max(0, tick - 1)))
            return (now - before) * 1000.0
        case nodes.Arithmetic():
            left, right = (_value(side, tick, columns) for side in (node.left, node.right))
            match node.operation:
                case "+":
                    return left + right
                case "-":
                    return left - right
                case "*":
                    return left * right
                case _:
                    return left / right if right else math.nan
    raise TypeError(node)
