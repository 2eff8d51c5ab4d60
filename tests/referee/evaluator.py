"""The meaning of requirements, by the definitions of docs/expectations.md and nothing else.

Each form is what the document says of it at one tick; a window is asked tick by tick. Values are
exact rationals, so that nothing is rounded. It is slow: a requirement costs milliseconds.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import NamedTuple

from referee.asking import (
    BACK,
    FOR_ALL,
    as_window,
    asked_for,
    conditions_in,
    has_duration,
    is_constant,
    names_in,
)
from referee.language import (
    DEFAULT_SCALES,
    Arithmetic,
    Comparison,
    Function,
    Logic,
    Number,
    Pair,
    Signal,
    Until,
    ValueEdge,
    Window,
    ticks_of,
)

PASSED, FAILED, INCONCLUSIVE, NOT_EXERCISED = "passed", "failed", "inconclusive", "not exercised"

# A margin is a size and a sign, which decides where the size is 0: there is no margin of 0.
LEAST, MOST = (-math.inf, -1), (math.inf, 1)


class Truth(NamedTuple):
    """The lower and the upper bound of a margin."""

    low: tuple
    high: tuple

    @property
    def is_true(self) -> bool:
        """Whether it holds, whatever is unknown."""
        return self.low > (0, 0)

    @property
    def is_false(self) -> bool:
        """Whether it does not hold, whatever is unknown."""
        return self.high < (0, 0)


UNKNOWN, TRUE, FALSE = Truth(LEAST, MOST), Truth(MOST, MOST), Truth(LEAST, LEAST)


@dataclass(frozen=True)
class Ruling:
    """What a run says of a requirement.

    Attributes:
        outcome: passed, failed, inconclusive or not exercised.
        margin: its bounds at the first tick.
        first: the first tick that violates an ``always``; None for other requirements.
        violated: how many that were seen do, but for the last one of its time, behind which nothing
            was seen; 0 where they do not add up to a time.
        triggered: how often the triggers became true; None where there is no implication.
        asked: the first and the last tick for which it asks.
        unseen: how many ticks from the first to the last are unknown.
        is_stated: whether no window without an end reaches to the end of the run.
    """

    outcome: str
    margin: Truth
    first: int | None
    violated: int
    triggered: int | None
    asked: tuple[int, int]
    unseen: int
    is_stated: bool


def lowest(truths: Sequence[Truth]) -> Truth:
    """Return Kleene's ``and``; true of none."""
    return Truth(min(t.low for t in truths), min(t.high for t in truths)) if truths else TRUE


def highest(truths: Sequence[Truth]) -> Truth:
    """Return Kleene's ``or``; false of none."""
    return Truth(max(t.low for t in truths), max(t.high for t in truths)) if truths else FALSE


def opposite(truth: Truth) -> Truth:
    """Return Kleene's ``not``."""
    (high, high_sign), (low, low_sign) = truth
    return Truth((-low, -low_sign), (-high, -high_sign))


