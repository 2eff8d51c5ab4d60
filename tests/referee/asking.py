"""What a requirement is made of, which ticks it asks for, and what of it is refused.

By docs/expectations.md, as the evaluator beside it.
"""

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import lru_cache
from itertools import accumulate, pairwise
from statistics import median

from referee.language import (
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
    ticks_of,
)

NOW = Span("")
BACK = {"historically", "once", "for the last", "within the last"}
FOR_ALL = {"always", "for", "historically", "for the last"}


@lru_cache(1000)  # so that one tree stays one, whose truth is kept
def as_window(tree):
    """Return ``whenever`` and ``settled`` as the ``always`` or ``for`` that they stand for."""
    if isinstance(tree, Whenever):
        return Window("always", NOW, Pair("implies", tree.left, tree.right))
    if isinstance(tree, Settled):
        inside = Comparison((Function("abs", tree.of), tree.tolerance), ("<=",), tree.kind)
        return Window("always" if tree.span.end is None else "for", tree.span, inside)
    return tree


def conditions_in(tree) -> Iterator:
    """Yield a condition and those of which it is made."""
    tree = as_window(tree)
    yield tree
    if isinstance(tree, Pair | Until):
        yield from conditions_in(tree.left)
        yield from conditions_in(tree.right)
    elif isinstance(tree, Logic | Window):
        yield from conditions_in(tree.of)


def names_in(tree) -> set[str]:
    """Return the signals that a value, a comparison or an edge names."""
    match tree:
        case Signal():
            return {tree.name}
        case Number():
            return set()
        case Comparison():
            return set().union(*map(names_in, tree.sides))
        case Arithmetic():
            return names_in(tree.left) | names_in(tree.right)
    return names_in(tree.of)


def is_constant(tree) -> bool:
    """Return whether a value names no signal."""
    return not names_in(tree)


def asked_for(tree, first: int, last: int | None, tick: Fraction) -> Iterator[tuple]:
    """Yield each condition inside with the first and the last tick at which it is asked for.

    The last one is None where it is that of the run.
    """
    first, last = max(first, 0), last if last is None else max(last, 0)
    tree = as_window(tree)
    yield tree, first, last
    match tree:
        case Logic(name="previous"):
            yield from asked_for(tree.of, first - 1, less(last, 1), tick)
        case Logic():
            yield from asked_for(tree.of, first - (tree.name != "not"), last, tick)
        case Pair():
            yield from asked_for(tree.left, first, last, tick)
            yield from asked_for(tree.right, first, last, tick)
        case Window():
            yield from asked_for(tree.of, *asked_inside(tree, first, last, tick), tick)
        case Until():
            begin, end = asked_inside(tree, first, last, tick)
            is_back = tree.name == "since"
            left = (begin, last) if is_back else (first, end)
            yield from asked_for(tree.left, *left, tick)
            yield from asked_for(tree.right, begin, end, tick)


def asked_inside(tree, first: int, last: int | None, tick: Fraction) -> tuple[int, int | None]:
    """Return the ticks at which a window asks for what it holds."""
    begin, end = ticks_of(tree.span, tick)
    if tree.name in BACK or tree.name == "since":
        return 0 if end is None else first - end, less(last, begin)
    return first + begin, None if end is None or last is None else last + end


def less(last: int | None, ticks: int) -> int | None:
    """Return an earlier last tick; that of the run stays."""
    return None if last is None else last - ticks


def has_duration(requirement) -> bool:
    """Return whether what an ``always`` holds is decided by values of its own tick or before."""
    tree = as_window(requirement)
    return isinstance(tree, Window) and not any(map(looks_ahead, conditions_in(tree.of)))


def looks_ahead(tree) -> bool:
    """Return whether a condition is an edge or a window ahead."""
    match tree:
        case Window() | Until():
            return tree.name not in BACK and tree.name != "since"
        case Logic():
            return tree.name in {"rises", "falls", "changes"}
    return isinstance(tree, ValueEdge)


