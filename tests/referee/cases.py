"""Cases for the referee: a requirement, a recording, units, gaps and a length, drawn by a seed."""

import math
import random
from dataclasses import dataclass, field
from fractions import Fraction

from referee.asking import names_in
from referee.language import (
    FLOW,
    FORCE,
    LENGTH,
    PLAIN,
    PRESSURE,
    RATE,
    SPEED,
    TIME,
    UNITS,
    Arithmetic,
    Comparison,
    Function,
    Logic,
    Number,
    Pair,
    Settled,
    Signal,
    Span,
    Until,
    ValueEdge,
    Whenever,
    Window,
    Words,
)

GRID = {
    PRESSURE: Fraction(12_500),
    LENGTH: Fraction(1, 64),
    SPEED: Fraction(1, 64),
    RATE: Fraction(12_500),
    FORCE: Fraction(125),
    TIME: Fraction(1, 8),
    FLOW: Fraction(1, 16),
    PLAIN: Fraction(1, 4),
}
"""Steps of values whose sums and small products are exact in doubles, in SI."""

LOGGED = {
    PRESSURE: {"psi": Fraction("4.4482216152605") / Fraction("0.0254") ** 2, "hPa": Fraction(100)},
    LENGTH: {"cm": Fraction(1, 100), "[in]": Fraction("0.0254")},
    SPEED: {"m/min": Fraction(1, 60), "km/h": Fraction(10, 36)},
    FORCE: {"daN": Fraction(10), "lbf": Fraction("4.4482216152605")},
    FLOW: {"L/min": Fraction(1, 60_000), "m^3/h": Fraction(1, 3600)},
    TIME: {"min": Fraction(60)},
    RATE: {"kPa/s": Fraction(1000)},
    PLAIN: {"1": Fraction(1)},
}
"""The size in SI of units that other loggers write, and the language of requirements has not."""

ODD = ["furlong", "barg", "kg", "°C"]
"""Units that are not known, or of another kind than any column."""

EXACT_TICKS = [Fraction(1, 512), Fraction(1, 64), Fraction(1, 8), Fraction(1, 2), Fraction(1)]
OTHER_TICKS = [Fraction(n, 10_000) for n in (1, 10, 33, 100, 200, 1000, 3000)]
BACK_WORDS = ["for the last", "within the last"]
RELATIONS = ["<", "<=", ">", ">=", "==", "!="]
PLAIN_LETTERS = str.maketrans("²³µ", "23u")
RATE_OF = {SPEED: LENGTH, RATE: PRESSURE}


@dataclass
class Case:
    """A requirement, and a run on which it is judged.

    Attributes:
        tree: the requirement; its text is ``text``.
        kinds: the kind of each signal.
        units: the unit in which each signal is recorded.
        columns: the recorded values, one a tick, in those units; None where they are unknown.
        tick: the time between two [s].
        parameters: by name the value as it is written, in the unit at its name's end.
        is_exact: whether doubles hold each value of the case, so that ties are ties.
        logged: the unit of each column of a file, and its size in SI; None for an odd one.
        rows: those of a file: the time of each on its clock [s], and its place in the columns.
        duration: of the run [s], where the file of the requirement states one.
    """

    number: int
    tree: object
    text: str
    kinds: dict[str, str]
    units: dict[str, str]
    columns: dict[str, list[Fraction | None]]
    tick: Fraction
    is_exact: bool
    parameters: dict[str, Number] = field(default_factory=dict)
    logged: dict[str, tuple[str, Fraction | None]] = field(default_factory=dict)
    rows: list[tuple[Fraction, int]] = field(default_factory=list)
    duration: Fraction | None = None

    @property
    def ticks(self) -> int:
        """How many ticks were recorded."""
        return len(next(iter(self.columns.values())))

    def values(self) -> dict[str, list[Fraction | None]]:
        """Return the recorded values in SI."""
        return {
            name: [
                None if x is None else x * UNITS[self.kinds[name]][self.units[name]] for x in column
            ]
            for name, column in self.columns.items()
        }