class Run:
    """A run of some ticks, and what requirements mean there.

    Args:
        values: of each signal, one a tick; None where it is unknown.
        ticks: how many the run has.
        tick: the time between two [s].
        seen: how many of them there are up to the last that was recorded; all without it.

    Attributes:
        closest: how near two sides of a comparison or of an edge came, as a share of the larger;
            what is nearer than the rounding of doubles, they may decide otherwise.
    """

    def __init__(
        self,
        values: Mapping[str, Sequence[Fraction | None]],
        ticks: int,
        tick: Fraction,
        seen: int | None = None,
    ) -> None:
        self._seen = ticks if seen is None else seen
        self._values = values
        self._ticks = ticks
        self._tick = tick
        self.closest = math.inf
        self.value = cache(self._value_at)
        self._truth = cache(self._truth_at)

    def rule(self, requirement) -> Ruling:
        """Return what the run says of a requirement."""
        truth = self.truth(requirement, 0)
        triggers = self._triggers(requirement)
        outcome = INCONCLUSIVE
        if truth.is_false:
            outcome = FAILED
        elif truth.is_true:
            outcome = PASSED if all(triggers) else NOT_EXERCISED
        violations = self._violations(requirement) if truth.is_false else []
        seen = [t for t in violations if t < self._seen]
        end = min(self._end(requirement), self._seen - 1)
        counted = sum(t < end for t in seen) if has_duration(requirement) else 0
        leaves = list(self._leaves(requirement))
        asked = (min(first for _, first, _ in leaves), max(last for _, _, last in leaves))
        unseen = sum(self._is_unseen(leaves, tick) for tick in range(asked[0], asked[1] + 1))
        times = sum(triggers) if triggers else None
        is_stated = all(
            last is not None
            for leaf, _, last in asked_for(requirement, 0, 0, self._tick)
            if isinstance(leaf, Comparison | ValueEdge)
        )
        return Ruling(
            outcome, truth, min(violations, default=None), counted, times, asked, unseen, is_stated
        )

    def truth(self, tree, tick: int) -> Truth:
        """Return the bounds of the margin at a tick; behind the end nothing is known."""
        return self._truth(tree, tick) if tick < self._ticks else UNKNOWN

    # Values

    def _value_at(self, tree, tick: int) -> Fraction | None:
        """Return a value in SI at a tick."""
        match tree:
            case Number():
                return tree.size
            case Signal():
                return self._values[tree.name][tick]
            case Arithmetic():
                left, right = self.value(tree.left, tick), self.value(tree.right, tick)
                return calculate(tree.sign, left, right)
        now, before = self.value(tree.of, tick), self.value(tree.of, max(tick - 1, 0))
        if tree.name == "previous":
            return before
        if tree.name == "rate":
            return calculate("/", calculate("-", now, before), self._tick)
        return None if now is None else {"-": -now, "abs": abs(now)}[tree.name]

    # Conditions

    def _truth_at(self, tree, tick: int) -> Truth:
        match tree:
            case Comparison():
                return self._compared(tree, tick)
            case ValueEdge():
                return self._edge_of_value(tree, tick)
            case Logic():
                return self._logic(tree, tick)
            case Pair():
                return joined(tree.name, self.truth(tree.left, tick), self.truth(tree.right, tick))
            case Until():
                return self._until(tree, tick)
        return self._window(as_window(tree), tick)

    def _compared(self, tree: Comparison, tick: int) -> Truth:
        return lowest(self._pairs(tree, tick))

    def _pairs(self, tree: Comparison, tick: int) -> list[Truth]:
        pairs = zip(tree.sides, tree.relations, tree.sides[1:], strict=False)
        return [self._pair(*pair, tree.kind, tick) for pair in pairs]

    def sizes(self, requirement, tick: int) -> set:
        """Return how large the margin of each comparison is at a tick."""
        return {
            abs(truth.low[0])
            for tree in conditions_in(requirement)
            if isinstance(tree, Comparison)
            for truth in self._pairs(tree, tick)
        }

    def _pair(self, left, relation: str, right, kind: str, tick: int) -> Truth:
        """Return the margin of one comparison: the difference of both sides by its scale."""
        a, b = self.value(left, tick), self.value(right, tick)
        if a is None or b is None:
            return UNKNOWN
        if relation in {"<", "<="}:
            size = b - a
        elif relation in {">", ">="}:
            size = a - b
        else:
            size = -abs(a - b) if relation == "==" else abs(a - b)
        larger = max(abs(a), abs(b))
        self.closest = min(self.closest, float(abs(a - b) / larger) if larger else 0.0)
        sign = 1 if relation in {"<=", ">=", "=="} else -1
        margin = (size / scale_of(left, right, kind), sign if size == 0 else (size > 0) * 2 - 1)
        return Truth(margin, margin)

    def _edge_of_value(self, tree: ValueEdge, tick: int) -> Truth:
        now, before = self.value(tree.of, tick), self.value(tree.of, max(tick - 1, 0))
        if now is None or before is None:
            return UNKNOWN
        if now != before:  # equal in doubles where a sum swallows the change
            nearest = float(abs(now - before) / max(abs(now), abs(before)))
            self.closest = min(self.closest, nearest)
        holds = {"rises": now > before, "falls": now < before, "changes": now != before}
        return TRUE if holds[tree.name] else FALSE

    def _logic(self, tree: Logic, tick: int) -> Truth:
        now, before = self.truth(tree.of, tick), self.truth(tree.of, max(tick - 1, 0))
        if tree.name == "not":
            return opposite(now)
        if tree.name == "previous":
            return before
        if not (now.is_true or now.is_false) or not (before.is_true or before.is_false):
            return UNKNOWN
        rises, falls = now.is_true and before.is_false, now.is_false and before.is_true
        holds = {"rises": rises, "falls": falls, "changes": rises or falls}
        return TRUE if holds[tree.name] else FALSE

    def _window(self, tree: Window, tick: int) -> Truth:
        begin, end = ticks_of(tree.span, self._tick)
        if tree.name in BACK:
            ticks = self._back(tick, begin, end)
        elif end is None:
            if tick + begin >= self._ticks:
                return UNKNOWN  # it would begin behind the end
            ticks = range(tick + begin, self._ticks)
        else:
            ticks = range(tick + begin, tick + end + 1)
        join = lowest if tree.name in FOR_ALL else highest
        return join([self.truth(tree.of, other) for other in ticks])

    def _back(self, tick: int, begin: int, end: int | None) -> range:
        """Return the ticks of a window back, cut at the first tick of the run."""
        return range(0 if end is None else max(tick - end, 0), tick - begin + 1)

    def _until(self, tree: Until, tick: int) -> Truth:
        begin, end = ticks_of(tree.span, self._tick)
        if tree.name == "since":
            ways = [(came, range(came + 1, tick + 1)) for came in self._back(tick, begin, end)]
        else:
            last = self._ticks - 1 if end is None else tick + end
            ways = [(came, range(tick, came)) for came in range(tick + begin, last + 1)]
        return highest([self._came(tree, came, kept) for came, kept in ways])

    def _came(self, tree: Until, came: int, kept: range) -> Truth:
        return lowest(
            [self.truth(tree.right, came), *(self.truth(tree.left, other) for other in kept)]
        )

    # What was violated, triggered and asked for

    def _violations(self, tree) -> list[int]:
        """Return the ticks at which the condition of an ``always`` is violated."""
        tree = as_window(tree)
        if not isinstance(tree, Window) or tree.name != "always":
            return []
        begin, _ = ticks_of(tree.span, self._tick)
        last = min(self._end(tree), self._ticks - 1)
        return [t for t in range(begin, last + 1) if self.truth(tree.of, t).is_false]

    def _end(self, tree) -> int:
        """Return the last tick of the window of an ``always``; of others, the run's."""
        tree = as_window(tree)
        end = ticks_of(tree.span, self._tick)[1] if isinstance(tree, Window) else None
        return self._ticks - 1 if end is None else end

    def _triggers(self, requirement) -> list[int]:
        """Return how often each trigger became true at the ticks that are asked for."""
        return [
            sum(
                self.truth(tree.left, t).is_true
                and (t == first or not self.truth(tree.left, t - 1).is_true)
                for t in range(first, min(self._until_end(first, last), self._ticks - 1) + 1)
            )
            for tree, first, last in asked_for(requirement, 0, 0, self._tick)
            if isinstance(tree, Pair) and tree.name == "implies"
        ]

    def _leaves(self, requirement) -> Iterator[tuple]:
        """Yield each comparison and edge of a value, with the ticks at which it is asked for."""
        for tree, first, last in asked_for(requirement, 0, 0, self._tick):
            if isinstance(tree, Comparison | ValueEdge):
                yield tree, first, self._until_end(first, last)

    def _until_end(self, first: int, last: int | None) -> int:
        return max(first, self._ticks - 1) if last is None else last

    def _is_unseen(self, leaves: list[tuple], tick: int) -> bool:
        """Return whether a comparison or an edge names something that is unknown at a tick."""
        return any(
            first <= tick <= last
            and any(tick >= self._ticks or self._values[n][tick] is None for n in names_in(leaf))
            for leaf, first, last in leaves
        )


