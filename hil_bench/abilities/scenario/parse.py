"""The tree of words to the typed tree: names looked up, units converted and compared."""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, cast

from hil_bench.abilities.scenario import dimensions, nodes, syntax
from hil_bench.abilities.scenario.operators import CALLS, Arguments, combine, compare
from hil_bench.config.values import find_nearest, quote

if TYPE_CHECKING:
    from lark import Token, Tree

_LONGEST_TIME = 1e9  # [s]
_Span = nodes.Always | nodes.Eventually | nodes.Historically | nodes.Once
_SPANS: Final[Mapping[str, type[_Span]]] = MappingProxyType(
    {
        "always": nodes.Always,
        "eventually": nodes.Eventually,
        "historically": nodes.Historically,
        "once": nodes.Once,
    }
)
_TIMED: Final[Mapping[str, type[_Span]]] = MappingProxyType(
    {
        "within": nodes.Eventually,
        "for_": nodes.Always,
        "for_the_last": nodes.Historically,
        "within_the_last": nodes.Once,
    }
)
_OPERATIONS = MappingProxyType(
    {
        "add": nodes.Operation.ADD,
        "subtract": nodes.Operation.SUBTRACT,
        "multiply": nodes.Operation.MULTIPLY,
        "divide": nodes.Operation.DIVIDE,
    }
)


def parse_expectation(text: str, vocabulary: nodes.Vocabulary) -> nodes.Condition:
    """Return the typed tree of an expectation.

    Args:
        text: in the language of docs/expectations.md.
        vocabulary: the names it may use.

    What is wrong raises an `ExpectationError`, with line and column.
    """
    builder = _Builder(vocabulary)
    return syntax.condition_of(builder.build(syntax.read_syntax(text)), "an expectation")


def parse_quantity(text: str) -> tuple[float, str]:
    """Return a number with a unit, such as ``5 kN``, in SI, and the symbol of the unit.

    Any other text raises an `ExpectationError`.
    """
    found = syntax.quantity_of(
        _Builder(nodes.Vocabulary({})).build(syntax.read_syntax(text)), "this"
    )
    return cast("float", found.node_value), found.symbol