class Draw:
    """Draws one case; the same seed and number draw the same."""

    def __init__(self, seed: int | str, number: int) -> None:
        self._random = random.Random(f"{seed} {number}")  # noqa: S311 - a sample, no secret
        self._number = number
        self._is_exact = self._random.random() < 0.7
        self._tick = self._random.choice(EXACT_TICKS if self._is_exact else OTHER_TICKS)
        kinds = self._random.choices(list(GRID), k=self._random.choice([1, 2, 2, 3]))
        self._kinds = {f"s{n}.{kind[0]}": kind for n, kind in enumerate(kinds)}
        self._units = {name: self._unit(kind) for name, kind in self._kinds.items()}
        self._parameters: dict[str, Number] = {}

    def case(self) -> Case:
        """Return the case."""
        chance = self._random
        tree = self.tree()
        ticks = chance.choice([0, 1, 2, 3, chance.randrange(4, 12), chance.randrange(4, 61)])
        columns = {
            name: self._column(kind, self._units[name], ticks) for name, kind in self._kinds.items()
        }
        extra = chance.choice([0.0, 0.0, 0.1, 0.5])
        words = Words(lambda: chance.random() < extra)
        return Case(
            self._number,
            tree,
            words.of(tree),
            self._kinds,
            self._units,
            columns,
            self._tick,
            self._is_exact,
            self._parameters,
            {name: self._logged(name, kind) for name, kind in self._kinds.items()},
            self._rows(ticks),
            self._duration(ticks),
        )

    def tree(self):
        """Return a requirement."""
        tree = self._condition(self._random.choice([1, 2, 2, 3, 3, 4, 5]))
        return Window("always", Span(""), tree) if self._random.random() < 0.5 else tree

    def _logged(self, name: str, kind: str) -> tuple[str, Fraction | None]:
        """Return the unit in which a file has a column, and its size."""
        kinds = self._random.random()
        if kinds < 0.03 and kind != PLAIN:
            return self._random.choice(ODD), None
        unit = self._units[name]
        if kinds < 0.2:
            return self._random.choice(list(LOGGED[kind].items()))
        return unit or "-", UNITS[kind][unit]

    def _rows(self, ticks: int) -> list[tuple[Fraction, int]]:
        """Return the rows of a file: some are missing, some are beside their tick."""
        chance, tick = self._random, self._tick
        start = chance.choice([0, 0, 0, 1, 3, -2, Fraction(1, 4), Fraction(11, 8), 70]) * tick
        lost, moved = chance.choice([0, 0, 0.05, 0.2]), chance.choice([0, 0, 0, 0.05])
        wander = chance.choice([*[0] * 9, Fraction(2, 5), Fraction(3, 5)]) * tick
        rows = []
        for place in range(ticks):
            if chance.random() < lost:
                continue
            aside = (
                chance.choice([1, -1, 1, -1, 1, 3]) * tick * 2 / 25
                if chance.random() < moved
                else 0
            )
            aside += wander * (8 - abs(place % 16 - 8)) / 8
            rows.append((start + place * tick + aside, place))
            if chance.random() < moved / 20:
                rows.append((rows[-1][0] + chance.choice([0, tick / 16]), place))
        return rows

    def _duration(self, ticks: int) -> Fraction | None:
        """Return a duration shorter or longer than the recording, on a tick or between two."""
        chance = self._random
        if chance.random() < 0.5:
            return None
        part = chance.choice([0, 0, Fraction(1, 2), Fraction(1, 8)])
        length = chance.choice([ticks, max(ticks - 1, 0), chance.randrange(90)]) + part
        return max(length * self._tick, Fraction(1, 1000))

    # Numbers and columns

    def _unit(self, kind: str) -> str:
        """Return a unit in which the grid of a kind has few digits."""
        units = UNITS[kind]
        return self._random.choice([u for u in units if is_short(GRID[kind] / units[u])])

    def _size(self, kind: str) -> Fraction:
        """Return a value of a kind, in SI."""
        if self._is_exact:
            return self._random.randrange(-8, 9) * GRID[kind]
        return self._random.randrange(-80, 81) * GRID[kind] / 10

    def _constant(self, kind: str, size: Fraction) -> Number:
        """Return a constant in some unit, as a number or as a parameter."""
        units = [u for u, one in UNITS[kind].items() if is_short(size / one)]
        unit = self._random.choice(units)
        figures = written(size / UNITS[kind][unit])
        if unit and self._random.random() < 0.15:
            name = f"p{len(self._parameters)}_{suffix(unit)}"
            self._parameters[name] = Number(figures, size)
            return Number(name, size)
        return Number(f"{figures} {unit}".strip(), size)

    def _column(self, kind: str, unit: str, ticks: int) -> list[Fraction | None]:
        """Return values that stay for a while, step, and are missing now and then."""
        chance, one = self._random, UNITS[kind][unit]
        gaps = chance.choice([0.0, 0.0, 0.0, 0.05, 0.3, 1.0])
        moves = chance.choice([0.0, 0.1, 0.5, 1.0])
        present, column = self._size(kind), []
        for _ in range(ticks):
            if chance.random() < moves:
                present = self._size(kind)
            column.append(None if chance.random() < gaps else present / one)
        return column

    # Values

    def _value(self, kind: str, depth: int):
        chance = self._random
        if depth <= 0 or chance.random() < 0.4:
            names = [name for name, other in self._kinds.items() if other == kind]
            if names and chance.random() < 0.8:
                return Signal(chance.choice(names))
            return self._constant(kind, self._size(kind))
        form = chance.choice(["+", "-", "*", "/", "-x", "abs", "previous", "rate"])
        if form in {"previous", "rate"}:
            return self._of_two_ticks(form, kind, depth)
        if form in {"+", "-", "*", "/"}:
            return self._arithmetic(form, kind, depth - 1)
        return Function(form.removesuffix("x"), self._value(kind, depth - 1))

    def _arithmetic(self, sign: str, kind: str, inside: int) -> Arithmetic:
        chance = self._random
        if sign in {"+", "-"}:
            return Arithmetic(sign, self._value(kind, inside), self._value(kind, inside))
        if sign == "*":
            sides = [self._value(kind, inside), self._value(PLAIN, inside - 1)]
            chance.shuffle(sides)
            return Arithmetic("*", *sides)
        divisor = self._constant(PLAIN, Fraction(chance.choice([-4, -1, 1, 2, 8]), 4))
        return Arithmetic("/", self._value(kind, inside), divisor)

    def _of_two_ticks(self, form: str, kind: str, depth: int):
        """Return ``previous(x)`` or ``rate(x)``, where there is a signal for it."""
        inside = RATE_OF.get(kind) if form == "rate" else kind
        if inside not in self._kinds.values():
            return self._value(kind, depth - 1)
        return Function(form, self._moving(inside, depth - 1))

    def _moving(self, kind: str, depth: int):
        """Return a value of a kind that names a signal."""
        value = self._value(kind, depth)
        if names_in(value):
            return value
        return Signal(next(name for name, other in self._kinds.items() if other == kind))

    # Conditions

    def _condition(self, depth: int):
        chance = self._random
        if depth <= 0 or chance.random() < 0.1:
            return self._leaf()
        forms = [self._logic, self._pair, self._pair, self._window, self._window, self._window]
        return chance.choice([*forms, self._until, self._whenever, self._edge])(depth - 1)

    def _logic(self, inside: int) -> Logic:
        return Logic(self._random.choice(["not", "previous"]), self._condition(inside))

    def _edge(self, inside: int) -> Logic:
        name = self._random.choice(["rises", "falls", "changes"])
        return Logic(name, self._condition(inside))

    def _pair(self, inside: int) -> Pair:
        name = self._random.choice(["and", "or", "implies"])
        return Pair(name, self._condition(inside), self._condition(inside))

    def _whenever(self, inside: int) -> Whenever:
        return Whenever(self._condition(inside), self._condition(inside))

    def _until(self, inside: int) -> Until:
        name = self._random.choice(["until", "since"])
        span = self._span(self._random.choice(["", "from", "within"]))
        return Until(name, span, self._condition(inside), self._condition(inside))

    def _window(self, inside: int):
        chance = self._random
        name = chance.choice(
            ["always", "eventually", "within", "for", "historically", "once", *BACK_WORDS]
        )
        if name in {"always", "eventually", "historically", "once"}:
            span, of = self._span(chance.choice(["", "from", "after"])), self._condition(inside)
            if isinstance(of, Window) and of.name == "within":
                name = {"eventually": "always", "once": "historically"}.get(name, name)
            return Window(name, span, of)  # "eventually within" is refused
        return Window(name, self._span("bare"), self._condition(inside))

    def _span(self, form: str) -> Span:
        """Return a window whose bounds are on ticks or between them, and that mostly holds one."""
        chance = self._random
        if not form:
            return Span("")
        part = chance.choice([0, 0, 0, Fraction(1, 2), Fraction(1, 4)])
        far = chance.choice([0, 1, 2, 3, 5, chance.randrange(40)])
        begin = (chance.choice([0, 1, 2, 3, 7]) + part) * self._tick
        if form == "after":
            return Span(f"after {self._time(begin)}", begin)
        if form == "from":
            end = begin + (far + chance.choice([0, part, 1 - part])) * self._tick
            return Span(f"from {self._time(begin)} to {self._time(end)}", begin, end)
        end = (far + part) * self._tick
        text = self._time(end)
        return Span(f"within {text}" if form == "within" else text, Fraction(0), end)

    def _time(self, size: Fraction) -> str:
        return self._constant(TIME, size).text

    def _leaf(self):
        chance = self._random
        kind = chance.choice(list(self._kinds.values()))
        if chance.random() < 0.1:
            name = chance.choice(["rises", "falls", "changes"])
            return ValueEdge(name, self._moving(kind, 1))
        if chance.random() < 0.1:
            tolerance = self._constant(kind, abs(self._size(kind)) or GRID[kind])
            span = self._span("bare") if chance.random() < 0.5 else Span("")
            return Settled(self._moving(kind, 1), tolerance, span, kind)
        if chance.random() < 0.1:
            return self._chain(kind)
        left = self._moving(kind, chance.choice([0, 0, 1, 2]))
        right = self._value(kind, chance.choice([0, 0, 1]))
        if chance.random() < 0.5:
            right = self._constant(kind, self._size(kind))
        elif chance.random() < 0.1:
            right = Number("0", Fraction(0))
        if chance.random() < 0.2:
            left, right = right, left
        return Comparison((left, right), (chance.choice(RELATIONS),), kind)

    def _chain(self, kind: str) -> Comparison:
        chance = self._random
        sides = [self._constant(kind, self._size(kind)), self._moving(kind, 1)]
        sides.append(self._constant(kind, self._size(kind)))
        relations = chance.choices(RELATIONS[:4], k=2)
        return Comparison(tuple(sides), tuple(relations), kind)


