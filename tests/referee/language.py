"""Requirements as trees, with their units, and the text of a tree in the language.

It shares no line with ``hil_bench.abilities.scenario``: units and binding follow
docs/expectations.md and the grammar file.
"""

import math
from dataclasses import dataclass
from fractions import Fraction

LENGTH, PRESSURE, SPEED, FORCE, TIME = "length", "pressure", "speed", "force", "time"
RATE, FLOW, PLAIN, FOREIGN = "pressure rate", "flow", "plain", "foreign"

UNITS: dict[str, dict[str, Fraction]] = {
    PRESSURE: {
        "Pa": Fraction(1),
        "mbar": Fraction(100),
        "kPa": Fraction(1000),
        "bar": Fraction(100_000),
        "MPa": Fraction(1_000_000),
    },
    LENGTH: {
        "m": Fraction(1),
        "mm": Fraction(1, 1000),
        "um": Fraction(1, 1_000_000),
        "µm": Fraction(1, 1_000_000),
    },
    SPEED: {"m/s": Fraction(1), "mm/s": Fraction(1, 1000)},
    RATE: {"Pa/s": Fraction(1), "bar/s": Fraction(100_000)},
    FORCE: {"N": Fraction(1), "kN": Fraction(1000)},
    TIME: {
        "s": Fraction(1),
        "ms": Fraction(1, 1000),
        "us": Fraction(1, 1_000_000),
        "min": Fraction(60),
    },
    FLOW: {"m³/s": Fraction(1), "m3/s": Fraction(1), "l/min": Fraction(1, 60_000)},
    PLAIN: {"": Fraction(1), "%": Fraction(1, 100)},
}
"""The size in SI of each unit, by its kind."""

DEFAULT_SCALES = {
    PRESSURE: Fraction(1_000_000),
    LENGTH: Fraction(1, 100),
    SPEED: Fraction(1, 10),
    FORCE: Fraction(1000),
    TIME: Fraction(1, 10),
}
"""The scale of a margin without a constant; 1 for other kinds."""


@dataclass(frozen=True, eq=False)
class Signal:
    """The value of a signal."""

    name: str


@dataclass(frozen=True, eq=False)
class Number:
    """A constant: its text, and its value in SI. A parameter's text is its name."""

    text: str
    size: Fraction


@dataclass(frozen=True, eq=False)
class Arithmetic:
    """``left SIGN right``."""

    sign: str
    left: "Value"
    right: "Value"


@dataclass(frozen=True, eq=False)
class Function:
    """``-x``, ``abs(x)``, ``previous(x)`` or ``rate(x)`` of a value."""

    name: str
    of: "Value"


Value = Signal | Number | Arithmetic | Function


@dataclass(frozen=True, eq=False)
class Comparison:
    """``x < y``, or a chain such as ``-5 < x < 5``; of values of one kind."""

    sides: tuple[Value, ...]
    relations: tuple[str, ...]
    kind: str


@dataclass(frozen=True, eq=False)
class ValueEdge:
    """``rises(x)``, ``falls(x)`` or ``changes(x)`` of a value."""

    name: str
    of: Value


@dataclass(frozen=True, eq=False)
class Logic:
    """``rises(A)``, ``falls(A)``, ``changes(A)``, ``previous(A)`` or ``not A``."""

    name: str
    of: "Condition"


@dataclass(frozen=True, eq=False)
class Pair:
    """``A and B``, ``A or B`` or ``A implies B``."""

    name: str
    left: "Condition"
    right: "Condition"


@dataclass(frozen=True, eq=False)
class Span:
    """A window: its texts, and its bounds [s]; ``end`` is None where it has none."""

    text: str
    begin: Fraction = Fraction(0)
    end: Fraction | None = None


@dataclass(frozen=True, eq=False)
class Window:
    """A condition at each tick, or at some tick, of a window ahead or back.

    ``name`` is ``always``, ``eventually``, ``within``, ``for``, ``historically``, ``once``,
    ``for the last`` or ``within the last``.
    """

    name: str
    span: Span
    of: "Condition"


@dataclass(frozen=True, eq=False)
class Until:
    """``A until B`` or ``A since B``, with B in a window."""

    name: str
    span: Span
    left: "Condition"
    right: "Condition"


@dataclass(frozen=True, eq=False)
class Whenever:
    """``whenever A then B``."""

    left: "Condition"
    right: "Condition"


@dataclass(frozen=True, eq=False)
class Settled:
    """``settled(x, tolerance)``, or for a time where the span has an end."""

    of: Value
    tolerance: Number
    span: Span
    kind: str


