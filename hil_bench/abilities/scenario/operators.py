"""Arithmetic and comparisons of an expectation, with their units checked."""

from itertools import pairwise

from hil_bench import units
from hil_bench.abilities.scenario.dimensions import (
    NUMBER,
    REFERENCES,
    Dimension,
    multiply,
    show_dimension,
)
from hil_bench.abilities.scenario.nodes import (
    All,
    Arithmetic,
    Comparison,
    Condition,
    Not,
    Number,
    Operation,
    Relation,
    StateIs,
    is_same,
)
from hil_bench.abilities.scenario.operands import (
    MeasuredValue,
    Operand,
    State,
    Text,
    position_of,
    quantity_of,
)
from hil_bench.abilities.scenario.syntax import ExpectationError
from hil_bench.abilities.scenario.vocabulary import Vocabulary
from hil_bench.config.values import find_nearest, quote

_KNOWN_BASES = {"kg", "m", "s", "rad", units.CELSIUS.symbol}


def combine(operation: Operation, left: Operand, right: Operand) -> MeasuredValue:
    """Return the arithmetic of two values.

    Raises:
        ExpectationError: their units do not fit, or the divisor is 0.
    """
    one, other = quantity_of(left, operation), quantity_of(right, operation)
    position = one.node.position
    slack = 0.0
    if operation in {Operation.ADD, Operation.SUBTRACT}:
        slack = _smallest_of(one, other)
        dimension = common_dimension(one, other, f"{operation} of")
        symbol = one.symbol or other.symbol
    else:
        sign = 1 if operation is Operation.MULTIPLY else -1
        dimension = multiply(one.dimension, other.dimension, sign)
        symbol = next((q.symbol for q in (one, other) if q.dimension == dimension), "")
    if operation is Operation.DIVIDE and other.node_value == 0.0:
        raise ExpectationError(other.node.position, "divides by 0; give another divisor")
    if isinstance(one.node, Number) and isinstance(other.node, Number):
        value = _calculate(operation, one.node.value, other.node.value)
        return MeasuredValue(Number(value, position=position), dimension, symbol, slack)
    node = Arithmetic(operation, one.node, other.node, position=position)
    return MeasuredValue(node, dimension, symbol, slack)


def compare(operands: list[Operand], relations: list[Relation], known: Vocabulary) -> Condition:
    """Return a comparison; of ``a < b < c``, both."""
    parts = tuple(
        _compare(relation, left, right, known)
        for relation, (left, right) in zip(relations, pairwise(operands), strict=True)
    )
    return parts[0] if len(parts) == 1 else All(parts, position=parts[0].position)


def _smallest_of(*values: MeasuredValue) -> float:
    """Return the smallest constant term of some values [SI]; 0 for none."""
    return min((each.tolerance for each in values if each.tolerance), default=0.0)


def common_dimension(one: MeasuredValue, other: MeasuredValue, what: str) -> Dimension:
    """Return the common dimension of two values.

    Raises:
        ExpectationError: it is not.
    """
    if one.dimension == other.dimension or other.fits_all or _is_foreign(one, other):
        return one.dimension
    if one.fits_all or _is_foreign(other, one):
        return other.dimension
    right = "give both the same kind of unit"
    if NUMBER in {one.dimension, other.dimension}:
        right = "give the number its unit"
    raise ExpectationError(
        other.node.position,
        f"{what} a value {show_dimension(one.dimension)} and one "
        f"{show_dimension(other.dimension)} makes no sense; {right}".replace(
            "a value a ", "a "
        ).replace("one a ", "a "),
    )


def _is_foreign(signal: MeasuredValue, number: MeasuredValue) -> bool:
    """Return True if a plain number meets a signal in a unit that the language does not know."""
    bases = {base for base, _ in signal.dimension}
    is_plain = number.is_constant and number.dimension == NUMBER and not number.symbol
    return is_plain and not bases <= _KNOWN_BASES


def _calculate(operation: Operation, left: float, right: float) -> float:
    match operation:
        case Operation.ADD:
            return left + right
        case Operation.SUBTRACT:
            return left - right
        case Operation.MULTIPLY:
            return left * right
        case Operation.DIVIDE:
            return left / right


def _compare(relation: Relation, left: Operand, right: Operand, known: Vocabulary) -> Condition:
    if isinstance(left, State | Text) or isinstance(right, State | Text):
        return _compare_state(relation, left, right, known)
    one, other = quantity_of(left, relation), quantity_of(right, relation)
    dimension = common_dimension(one, other, f"comparing ({relation})")
    if one.is_constant and other.is_constant:
        raise ExpectationError(
            one.node.position, "compares no signal, so nothing can change it; give a signal"
        )
    if is_same(one.node, other.node):
        wrong = "compares a value with itself, which nothing can change; give another one"
        raise ExpectationError(one.node.position, wrong)
    constants = [each for each in (one, other) if each.is_constant]
    scale = _smallest_of(*(constants or (one, other)))
    return Comparison(
        relation,
        one.node,
        other.node,
        scale or REFERENCES.get(dimension, 1.0),
        one.symbol or other.symbol,
        dimension,
        position=one.node.position,
    )


def _compare_state(
    relation: Relation, left: Operand, right: Operand, known: Vocabulary
) -> Condition:
    state, text = (left, right) if isinstance(left, State) else (right, left)
    position = position_of(left)
    if not isinstance(state, State) or not isinstance(text, Text):
        wrong = "compares a state with something else than a text"
        raise ExpectationError(position, f'{wrong}; write it as in valve.state == "HOLD"')
    codes = known.states[state.name]
    if text.text not in codes:
        nearest = quote(find_nearest(text.text, codes))
        wrong = f"{state.name} is never {quote(text.text)}"
        raise ExpectationError(text.position, f"{wrong}; the nearest is {nearest}")
    if relation not in {Relation.EQUAL, Relation.UNEQUAL}:
        raise ExpectationError(position, f"{relation} cannot compare states; give == or !=")
    found = StateIs(state.name, text.text, codes[text.text], position=position)
    return found if relation is Relation.EQUAL else Not(found, position=position)
