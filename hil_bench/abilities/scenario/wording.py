"""Values, conditions and their readings as a person reads them."""

import math
from typing import Final

from hil_bench.abilities.scenario.dimensions import UNITS, Dimension, find_unit
from hil_bench.abilities.scenario.nodes import (
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
    Turn,
    Value,
)
from hil_bench.units import ONE, Unit

_TURNED: Final = {
    (Turn.RISES, True): "rose",
    (Turn.RISES, False): "did not rise",
    (Turn.FALLS, True): "fell",
    (Turn.FALLS, False): "did not fall",
    (Turn.CHANGES, True): "changed",
    (Turn.CHANGES, False): "did not change",
}
_MOST_DIGITS = 12
_NOTHING = 1e-300  # equal sides differ by the smallest double, so that the sign is kept
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
    return _with_unit(unit.from_si(value), 6, unit)


def show_reading(value: float, apart: float, unit: Unit) -> str:
    """Return an SI value in a unit: four digits, and more where it is close to something.

    Args:
        value: the value.
        apart: how far it is from what it is close to.
        unit: in which to show it.
    """
    more = math.log10(abs(value / apart)) if value and apart and math.isfinite(apart) else 0.0
    digits = min(_MOST_DIGITS, 4 + max(0, math.floor(more)))
    return _with_unit(unit.from_si(value), digits, unit)


def show_gap(value: float, unit: Unit) -> str:
    """Return an SI difference in a unit, in four digits; of equal sides a zero with its sign."""
    value = value if abs(value) >= _NOTHING else math.copysign(0.0, value)
    return _with_unit(unit.from_si(value), 4, unit)


def _with_unit(value: float, digits: int, unit: Unit) -> str:
    """Return a number with its unit; without an exponent where that is short."""
    symbol = f" {unit.symbol}" if unit is not ONE else ""
    if not 1e-4 <= abs(value) < 1e9:
        return f"{value:.{digits}g}{symbol}"
    places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    text = f"{value:.{places}f}"
    return f"{text.rstrip('0').rstrip('.') if places else text}{symbol}"


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


def show_fact(node: Atom, *, is_true: bool) -> str:
    """Return in words that a state, an event or an edge is there, or is not."""
    match node:
        case StateIs():
            return f"{node.name} was {'' if is_true else 'not '}{node.text}"
        case Edge():
            return f"{show_value(node.operand)} {_TURNED[node.turn, is_true]}"
        case _:
            return f"{show_atom(node)} was {'' if is_true else 'not '}seen"


def show_comparison(node: Comparison, left: float, right: float) -> str:
    """Return in words how both sides of a comparison stood [SI]."""
    unit = unit_of(node.dimension, node.symbol)
    sides = [(node.left, left), (node.right, right)]
    if isinstance(node.left, Number):
        sides.reverse()
    (subject, value), (limit, bound) = sides
    apart = value - bound
    name, text = _bare(show_value(subject, unit)), _bare(show_value(limit, unit))
    if not isinstance(limit, Number):
        text += f" ({show_reading(bound, apart, unit)})"
    if not apart:
        return f"{name} was exactly {text}"
    reading = show_reading(value, apart, unit)
    if not math.isfinite(apart):
        return f"{name} was {reading}"
    where = "below" if apart < 0.0 else "above"
    return f"{name} was {reading}, {show_gap(abs(apart), unit)} {where} {text}"


def _bare(text: str) -> str:
    """Return a sum or a product without the brackets around it."""
    return text[1:-1] if text.startswith("(") else text


def show_margin(margin: float, node: Atom) -> str:
    """Return a margin in the unit of the comparison that decides; empty where it has no size."""
    if not isinstance(node, Comparison) or not math.isfinite(margin):
        return ""
    return show_gap(margin * node.scale, unit_of(node.dimension, node.symbol))
