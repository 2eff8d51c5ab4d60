"""The needs of a requirement in a run: its time span, and its signals."""

from collections.abc import Iterable, Iterator
from dataclasses import fields
from enum import Enum

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