def refusals(requirement, tick: Fraction, duration: Fraction | None) -> list[str]:
    """Return why a requirement cannot be judged, in words of the product's message."""
    found = []
    spans = [tree.span for tree in conditions_in(requirement) if isinstance(tree, Window | Until)]
    for span in spans:
        begin, end = ticks_of(span, tick)
        if end is not None and (end < begin or 0 < span.end - span.begin < tick):
            found.append("is shorter than a tick")
    if duration is not None and reach(requirement) > duration:
        found.append("to be decided")
    if duration is not None and way_back(requirement) > duration:
        found.append("looks back")
    compared = [tree.sides for tree in conditions_in(requirement) if isinstance(tree, Comparison)]
    if any(is_same(one, other) for sides in compared for one, other in pairwise(sides)):
        found.append("with itself")
    return found


def is_same(one, other) -> bool:
    """Return True if two values are written alike; ``-x`` is ``-1 * x``."""
    one, other = as_product(one), as_product(other)
    match one, other:
        case Signal(), Signal():
            return one.name == other.name
        case Number(), Number():
            return one.size == other.size
        case Function(), Function():
            return one.name == other.name and is_same(one.of, other.of)
        case Arithmetic(), Arithmetic():
            pairs = (one.left, other.left), (one.right, other.right)
            return one.sign == other.sign and all(is_same(*pair) for pair in pairs)
    return False


def as_product(tree):
    """Return ``-x`` as the product that it is, and any other value as it is."""
    is_negative = isinstance(tree, Function) and tree.name == "-"
    return Arithmetic("*", Number("-1", Fraction(-1)), tree.of) if is_negative else tree


def way_back(tree) -> Fraction:
    """Return how long the run must have lasted until no window back is empty [s]."""
    tree = as_window(tree)
    parts = [getattr(tree, name) for name in ("of", "left", "right") if hasattr(tree, name)]
    inside = [way_back(part) for part in parts] if not isinstance(tree, ValueEdge) else []
    is_back = isinstance(tree, Window | Until) and (tree.name in BACK or tree.name == "since")
    return max(inside, default=Fraction(0)) + (tree.span.begin if is_back else 0)


def reach(tree) -> Fraction:
    """Return how far the windows ahead reach together [s]."""
    tree = as_window(tree)
    parts = [getattr(tree, name) for name in ("of", "left", "right") if hasattr(tree, name)]
    inside = [reach(part) for part in parts] if not isinstance(tree, ValueEdge) else []
    own = Fraction(0)
    if isinstance(tree, Window | Until) and tree.name not in BACK and tree.name != "since":
        own = tree.span.begin if tree.span.end is None else tree.span.end
    return own + max(inside, default=Fraction(0))


def laid_on_ticks(times: Sequence[Fraction], duration: Fraction | None):
    """Return the tick of each row of a recording, how many ticks the run has, and the tick [s].

    None where its rows lie on no grid. Rows outside of the run have ticks outside of it.
    """
    distances = [after - before for before, after in pairwise(times)]
    if not distances or min(distances) <= 0:
        return None
    tick = Fraction(round(median(distances) * 10**9), 10**9)
    places = [(time - times[0]) / tick for time in times]
    rows = [round(place) for place in places]
    is_off = any(abs(row - place) > Fraction(1, 4) for row, place in zip(rows, places, strict=True))
    if is_off or len(set(rows)) < len(rows):
        # Rows that jitter: each is so many ticks behind the one before, and the ends fit.
        counts = [round(distance / median(distances)) for distance in distances]
        rows = [0, *accumulate(counts)]
        tick = Fraction(round((times[-1] - times[0]) / max(rows[-1], 1) * 10**9), 10**9)
        off = [time - times[0] - row * tick for time, row in zip(times, rows, strict=True)]
        if min(counts) < 1 or max(off) - min(off) > tick:
            return None
    if duration is None:
        return rows, rows[-1] + 1, tick
    first = round(times[0] / tick)
    return [row + first for row in rows], math.floor(duration / tick) + 1, tick
