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
