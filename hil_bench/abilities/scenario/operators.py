"""Operators, functions and events of an expectation, with their units checked."""

from collections.abc import Callable, Collection, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import Final, NamedTuple

from hil_bench import units
from hil_bench.abilities.j1939.protocol.diagnostics import HIGHEST_FMI, HIGHEST_SPN
from hil_bench.abilities.scenario import dimensions, nodes, syntax
from hil_bench.config.values import find_nearest, quote

# Arithmetic and comparisons of an expectation, with their units checked.

_KNOWN_BASES = {"kg", "m", "s", "rad", units.CELSIUS.symbol}


def combine(
    operation: nodes.Operation, left: syntax.Operand, right: syntax.Operand
) -> syntax.MeasuredValue:
    """Return the arithmetic of two values.

    Raises:
        ExpectationError: their units do not fit, or the divisor is 0.
    """
    one, other = syntax.quantity_of(left, operation), syntax.quantity_of(right, operation)
    position = one.node.position
    slack = 0.0
    if operation in {nodes.Operation.ADD, nodes.Operation.SUBTRACT}:
        slack = _smallest_of(one, other)
        dimension = common_dimension(one, other, f"{operation} of")
        symbol = one.symbol or other.symbol
    else:
        sign = 1 if operation is nodes.Operation.MULTIPLY else -1
        dimension = dimensions.multiply(one.dimension, other.dimension, sign)
        symbol = next((q.symbol for q in (one, other) if q.dimension == dimension), "")
    if operation is nodes.Operation.DIVIDE and other.node_value == 0.0:
        raise syntax.ExpectationError(other.node.position, "divides by 0; give another divisor")
    if isinstance(one.node, nodes.Number) and isinstance(other.node, nodes.Number):
        value = _calculate(operation, one.node.value, other.node.value)
        return syntax.MeasuredValue(
            nodes.Number(value, position=position), dimension, symbol, slack
        )
    node = nodes.Arithmetic(operation, one.node, other.node, position=position)
    return syntax.MeasuredValue(node, dimension, symbol, slack)


def compare(
    operands: list[syntax.Operand], relations: list[nodes.Relation], known: nodes.Vocabulary
) -> nodes.Condition:
    """Return a comparison; of ``a < b < c``, both."""
    parts = tuple(
        _compare(relation, left, right, known)
        for relation, (left, right) in zip(relations, pairwise(operands), strict=True)
    )
    return parts[0] if len(parts) == 1 else nodes.All(parts, position=parts[0].position)


def _smallest_of(*values: syntax.MeasuredValue) -> float:
    """Return the smallest constant term of some values [SI]; 0 for none."""
    return min((each.tolerance for each in values if each.tolerance), default=0.0)


def common_dimension(
    one: syntax.MeasuredValue, other: syntax.MeasuredValue, what: str
) -> dimensions.Dimension:
    """Return the common dimension of two values.

    Raises:
        ExpectationError: it is not.
    """
    if one.dimension == other.dimension or other.fits_all or _is_foreign(one, other):
        return one.dimension
    if one.fits_all or _is_foreign(other, one):
        return other.dimension
    right = "give both the same kind of unit"
    if dimensions.NUMBER in {one.dimension, other.dimension}:
        right = "give the number its unit"
    for base, _ in (*one.dimension, *other.dimension):
        if base not in _KNOWN_BASES:
            wrong = f"{base} is no unit here; " if base else ""
            right = f"{wrong}name its unit, as --map of 'hil-bench judge' does"
    raise syntax.ExpectationError(
        other.node.position,
        f"{what} a value {dimensions.show_dimension(one.dimension)} and one "
        f"{dimensions.show_dimension(other.dimension)} makes no sense; {right}".replace(
            "a value a ", "a "
        ).replace("one a ", "a "),
    )


def _is_foreign(signal: syntax.MeasuredValue, number: syntax.MeasuredValue) -> bool:
    """Return True if a plain number meets a signal in a unit that the language does not know."""
    bases = {base for base, _ in signal.dimension}
    is_plain = number.is_constant and number.dimension == dimensions.NUMBER and not number.symbol
    return is_plain and not bases <= _KNOWN_BASES


def _calculate(operation: nodes.Operation, left: float, right: float) -> float:
    match operation:
        case nodes.Operation.ADD:
            return left + right
        case nodes.Operation.SUBTRACT:
            return left - right
        case nodes.Operation.MULTIPLY:
            return left * right
        case nodes.Operation.DIVIDE:
            return left / right


