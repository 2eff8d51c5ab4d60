"""The needs of a requirement in a run: its time span, its signals, and that it can fail."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import fields
from enum import Enum
from itertools import combinations
from typing import Final

from hil_bench.abilities.recording.quantities import highest_of
from hil_bench.abilities.scenario import nodes
from hil_bench.abilities.scenario.nodes import Condition


def reach(node: Condition) -> int:
    """Return the time from the present tick that a condition needs at least [ns]."""
    ahead = max((reach(part) for part in parts_of(node)), default=0)
    if isinstance(node, nodes.Always | nodes.Eventually | nodes.Until):
        window = node.window
        ahead += window.start if window.end is None else window.end
    return ahead


def look_back(node: Condition) -> int:
    """Return the least time that must have passed before each window back holds a tick [ns]."""
    own = 0
    if isinstance(node, nodes.Historically | nodes.Once | nodes.Since):
        own = node.window.start
    return max((look_back(part) for part in parts_of(node)), default=0) + own


def breadth(node: Condition) -> int:
    """Return the sum of the times that all windows of a condition reach, ahead and back [ns]."""
    own = 0
    if isinstance(node, nodes.Windowed):
        own = node.window.start if node.window.end is None else node.window.end
    return own + sum(breadth(part) for part in parts_of(node))


def has_duration(node: Condition) -> bool:
    """Return True if the ticks at which a condition is false add up to a time.

    Those of an edge, an event or a window ahead are instants at which something else begins.
    """
    if isinstance(node, nodes.Always | nodes.Eventually | nodes.Until):
        return False
    if isinstance(node, nodes.Edge | nodes.ConditionEdge | nodes.Event):
        return False
    return all(has_duration(part) for part in parts_of(node))


class Asks(Enum):
    """The ticks at which a requirement wants something: all, any one, or a fixed one."""

    ALL = 1
    ANY = -1
    NEITHER = 0


def asks_for(node: Condition) -> Asks:
    """Return at which ticks of the run a requirement wants something."""
    match node:
        case nodes.Always():
            return Asks.ALL
        case nodes.Eventually():
            return Asks.ANY
        case nodes.Not():
            return Asks(-asks_for(node.operand).value)
        case nodes.All():
            found = {asks_for(each) for each in node.operands}
            return found.pop() if len(found) == 1 else Asks.NEITHER
        case _:
            return Asks.NEITHER


def parts_of(node: Condition) -> tuple[Condition, ...]:
    """Return the conditions of which one is made."""
    match node:
        case nodes.All() | nodes.Any():
            return node.operands
        case nodes.Implies():
            return node.trigger, node.response
        case nodes.Until() | nodes.Since():
            return node.operand, node.goal
        case nodes.Comparison() | nodes.StateIs() | nodes.Event() | nodes.Edge():
            return ()
        case _:
            return (node.operand,)


def survives_a_cut(node: Condition) -> bool:
    """Return True if any run that fulfils a condition fulfils it as well where it ends earlier.

    The earlier end is not before the condition's reach. An `eventually` without an end would fail
    there, a trigger might be missing, and a window in an `always` without an end would be open.
    """
    match node:
        case nodes.Implies():
            return False
        case nodes.Always():
            is_open = node.window.end is None and reach(node.operand) > 0
            return not is_open and survives_a_cut(node.operand)
        case nodes.Eventually() | nodes.Until():
            return node.window.end is not None and all(map(survives_a_cut, parts_of(node)))
        case nodes.All() | nodes.Any():
            return all(map(survives_a_cut, node.operands))
        case _:
            return not any(map(_looks_ahead, parts_of(node)))


def _looks_ahead(node: Condition) -> bool:
    """Return True if a condition depends on later ticks, or on a trigger."""
    is_ahead = isinstance(node, nodes.Always | nodes.Eventually | nodes.Until | nodes.Implies)
    return is_ahead or any(map(_looks_ahead, parts_of(node)))


def names_in(conditions: Iterable[Condition]) -> set[str]:
    """Return the names of all signals, states and events in some conditions."""
    return {
        node.name
        for node in walk(conditions)
        if isinstance(node, nodes.Reading | nodes.StateIs | nodes.Event)
    }


def walk(conditions: Iterable[Condition]) -> Iterator[object]:
    """Yield each piece of some conditions, values too."""
    waiting: list[object] = list(conditions)
    while waiting:
        node = waiting.pop()
        yield node
        if isinstance(node, nodes.Node):
            waiting += (getattr(node, each.name) for each in fields(node))
        elif isinstance(node, tuple):
            waiting += node


# Requirements that no run can violate. What is not seen here counts as one that can fail.


CERTAIN: Final = "cannot fail: no value that a machine can have violates it"


def is_certain(node: Condition, *, truth: bool = True) -> bool:
    """Return True if a condition has this truth with all values that a machine can have.

    It is found by the ranges of single signals and of their data types, by sums in which a signal
    falls out, and by a condition beside its contrary.
    """
    match node:
        case nodes.Comparison():
            return _is_certain_comparison(node, truth=truth)
        case nodes.Not():
            return is_certain(node.operand, truth=not truth)
        case nodes.Implies():
            no_trigger = nodes.Not(node.trigger, position=node.position)
            either = nodes.Any((no_trigger, node.response), position=node.position)
            return is_certain(either, truth=truth)
        case nodes.All() | nodes.Any():
            found = [is_certain(each, truth=truth) for each in node.operands]
            pairs = combinations(node.operands, 2)
            is_each = truth is isinstance(node, nodes.All)
            return (
                all(found) if is_each else any(found) or any(_are_contrary(*two) for two in pairs)
            )
        case nodes.Always() | nodes.Eventually():
            return is_certain(node.operand, truth=truth)
        case _:
            return False


_CONTRARY = {
    nodes.Relation.LESS: nodes.Relation.GREATER_EQUAL,
    nodes.Relation.GREATER: nodes.Relation.LESS_EQUAL,
    nodes.Relation.EQUAL: nodes.Relation.UNEQUAL,
}
_CONTRARY |= {contrary: relation for relation, contrary in _CONTRARY.items()}


def _are_contrary(one: Condition, other: Condition) -> bool:
    """Return True if one of two conditions is written as the contrary of the other."""
    match one, other:
        case nodes.Not(), _ if nodes.is_same(one.operand, other):
            return True
        case _, nodes.Not() if nodes.is_same(one, other.operand):
            return True
        case nodes.Comparison(), nodes.Comparison():
            are_alike = nodes.is_same(one.left, other.left) and nodes.is_same(
                one.right, other.right
            )
            return are_alike and _CONTRARY[one.relation] is other.relation
        case _:
            return False


def _is_certain_comparison(node: nodes.Comparison, *, truth: bool) -> bool:
    low, high = _difference(node.left, node.right)
    match node.relation if truth else _CONTRARY[node.relation]:
        case nodes.Relation.LESS:
            return high < 0.0
        case nodes.Relation.LESS_EQUAL:
            return high <= 0.0
        case nodes.Relation.GREATER:
            return low > 0.0
        case nodes.Relation.GREATER_EQUAL:
            return low >= 0.0
        case nodes.Relation.EQUAL:
            return low == high == 0.0
        case nodes.Relation.UNEQUAL:
            return low > 0.0 or high < 0.0


def _difference(left: nodes.Value, right: nodes.Value) -> tuple[float, float]:
    """Return the least and the largest difference of two values [SI]."""
    merged: list[tuple[float, nodes.Value]] = []
    for factor, term in (*_terms(left, 1.0), *_terms(right, -1.0)):
        place = next((i for i, (_, each) in enumerate(merged) if nodes.is_same(each, term)), None)
        if place is None:
            merged.append((factor, term))
        else:
            merged[place] = merged[place][0] + factor, term
    ends = [
        sorted((factor * low, factor * high))
        for factor, (low, high) in ((factor, _range(term)) for factor, term in merged if factor)
    ]
    return sum(low for low, _ in ends), sum(high for _, high in ends)


def _terms(value: nodes.Value, factor: float) -> Iterator[tuple[float, nodes.Value]]:
    """Yield the summands of a value with their factors."""
    match value:
        case nodes.Arithmetic(operation=nodes.Operation.ADD | nodes.Operation.SUBTRACT):
            yield from _terms(value.left, factor)
            sign = 1.0 if value.operation is nodes.Operation.ADD else -1.0
            yield from _terms(value.right, sign * factor)
        case nodes.Arithmetic(nodes.Operation.MULTIPLY, nodes.Number() as number, other):
            yield from _terms(other, number.value * factor)
        case nodes.Arithmetic(nodes.Operation.MULTIPLY, other, nodes.Number() as number):
            yield from _terms(other, number.value * factor)
        case nodes.Arithmetic(nodes.Operation.DIVIDE, other, nodes.Number() as number):
            yield from _terms(other, factor / number.value)
        case _:
            yield factor, value


def _range(value: nodes.Value) -> tuple[float, float]:
    """Return the least and the largest value of a summand [SI]."""
    match value:
        case nodes.Number():
            return value.value, value.value
        case nodes.Reading():
            highest = highest_of(value.name)
            return max(value.low, -highest), min(value.high, highest)
        case nodes.Magnitude():
            low, high = _difference(value.operand, nodes.Number(0.0, position=value.position))
            return max(0.0, low, -high), max(-low, high)
        case nodes.PreviousValue():
            return _difference(value.operand, nodes.Number(0.0, position=value.position))
        case _:
            return -math.inf, math.inf