class DrawOn(Draw):
    """Draws requirements on signals that are there, with constants from among their values.

    Args:
        chance: the name of what is drawn.
        kinds: the kind of each signal.
        columns: the values of each signal, in SI.
        tick: the time between two [s].
    """

    def __init__(
        self,
        chance: str,
        kinds: dict[str, str],
        columns: dict[str, list[Fraction]],
        tick: Fraction,
    ) -> None:
        super().__init__(chance, 0)
        self._is_exact, self._kinds, self._columns, self._tick = False, kinds, columns, tick

    def requirement(self) -> tuple[object, str, dict[str, Number]]:
        """Return a requirement, its text and its parameters."""
        tree = self.tree()
        text = Words().of(tree)
        return tree, text, {name: each for name, each in self._parameters.items() if name in text}

    def _size(self, kind: str) -> Fraction:
        names = [name for name, other in self._kinds.items() if other == kind]
        if not names:
            return super()._size(kind)
        values = [x for x in self._columns[self._random.choice(names)] if x is not None]
        value = float(self._random.choice(values))
        return Fraction(f"{float(f'{value:.3g}'):.9f}")


def is_short(size: Fraction) -> bool:
    """Return whether a number has few decimals."""
    return size.denominator == 1 or (10**9 % size.denominator == 0)


def suffix(unit: str) -> str:
    """Return how the name of a parameter ends in a unit."""
    return {"%": "percent"}.get(unit, unit.lower().replace("/", "_").translate(PLAIN_LETTERS))


def written(size: Fraction) -> str:
    """Return a number with few decimals as a decimal."""
    digits = 0
    while size * 10**digits % 1:
        digits += 1
    whole, rest = divmod(abs(int(size * 10**digits)), 10**digits)
    return f"{'-' * (size < 0)}{whole}" + (f".{rest:0{digits}}" if digits else "")


def draw(seed: int, number: int) -> Case:
    """Return the case of a seed and a number."""
    return Draw(seed, number).case()


def bits(size: Fraction | None, place: int) -> float:
    """Return a number as a double; one that is unknown is NaN or infinite, by its place."""
    return (math.nan, math.inf, -math.inf)[place % 3] if size is None else float(size)