def _compare(
    relation: nodes.Relation, left: syntax.Operand, right: syntax.Operand, known: nodes.Vocabulary
) -> nodes.Condition:
    if isinstance(left, syntax.State | syntax.Text) or isinstance(
        right, syntax.State | syntax.Text
    ):
        return _compare_state(relation, left, right, known)
    one, other = syntax.quantity_of(left, relation), syntax.quantity_of(right, relation)
    dimension = common_dimension(one, other, f"comparing ({relation})")
    if one.is_constant and other.is_constant:
        raise syntax.ExpectationError(
            one.node.position, "compares no signal, so nothing can change it; give a signal"
        )
    if nodes.is_same(one.node, other.node):
        wrong = "compares a value with itself, which nothing can change; give another one"
        raise syntax.ExpectationError(one.node.position, wrong)
    constants = [each for each in (one, other) if each.is_constant]
    scale = _smallest_of(*(constants or (one, other)))
    return nodes.Comparison(
        relation,
        one.node,
        other.node,
        scale or dimensions.REFERENCES.get(dimension, 1.0),
        one.symbol or other.symbol,
        dimension,
        position=one.node.position,
    )


def _compare_state(
    relation: nodes.Relation, left: syntax.Operand, right: syntax.Operand, known: nodes.Vocabulary
) -> nodes.Condition:
    state, text = (left, right) if isinstance(left, syntax.State) else (right, left)
    position = syntax.position_of(left)
    if not isinstance(state, syntax.State) or not isinstance(text, syntax.Text):
        wrong = "compares a state with something else than a text"
        raise syntax.ExpectationError(position, f'{wrong}; write it as in valve.state == "HOLD"')
    codes = known.states[state.name]
    if text.text not in codes:
        nearest = quote(find_nearest(text.text, codes))
        wrong = f"{state.name} is never {quote(text.text)}"
        raise syntax.ExpectationError(text.position, f"{wrong}; the nearest is {nearest}")
    if relation not in {nodes.Relation.EQUAL, nodes.Relation.UNEQUAL}:
        raise syntax.ExpectationError(position, f"{relation} cannot compare states; give == or !=")
    found = nodes.StateIs(state.name, text.text, codes[text.text], position=position)
    return found if relation is nodes.Relation.EQUAL else nodes.Not(found, position=position)


# The functions and events of an expectation: ``abs(x)``, ``rises(x)``, ``emcy(valve)``.


class Arguments(NamedTuple):
    """The arguments of a call.

    Attributes:
        given: the operands in its brackets.
        position: where it begins.
        known: the names that it may use.
    """

    given: Sequence[syntax.Operand]
    position: nodes.Position
    known: nodes.Vocabulary

    def take_one(self, form: str) -> syntax.Operand:
        """Return the only operand.

        Raises:
            ExpectationError: there are more, or none.
        """
        if len(self.given) != 1:
            wrong = f"takes 1 value, not {len(self.given)}"
            raise syntax.ExpectationError(self.position, f"{wrong}; write {form}")
        return self.given[0]


Call = Callable[[Arguments], syntax.Operand]

_NANOSECOND = 1e-9
_HIGHEST_ID = 0x1FFFFFFF
_NO_SIGNAL = "holds no signal, so nothing can change it; give a signal"


def _abs(call: Arguments) -> syntax.Operand:
    operand, position = call.take_one("abs(x)"), call.position
    found = syntax.quantity_of(operand, "abs")
    if isinstance(found.node, nodes.Number):
        return found._replace(
            node=nodes.Number(abs(found.node.value), position=position), slack=0.0
        )
    return found._replace(node=nodes.Magnitude(found.node, position=position), slack=0.0)


def _rate(call: Arguments) -> syntax.Operand:
    operand, position = call.take_one("rate(x)"), call.position
    found = syntax.quantity_of(operand, "rate")
    if found.is_constant:
        raise syntax.ExpectationError(position, f"rate {_NO_SIGNAL}")
    return syntax.MeasuredValue(
        nodes.Rate(found.node, position=position),
        dimensions.multiply(found.dimension, dimensions.TIME, -1),
    )


def _previous(call: Arguments) -> syntax.Operand:
    operand, position = call.take_one("previous(x)"), call.position
    if isinstance(operand, nodes.Node):
        return nodes.PreviousCondition(operand, position=position)
    found = syntax.quantity_of(operand, "previous")
    if found.is_constant:
        raise syntax.ExpectationError(position, f"previous {_NO_SIGNAL}")
    return found._replace(node=nodes.PreviousValue(found.node, position=position), slack=0.0)


def _edge(turn: nodes.Turn) -> Call:
    def build(call: Arguments) -> syntax.Operand:
        operand, position = call.take_one(f"{turn}(x)"), call.position
        if isinstance(operand, syntax.State):
            return _state_edge(turn, operand, position)
        if isinstance(operand, nodes.Node):
            return nodes.ConditionEdge(turn, operand, position=position)
        found = syntax.quantity_of(operand, turn)
        if found.is_constant:
            raise syntax.ExpectationError(position, f"{turn} {_NO_SIGNAL}")
        return nodes.Edge(turn, found.node, position=position)

    return build