class _Builder:
    """Builds the typed tree from the bottom up."""

    def __init__(self, vocabulary: nodes.Vocabulary) -> None:
        self._known = vocabulary
        self._depth = 0
        self._forms: Mapping[str, Callable[[Tree[Token], nodes.Position], syntax.Operand]] = {
            "quantity": self._quantity,
            "name": self._name,
            "text": self._text,
            "call": self._call,
            "group": lambda tree, _: self.build(_tree(tree.children[0])),
            "negative": self._negative,
            "comparison": self._comparison,
            "not_": self._not,
            "and_": self._joined,
            "or_": self._joined,
            "implies": self._implies,
            "whenever": self._whenever,
            "until": self._until,
            "since": self._until,
            **dict.fromkeys(_OPERATIONS, self._arithmetic),
            **dict.fromkeys(_SPANS, self._span),
            **dict.fromkeys(_TIMED, self._timed),
        }

    def build(self, tree: "Tree[Token]") -> syntax.Operand:
        """Build the operand of a tree.

        Raises:
            ExpectationError: it makes no sense, or is nested too deep.
        """
        position = nodes.Position(tree.meta.line, tree.meta.column)
        if self._depth == syntax.DEEPEST:
            wrong = f"is nested more than {syntax.DEEPEST} levels deep"
            raise syntax.ExpectationError(position, f"{wrong}; split it into several expectations")
        self._depth += 1
        found = self._forms[tree.data](tree, position)
        self._depth -= 1
        return found

    def _condition(self, tree: object, word: str) -> nodes.Condition:
        return syntax.condition_of(self.build(_tree(tree)), word)

    def _quantity(self, tree: "Tree[Token]", position: nodes.Position) -> syntax.Operand:
        number, *units = (str(token) for token in tree.children)
        value = float(int(number, 16)) if number.startswith("0x") else float(number)
        if not math.isfinite(value):
            raise syntax.ExpectationError(position, "is too large a number; give a smaller one")
        if not units:
            return syntax.MeasuredValue(nodes.Number(value, position=position), dimensions.NUMBER)
        unit = dimensions.find_unit(units[0])
        if unit is None:
            nearest = find_nearest(units[0], dimensions.UNITS)
            wrong = f"{quote(units[0])} is no unit of the language"
            raise syntax.ExpectationError(position, f"{wrong}; the nearest is {nearest}")
        si = unit.unit.to_si(value)
        return syntax.MeasuredValue(
            nodes.Number(si, position=position), unit.dimension, unit.unit.symbol
        )

    def _name(self, tree: "Tree[Token]", position: nodes.Position) -> syntax.Operand:
        name = str(tree.children[0]).strip("'")
        known = self._known
        if name in known.states:
            return syntax.State(name, position)
        if name in known.signals:
            reading = nodes.Reading(name, *known.ranges.get(name, ()), position=position)
            return syntax.MeasuredValue(reading, dimensions.dimension_of(known.signals[name]))
        if name in known.parameters:
            unit = dimensions.unit_of_name(name)
            number = nodes.Number(known.parameters[name], position=position)
            return syntax.MeasuredValue(number, unit.dimension, unit.unit.symbol.replace("-", ""))
        if name in known.shared:
            wrong = f"{quote(name)} is in several tables"
            raise syntax.ExpectationError(position, f"{wrong}; give {known.shared[name]}")
        if any(name in texts for texts in known.states.values()):
            right = f'write "{name}" with its quotes, and the expectation in single ones'
            raise syntax.ExpectationError(position, f"{name} is a state; {right}")
        right = f"the nearest is {find_nearest(name, known.names)}" if known.names else "none is"
        raise syntax.ExpectationError(position, f"{quote(name)} is no signal here; {right}")

    def _text(self, tree: "Tree[Token]", position: nodes.Position) -> syntax.Operand:
        return syntax.Text(str(tree.children[0])[1:-1], position)

    def _call(self, tree: "Tree[Token]", position: nodes.Position) -> syntax.Operand:
        name, *rest = tree.children
        if name not in CALLS:
            nearest = find_nearest(str(name), CALLS)
            wrong = f"{quote(str(name))} is no function of the language"
            raise syntax.ExpectationError(position, f"{wrong}; the nearest is {nearest}")
        if name in {nodes.DM1, nodes.EMCY} and rest and _tree(rest[0]).data == "name":
            place = _tree(rest[0]).meta
            node = syntax.Text(
                str(_tree(rest[0]).children[0]).strip("'"), nodes.Position(place.line, place.column)
            )
            given: list[syntax.Operand] = [node, *(self.build(_tree(each)) for each in rest[1:])]
        else:
            given = [self.build(_tree(each)) for each in rest]
        if name in {nodes.EMCY, nodes.FRAME}:
            _check_digits(tree)
        return CALLS[str(name)](Arguments(given, position, self._known))

    def _negative(self, tree: "Tree[Token]", position: nodes.Position) -> syntax.Operand:
        found = syntax.quantity_of(self.build(_tree(tree.children[0])), "-")
        if isinstance(found.node, nodes.Number):
            return found._replace(node=nodes.Number(-found.node.value, position=position))
        minus = syntax.MeasuredValue(nodes.Number(-1.0, position=position), dimensions.NUMBER)
        product = combine(nodes.Operation.MULTIPLY, minus, found)
        return product._replace(symbol=found.symbol, slack=found.slack)

    def _arithmetic(self, tree: "Tree[Token]", _position: nodes.Position) -> syntax.Operand:
        left, right = (self.build(_tree(child)) for child in tree.children)
        return combine(_OPERATIONS[tree.data], left, right)

    def _comparison(self, tree: "Tree[Token]", _position: nodes.Position) -> syntax.Operand:
        operands = [self.build(_tree(child)) for child in tree.children[::2]]
        relations = [nodes.Relation(str(token)) for token in tree.children[1::2]]
        return compare(operands, relations, self._known)

    def _not(self, tree: "Tree[Token]", position: nodes.Position) -> syntax.Operand:
        return nodes.Not(self._condition(tree.children[0], "not"), position=position)

    def _joined(self, tree: "Tree[Token]", position: nodes.Position) -> syntax.Operand:
        kind = nodes.All if tree.data == "and_" else nodes.Any
        return kind(self._operands(tree, tree.data.rstrip("_")), position=position)

    def _operands(self, tree: "Tree[Token]", word: str) -> tuple[nodes.Condition, ...]:
        """Return the operands of ``a and b and c``, which the grammar nests to the left."""
        found, rest = [], tree
        while True:
            left, right = rest.children
            found.append(right)
            if _tree(left).data != tree.data:
                found.append(left)
                break
            rest = _tree(left)
        return tuple(self._condition(each, word) for each in reversed(found))

    def _implies(self, tree: "Tree[Token]", position: nodes.Position) -> syntax.Operand:
        trigger, response = (self._condition(each, "implies") for each in tree.children)
        return nodes.Implies(trigger, response, position=position)

    def _whenever(self, tree: "Tree[Token]", position: nodes.Position) -> syntax.Operand:
        trigger = self._condition(tree.children[0], "whenever")
        response = self._condition(tree.children[1], "then")
        implies = nodes.Implies(trigger, response, position=position)
        return nodes.Always(nodes.UNBOUNDED, implies, position=position)

    def _span(self, tree: "Tree[Token]", position: nodes.Position) -> syntax.Operand:
        *windows, operand = tree.children
        window = self._window(_tree(windows[0])) if windows else nodes.UNBOUNDED
        if tree.data in {"eventually", "once"} and _tree(operand).data == "within":
            right = "within T A" if tree.data == "eventually" else "A within the last T"
            raise syntax.ExpectationError(position, f"{tree.data} within: write {right} alone")
        return _SPANS[tree.data](window, self._condition(operand, tree.data), position=position)

    def _timed(self, tree: "Tree[Token]", position: nodes.Position) -> syntax.Operand:
        """Return a condition with a window from now on, or up to now, of a stated length."""
        first, second = tree.children
        time, operand = (first, second) if tree.data == "within" else (second, first)
        window = nodes.Window(0, self._duration(time))
        word = tree.data.rstrip("_").replace("_", " ")
        return _TIMED[tree.data](window, self._condition(operand, word), position=position)

    def _until(self, tree: "Tree[Token]", position: nodes.Position) -> syntax.Operand:
        first, *windows, last = tree.children
        window = self._window(_tree(windows[0])) if windows else nodes.UNBOUNDED
        kind = nodes.Until if tree.data == "until" else nodes.Since
        operand, goal = (self._condition(each, tree.data) for each in (first, last))
        return kind(window, operand, goal, position=position)

    def _window(self, tree: "Tree[Token]") -> nodes.Window:
        times = [self._duration(child) for child in tree.children]
        match tree.data:
            case "from_to" if times[0] > times[1]:
                position = nodes.Position(tree.meta.line, tree.meta.column)
                raise syntax.ExpectationError(
                    position, "ends before it begins; give from A to B, A <= B"
                )
            case "from_to":
                return nodes.Window(times[0], times[1])
            case "after":
                return nodes.Window(times[0], None)
            case _:
                return nodes.Window(0, times[0])

    def _duration(self, tree: object) -> int:
        """Return a time [ns].

        Raises:
            ExpectationError: it is something else.
        """
        found = syntax.quantity_of(self.build(_tree(tree)), "a time")
        position = found.node.position
        value = found.node_value
        if value is None or found.dimension != dimensions.TIME:
            what = (
                "a signal"
                if value is None
                else f"a value {dimensions.show_dimension(found.dimension)}"
            )
            wrong = f"is {what}, not a time".replace("a value a ", "a ")
            raise syntax.ExpectationError(position, f"{wrong}; give for example 200 ms")
        if not 0 <= value <= _LONGEST_TIME:
            raise syntax.ExpectationError(
                position, f"{value:g} s is no span of time; give 0 s or more"
            )
        return round(value * 1e9)


def _tree(child: object) -> "Tree[Token]":
    return cast("Tree[Token]", child)


def _check_digits(tree: "Tree[Token]") -> None:
    """Refuse a decimal number where everybody writes hexadecimal ones: 8130 is meant as 0x8130.

    Raises:
        ExpectationError: there is one of two digits or more.
    """
    for token in tree.scan_values(lambda each: getattr(each, "type", "") == "NUMBER"):
        if token.isdecimal() and int(token) > 9:
            position = nodes.Position(token.line or 1, token.column or 1)
            right = f"write 0x{token}, or 0x{int(token):X} for the same number"
            raise syntax.ExpectationError(position, f"{token} is decimal here; {right}")