def calculate(sign: str, a: Fraction | None, b: Fraction | None) -> Fraction | None:
    """Return ``a SIGN b``; unknown where one is, or where it divides by 0."""
    if a is None or b is None or (sign == "/" and b == 0):
        return None
    if sign == "/":
        return a / b
    return {"+": a + b, "-": a - b, "*": a * b}[sign]


def joined(name: str, left: Truth, right: Truth) -> Truth:
    """Return ``left NAME right``."""
    if name == "and":
        return lowest([left, right])
    return highest([left if name == "or" else opposite(left), right])


def terms(tree) -> Iterator:
    """Yield what ``+`` and ``-`` join in a value."""
    if isinstance(tree, Arithmetic) and tree.sign in "+-":
        yield from terms(tree.left)
        yield from terms(tree.right)
    elif isinstance(tree, Function) and tree.name == "-":
        yield from terms(tree.of)
    else:
        yield tree


def scale_of(left, right, kind: str) -> Fraction:
    """Return the scale of a comparison: the tolerance that its author wrote."""
    both = [is_constant(left), is_constant(right)]
    sides = [side for side, constant in zip((left, right), both, strict=True) if constant]
    sizes = [
        size
        for side in (sides or (left, right))
        for term in terms(side)
        if is_constant(term) and (size := Run({}, 1, Fraction(1)).value(term, 0))
    ]
    return min(map(abs, sizes), default=DEFAULT_SCALES.get(kind, Fraction(1)))