def _state_edge(turn: nodes.Turn, state: syntax.State, position: nodes.Position) -> syntax.Operand:
    if turn is not nodes.Turn.CHANGES:
        right = f'give changes({state.name}), or {turn}({state.name} == "...")'
        raise syntax.ExpectationError(position, f"a state neither rises nor falls; {right}")
    return nodes.Edge(turn, nodes.Reading(state.name, position=state.position), position=position)


def _settled(call: Arguments) -> syntax.Operand:
    given, position, known = call
    form = "settled(deviation, band) or settled(deviation, band, time)"
    if len(given) not in {2, 3}:
        raise syntax.ExpectationError(position, f"settled takes 2 or 3 values; write {form}")
    inside = compare(
        [_abs(call._replace(given=given[:1])), given[1]], [nodes.Relation.LESS_EQUAL], known
    )
    if not isinstance(inside, nodes.Comparison):  # a state, which `quantity_of` has refused
        raise syntax.ExpectationError(position, f"settled needs a deviation; write {form}")
    window = nodes.UNBOUNDED
    if len(given) == 3:
        time = syntax.quantity_of(given[2], "settled")
        if time.node_value is None or time.dimension != dimensions.TIME or time.node_value < 0:
            raise syntax.ExpectationError(time.node.position, "is no time; give for example 200 ms")
        window = nodes.Window(0, round(time.node_value / _NANOSECOND))
    return nodes.Always(window, inside, position=position)


def _require(name: syntax.Text, known: Collection[str], what: str, without: str) -> None:
    """Refuse a name that is not known.

    Raises:
        ExpectationError: it says the nearest, or `without` where there is none.
    """
    if name.text not in known:
        right = f"the nearest is {find_nearest(name.text, known)}" if known else without
        raise syntax.ExpectationError(name.position, f"{quote(name.text)} is no {what}; {right}")


def _emcy(call: Arguments) -> syntax.Operand:
    given, position, known = call
    form = "emcy(NODE) or emcy(NODE, 0x8110)"
    if not 1 <= len(given) <= 2 or not isinstance(given[0], syntax.Text):
        raise syntax.ExpectationError(position, f"emcy takes the name of a node; write {form}")
    node = given[0]
    _require(node, known.nodes, "node", "there are no nodes here")
    code = f", 0x{_whole(given[1], 0xFFFF, form):04X}" if len(given) == 2 else ""
    return nodes.Event(f"{nodes.EMCY}({node.text}{code})", position=position)


def _dm1(call: Arguments) -> syntax.Operand:
    given, position, known = call
    form = "dm1(DEVICE), dm1(DEVICE, 1907) or dm1(DEVICE, 1907, 9)"
    if not 1 <= len(given) <= 3 or not isinstance(given[0], syntax.Text):
        raise syntax.ExpectationError(
            position, f"dm1 takes the name of a J1939 device; write {form}"
        )
    device = given[0]
    _require(device, known.ecus, "J1939 device", "there are none here")
    limits = (HIGHEST_SPN, HIGHEST_FMI)
    numbers = [_whole(each, high, form) for each, high in zip(given[1:], limits, strict=False)]
    name = ", ".join([device.text, *map(str, numbers)])
    return nodes.Event(f"{nodes.DM1}({name})", position=position)


def _frame(call: Arguments) -> syntax.Operand:
    operand, position = call.take_one("frame(0x181)"), call.position
    if not call.known.has_frames:
        raise syntax.ExpectationError(position, "there are no frames here; give a signal")
    return nodes.Event(
        f"{nodes.FRAME}(0x{_whole(operand, _HIGHEST_ID, 'frame(0x181)'):X})", position=position
    )


def _whole(operand: syntax.Operand, highest: int, form: str) -> int:
    value = syntax.quantity_of(operand, "this").node_value
    if value is None or value != int(value) or not 0 <= value <= highest:
        where = syntax.quantity_of(operand, "this").node.position
        raise syntax.ExpectationError(
            where, f"is no number from 0 to 0x{highest:X}; write it as in {form}"
        )
    return int(value)


CALLS: Final = MappingProxyType(
    {
        "abs": _abs,
        "rate": _rate,
        "previous": _previous,
        "settled": _settled,
        **{turn.value: _edge(turn) for turn in nodes.Turn},
        nodes.EMCY: _emcy,
        nodes.DM1: _dm1,
        nodes.FRAME: _frame,
    }
)
"""Each function by its name."""
