"""The operands of an expectation while it is read: values with a unit, states, texts."""

from typing import NamedTuple

from hil_bench.abilities.scenario.dimensions import NUMBER, Dimension, show_dimension
from hil_bench.abilities.scenario.nodes import Condition, Node, Number, Position, Value
from hil_bench.abilities.scenario.syntax import ExpectationError


class MeasuredValue(NamedTuple):
    """A value with what it measures.

    Attributes:
        node: the value.
        dimension: what it measures.
        symbol: the unit that the text gives it; empty for none.
        slack: the smallest constant among the terms of its sum [SI]; 0 for none, and for no sum.
    """

    node: Value
    dimension: Dimension
    symbol: str = ""
    slack: float = 0.0

    @property
    def is_constant(self) -> bool:
        """Return True if no signal is in it."""
        return isinstance(self.node, Number)

    @property
    def tolerance(self) -> float:
        """The smallest constant term of it [SI]; 0 for none."""
        return self.slack or abs(self.node_value or 0.0)

    @property
    def fits_all(self) -> bool:
        """Return True if it needs no unit: 0 is 0 in each."""
        return self.node_value == 0.0 and not self.symbol and self.dimension == NUMBER

    @property
    def node_value(self) -> float | None:
        """Its value where it is constant [SI]."""
        return self.node.value if isinstance(self.node, Number) else None


class State(NamedTuple):
    """A signal whose values are texts."""

    name: str
    position: Position


class Text(NamedTuple):
    """A text in quotes."""

    text: str
    position: Position


Operand = MeasuredValue | State | Text | Condition


def position_of(operand: Operand) -> Position:
    """Return the place at which an operand begins."""
    return operand.node.position if isinstance(operand, MeasuredValue) else operand.position


def condition_of(operand: Operand, word: str) -> Condition:
    """Return an operand that must be a condition.

    Raises:
        ExpectationError: it is a value.
    """
    if isinstance(operand, Node):
        return operand
    right = "compare it, as in axis1.P_A < 250 bar"
    raise ExpectationError(
        position_of(operand), f"{word} needs a condition, and this is {describe(operand)}; {right}"
    )


def quantity_of(operand: Operand, word: str) -> MeasuredValue:
    """Return an operand that must be a value.

    Raises:
        ExpectationError: it is a condition, a state or a text.
    """
    if isinstance(operand, MeasuredValue):
        return operand
    raise ExpectationError(
        position_of(operand),
        f"{word} needs a value, and this is {describe(operand)}; give a signal or a number",
    )


def describe(operand: Operand) -> str:
    """Describe an operand for a message."""
    match operand:
        case MeasuredValue():
            return f"a value {show_dimension(operand.dimension)}".replace("value a ", "")
        case State():
            return f"the state {operand.name}"
        case Text():
            return "a text"
        case _:
            return "a condition"
