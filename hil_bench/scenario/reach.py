"""How far into a run a requirement looks before it can be decided."""

from hil_bench.scenario import nodes
from hil_bench.scenario.nodes import Condition


def reach(node: Condition) -> int:
    """Return the time from the present tick that a condition needs at least [ns]."""
    ahead = max((reach(part) for part in parts_of(node)), default=0)
    if isinstance(node, nodes.Always | nodes.Eventually | nodes.Until):
        window = node.window
        ahead += window.start if window.end is None else window.end
    return ahead


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
    """Return whether any run that fulfils a condition fulfils it as well where it ends earlier.

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
    """Return whether a condition depends on later ticks, or on a trigger."""
    is_ahead = isinstance(node, nodes.Always | nodes.Eventually | nodes.Until | nodes.Implies)
    return is_ahead or any(map(_looks_ahead, parts_of(node)))