Condition = Comparison | ValueEdge | Logic | Pair | Window | Until | Whenever | Settled

# How strongly a form binds; see the grammar. A condition that stands alone is a FORMULA.
FORMULA, OR, AND, CLAUSE, UNTIL, LASTING, NOT, COMPARISON, SUM, PRODUCT, FACTOR, ATOM = range(12)


class Words:
    """The text of a tree: brackets where the grammar needs them, and some more by chance.

    Args:
        extra: says each time whether to set brackets that are not needed.
    """

    def __init__(self, extra=lambda: False) -> None:
        self._extra = extra

    def of(self, tree) -> str:
        """Return the text of a requirement."""
        return self._write(tree)[0]

    def _fit(self, tree, least: int, *, closed: bool) -> tuple[str, bool]:
        """Return a part in brackets where it binds too weakly or ends open, and how it ends."""
        text, level, is_open = self._write(tree)
        if level < least or (closed and is_open) or self._extra():
            return f"({text})", False
        return text, is_open

    def _write(self, tree) -> tuple[str, int, bool]:
        """Return the text, how it binds, and whether it takes in all that follows it."""
        return getattr(self, f"_{type(tree).__name__.lower()}")(tree)

    def _signal(self, tree: Signal):
        return tree.name, ATOM, False

    def _number(self, tree: Number):
        return tree.text, FACTOR if tree.text.startswith("-") else ATOM, False

    def _arithmetic(self, tree: Arithmetic):
        level = SUM if tree.sign in "+-" else PRODUCT
        left, _ = self._fit(tree.left, level, closed=True)
        right, _ = self._fit(tree.right, level + 1, closed=True)
        return f"{left} {tree.sign} {right}", level, False

    def _function(self, tree: Function):
        if tree.name == "-":
            return f"-{self._fit(tree.of, FACTOR, closed=True)[0]}", FACTOR, False
        return f"{tree.name}({self.of(tree.of)})", ATOM, False

    def _comparison(self, tree: Comparison):
        text = self._fit(tree.sides[0], SUM, closed=True)[0]
        for relation, side in zip(tree.relations, tree.sides[1:], strict=True):
            text += f" {relation} {self._fit(side, SUM, closed=True)[0]}"
        return text, COMPARISON, False

    def _valueedge(self, tree: ValueEdge):
        return f"{tree.name}({self.of(tree.of)})", ATOM, False

    def _logic(self, tree: Logic):
        if tree.name != "not":
            return f"{tree.name}({self.of(tree.of)})", ATOM, False
        text, level, is_open = self._write(tree.of)
        if (level == CLAUSE and is_open) or (level >= NOT and not self._extra()):
            return f"not {text}", CLAUSE if is_open else NOT, is_open
        return f"not ({text})", NOT, False

    def _pair(self, tree: Pair):
        level = {"implies": FORMULA, "or": OR, "and": AND}[tree.name]
        left, _ = self._fit(tree.left, level + 1 if tree.name == "implies" else level, closed=True)
        right, is_open = self._fit(
            tree.right, level if tree.name == "implies" else level + 1, closed=False
        )
        return f"{left} {tree.name} {right}", level, is_open

    def _window(self, tree: Window):
        if tree.name in {"for", "for the last", "within the last"}:
            left, _ = self._fit(tree.of, LASTING, closed=True)
            return f"{left} {tree.name} {tree.span.text}", LASTING, False
        right, _ = self._fit(tree.of, FORMULA, closed=False)
        return f"{tree.name} {tree.span.text} {right}".replace("  ", " "), CLAUSE, True

    def _until(self, tree: Until):
        left, _ = self._fit(tree.left, LASTING, closed=True)
        right, _ = self._fit(tree.right, LASTING, closed=True)
        return f"{left} {tree.name} {tree.span.text} {right}".replace("  ", " "), UNTIL, False

    def _whenever(self, tree: Whenever):
        left, _ = self._fit(tree.left, FORMULA, closed=False)
        right, _ = self._fit(tree.right, FORMULA, closed=False)
        return f"whenever {left} then {right}", CLAUSE, True

    def _settled(self, tree: Settled):
        text = f"settled({self.of(tree.of)}, {tree.tolerance.text}"
        return (
            f"{text}, {tree.span.text})" if tree.span.end is not None else f"{text})",
            ATOM,
            False,
        )


def ticks_of(span: Span, tick: Fraction) -> tuple[int, int | None]:
    """Return the first and the last tick of a window, counted from its instant; both included."""
    end = None if span.end is None else math.floor(span.end / tick)
    return math.ceil(span.begin / tick), end
