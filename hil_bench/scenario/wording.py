"""Values, conditions and their readings as a person reads them."""

import math

from hil_bench.scenario.dimensions import UNITS, Dimension, find_unit
from hil_bench.scenario.nodes import (
    Arithmetic,
    Atom,
    Comparison,
    ConditionEdge,
    Edge,
    Event,
    Magnitude,
    Number,
    PreviousValue,
    Rate,
    Reading,
    StateIs,
    Value,
)
from hil_bench.units import ONE, Unit

_USUAL = ("bar", "mm", "mm/s", "s", "N", "bar/s", "l/min")


def unit_of(dimension: Dimension, symbol: str) -> Unit:
    """Return the unit in which to show a value: the one that the text gives, or a usual one."""
    found = find_unit(symbol) if symbol else None
    if found is not None and found.dimension == dimension:
        return found.unit
    for usual in _USUAL:
        if UNITS[usual].dimension == dimension:
            return UNITS[usual].unit
    return next((each.unit for each in UNITS.values() if each.dimension == dimension), ONE)


def show_number(value: float, unit: Unit) -> str:
    """Return an SI value in a unit, in six digits."""
    symbol = f" {unit.symbol}" if unit is not ONE else ""
    return f"{unit.from_si(value):.6g}{symbol}"


def show_value(node: Value, unit: Unit = ONE) -> str:
    """Return a value in the words of the language; its constants in a unit."""
    match node:
        case Number():
            return show_number(node.value, unit)
        case Reading():
            return node.name
        case Magnitude():
            return f"abs({_bare(show_value(node.operand, unit))})"
        case Rate():
            return f"rate({show_value(node.operand)})"
        case PreviousValue():
            return f"previous({show_value(node.operand, unit)})"
        case Arithmetic():
            inner = unit if node.operation in "+-" else ONE
            left, right = show_value(node.left, inner), show_value(node.right, inner)
            return f"({left} {node.operation} {right})"


def show_atom(node: Atom) -> str:
    """Return a condition without parts in the words of the language."""
    match node:
        case Comparison():
            unit = unit_of(node.dimension, node.symbol)
            left, right = (_bare(show_value(side, unit)) for side in (node.left, node.right))
            return f"{left} {node.relation} {right}"
        case StateIs():
            return f'{node.name} == "{node.text}"'
        case Event():
            return node.name
        case Edge():
            return f"{node.turn}({show_value(node.operand)})"
        case ConditionEdge():
            return f"{node.turn}(...)"


def _bare(text: str) -> str:
    """Return a sum or a product without the brackets around it."""
    return text[1:-1] if text.startswith("(") else text


def show_margin(margin: float, node: Atom) -> str:
    """Return a margin in the unit of the comparison that decides; empty where it has no size."""
    if not isinstance(node, Comparison) or not math.isfinite(margin):
        return ""
    return show_number(margin * node.scale, unit_of(node.dimension, node.symbol))
