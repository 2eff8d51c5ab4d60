"""The tree of an expectation, typed, checked and in SI, and the names that it may use."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import NamedTuple

from hil_bench.abilities.scenario.dimensions import Dimension
from hil_bench.outside.recording.channels import TIME, Channel

# The tree of an expectation: typed, checked, in SI; nothing here is computed yet.


class Position(NamedTuple):
    """The place of an element in the text of an expectation, both numbers from 1."""

    line: int
    column: int


class Window(NamedTuple):
    """A span of time, seen from the present tick: ahead for the future, back for the past.

    Attributes:
        start: [ns].
        end: [ns], included; None for the end of the run, or its start.
    """

    start: int = 0
    end: int | None = None


UNBOUNDED = Window()


class Relation(StrEnum):
    """The relation of a comparison."""

    LESS = "<"
    LESS_EQUAL = "<="
    GREATER = ">"
    GREATER_EQUAL = ">="
    EQUAL = "=="
    UNEQUAL = "!="


class Operation(StrEnum):
    """Arithmetic of two values."""

    ADD = "+"
    SUBTRACT = "-"
    MULTIPLY = "*"
    DIVIDE = "/"


class Turn(StrEnum):
    """The direction of an edge."""

    RISES = "rises"
    FALLS = "falls"
    CHANGES = "changes"


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """A piece of an expectation.

    Attributes:
        position: where it begins in the text.
    """

    position: Position


@dataclass(frozen=True, slots=True)
class Number(Node):
    """A constant [SI]."""

    value: float


@dataclass(frozen=True, slots=True)
class Reading(Node):
    """The value of a signal [SI], or the number of a state.

    Attributes:
        name: of the signal.
        low: the least value that its data type has [SI].
        high: the largest.
    """

    name: str
    low: float = -math.inf
    high: float = math.inf


@dataclass(frozen=True, slots=True)
class Magnitude(Node):
    """``abs(x)``."""

    operand: "Value"


@dataclass(frozen=True, slots=True)
class Rate(Node):
    """``rate(x)``: the change since the previous tick, a second."""

    operand: "Value"


@dataclass(frozen=True, slots=True)
class PreviousValue(Node):
    """``previous(x)``: the value one tick ago; at the first tick, the present one."""

    operand: "Value"


@dataclass(frozen=True, slots=True)
class Arithmetic(Node):
    """Two values combined."""

    operation: Operation
    left: "Value"
    right: "Value"


Value = Number | Reading | Magnitude | Rate | PreviousValue | Arithmetic


def is_same(one: object, other: object) -> bool:
    """Return True if two values are written alike, wherever they stand."""
    if not isinstance(one, Node) or type(one) is not type(other):
        return one == other
    names = (each.name for each in fields(one) if each.name != "position")
    return all(is_same(getattr(one, name), getattr(other, name)) for name in names)


@dataclass(frozen=True, slots=True)
class Comparison(Node):
    """Two values compared.

    Attributes:
        scale: difference that counts as a margin of 1 [SI].
        symbol: unit in which a person reads its values.
        dimension: what both sides measure.
    """

    relation: Relation
    left: Value
    right: Value
    scale: float
    symbol: str
    dimension: Dimension


@dataclass(frozen=True, slots=True)
class StateIs(Node):
    """A state compared with a text: true where its number is `code`."""

    name: str
    text: str
    code: int


@dataclass(frozen=True, slots=True)
class Event(Node):
    """The occurrence of an event in the tick, such as ``frame(0x181)``."""

    name: str


@dataclass(frozen=True, slots=True)
class Edge(Node):
    """``rises``, ``falls`` or ``changes`` of a value since the previous tick."""

    turn: Turn
    operand: Value


@dataclass(frozen=True, slots=True)
class ConditionEdge(Node):
    """``rises``, ``falls`` or ``changes`` of a condition since the previous tick."""

    turn: Turn
    operand: "Condition"


@dataclass(frozen=True, slots=True)
class Not(Node):
    """The contrary."""

    operand: "Condition"


@dataclass(frozen=True, slots=True)
class All(Node):
    """``and``."""

    operands: tuple["Condition", ...]


@dataclass(frozen=True, slots=True)
class Any(Node):
    """``or``."""

    operands: tuple["Condition", ...]


@dataclass(frozen=True, slots=True)
class Implies(Node):
    """``A implies B``; the body of ``whenever A then B``."""

    trigger: "Condition"
    response: "Condition"


@dataclass(frozen=True, slots=True)
class PreviousCondition(Node):
    """``previous(A)``: as one tick ago; at the first tick, as now."""

    operand: "Condition"


@dataclass(frozen=True, slots=True)
class Always(Node):
    """At each tick of a window ahead."""

    window: Window
    operand: "Condition"


@dataclass(frozen=True, slots=True)
class Eventually(Node):
    """At some tick of a window ahead."""

    window: Window
    operand: "Condition"


@dataclass(frozen=True, slots=True)
class Historically(Node):
    """At each tick of a window back."""

    window: Window
    operand: "Condition"


@dataclass(frozen=True, slots=True)
class Once(Node):
    """At some tick of a window back."""

    window: Window
    operand: "Condition"


@dataclass(frozen=True, slots=True)
class Until(Node):
    """`goal` in a window ahead, and `operand` at each tick before it."""

    window: Window
    operand: "Condition"
    goal: "Condition"


@dataclass(frozen=True, slots=True)
class Since(Node):
    """`goal` in a window back, and `operand` at each tick after it."""

    window: Window
    operand: "Condition"
    goal: "Condition"


Windowed = Always | Eventually | Historically | Once | Until | Since
Atom = Comparison | StateIs | Event | Edge | ConditionEdge
Condition = (
    Comparison
    | StateIs
    | Event
    | Edge
    | ConditionEdge
    | Not
    | All
    | Any
    | Implies
    | PreviousCondition
    | Always
    | Eventually
    | Historically
    | Once
    | Until
    | Since
)


# The names that an expectation may use: signals, states, events and parameters.

DM1 = "dm1"
EMCY = "emcy"
FRAME = "frame"


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """The names that a bench or a recording knows.

    Attributes:
        signals: the symbol of the SI unit of each signal.
        states: of each signal that is a state, the number of each of its texts.
        nodes: names of the nodes, for ``emcy(NODE)``.
        has_frames: whether ``frame(COB-ID)`` and ``emcy(NODE)`` are known.
        parameters: the SI value of each parameter; its name ends in its unit.
        shared: of each name that stands for several signals, what tells them apart.
        ecus: names of the J1939 devices, for ``dm1(DEVICE)``.
        ranges: of each signal whose data type has limits, the least and the largest value [SI].
    """

    signals: Mapping[str, str]
    states: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    nodes: tuple[str, ...] = ()
    has_frames: bool = False
    parameters: Mapping[str, float] = field(default_factory=dict)
    shared: Mapping[str, str] = field(default_factory=dict)
    ecus: tuple[str, ...] = ()
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """All names that stand for a value."""
        return (*self.signals, *self.states, *self.parameters)


def channel_vocabulary(
    channels: Iterable[Channel], parameters: Mapping[str, float] | None = None
) -> Vocabulary:
    """Return the vocabulary of a recording without states and frames."""
    units = {each.name: each.unit for each in channels if each.name != TIME.name}
    return Vocabulary(units, parameters=dict(parameters or {}))
