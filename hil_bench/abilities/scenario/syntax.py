"""The text of an expectation to a tree of words, and the operands in it."""

from functools import cache, lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING, NamedTuple

from hil_bench.abilities.scenario.dimensions import NUMBER, Dimension, show_dimension
from hil_bench.abilities.scenario.nodes import Condition, Node, Number, Position, Value
from hil_bench.errors import ConfigError

if TYPE_CHECKING:
    from lark import Lark, Token, Tree
    from lark.exceptions import UnexpectedInput


# The text of an expectation to a tree of words, by the grammar in ``expectations.lark``.

LONGEST = 4000
"""Characters that an expectation may have."""

DEEPEST = 60
"""Levels that an expectation may have."""

_MOST_EXPECTED = 4
_SHOWN = {"NUMBER": "a number", "NAME": "a name", "TEXT": "a text in quotes", "UNIT": "a unit"}
_START = Position(1, 1)


class ExpectationError(ConfigError):
    """An expectation is wrong.

    Attributes:
        position: where, in its text.
        what: what is wrong, and what would be right.
    """

    def __init__(self, position: Position, what: str) -> None:
        super().__init__(f"line {position.line}, column {position.column}: {what}")
        self.position = position
        self.what = what


@lru_cache(maxsize=64)  # a campaign reads the same ones for each run
def read_syntax(text: str) -> "Tree[Token]":
    """Return the tree of an expectation, which nobody changes.

    Raises:
        ExpectationError: the text does not follow the grammar, or is too long.
    """
    from lark.exceptions import UnexpectedInput  # noqa: PLC0415 - lark takes time to load

    if not text.strip():
        raise ExpectationError(_START, 'is empty; give for example "always axis1.P_A < 250 bar"')
    if len(text) > LONGEST:
        right = f"give at most {LONGEST}, and split it into several expectations"
        raise ExpectationError(_START, f"has {len(text)} characters; {right}")
    try:
        return _parser().parse(text)
    except UnexpectedInput as error:
        position, what = _explain(text, error)
        raise ExpectationError(position, what) from None


@cache
def _parser() -> "Lark":
    from lark import Lark  # noqa: PLC0415 - see above

    grammar = files("hil_bench.abilities.scenario").joinpath("expectations.lark").read_text("utf-8")
    return Lark(grammar, parser="lalr", propagate_positions=True, maybe_placeholders=False)


def _explain(text: str, error: "UnexpectedInput") -> tuple[Position, str]:
    """Return place and reason of a syntax error."""
    offset = getattr(error, "pos_in_stream", 0)
    if getattr(getattr(error, "token", None), "type", "") == "$END":
        offset = len(text.rstrip())
    before = text[:offset]
    position = Position(before.count("\n") + 1, offset - (before.rfind("\n") + 1) + 1)
    rest = text[offset:].split(maxsplit=1)
    right = _right(text, offset, error)
    if not rest:
        return (position, f"ends too early; {right}")
    return (position, f'"{rest[0][:20]}" does not fit here; {right}')


def _right(text: str, offset: int, error: "UnexpectedInput") -> str:
    if text[offset : offset + 1] == "," and text[:offset][-1:].isdigit():
        return "write decimals with a point, as in 1.5"
    if text[offset : offset + 1] == "=":
        return "write == to compare"
    expected = getattr(error, "accepts", None) or getattr(error, "expected", None)
    names = sorted({_show(name) for name in expected or getattr(error, "allowed", None) or ()})
    words = [name for name in names if name]
    if not words or len(words) > _MOST_EXPECTED:
        return _guess(words)
    return f"{' or '.join(words)} is right"


def _guess(words: list[str]) -> str:
    if "a name" in words or not words:
        return "a signal, a number or a condition is right"
    return "an operator such as <, and, or, until is right, or the end"


def _show(name: str) -> str:
    if name in _SHOWN:
        return _SHOWN[name]
    words = {"RPAR": '")"', "LPAR": '"("', "COMMA": '","', "$END": "the end"}
    return words.get(name, f'"{name.lower()}"')


# The operands of an expectation while it is read: values with a unit, states, texts.


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
