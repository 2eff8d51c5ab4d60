"""Conditions computed block by block.

A stream takes the ticks of a run in blocks of any length and gives the margins of the ticks that
are decided by then, each tick once and in order. It keeps no more of the past than its windows
need, but for an unbounded window into the future, which nothing decides before the end. A whole
recording is one block.
"""

import math
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Protocol

import numpy as np

from hil_bench.abilities.scenario import values
from hil_bench.abilities.scenario.nodes import Turn


def identity_of(extreme: np.ufunc) -> float:
    """Return the neutral element of a minimum, or of a maximum."""
    return math.inf if extreme is np.minimum else -math.inf


class Stream(Protocol):
    """A condition over time."""

    def push(self, block: values.Block) -> values.Bounds:
        """Take the next ticks, and return the margins that are decided by them."""

    def finish(self) -> values.Bounds:
        """Return the margins of all other ticks: the run is over."""


class Atoms:
    """A condition that each tick decides at once."""

    def __init__(self, margins: Callable[[values.Block], values.Bounds]) -> None:
        self._margins = margins

    def push(self, block: values.Block) -> values.Bounds:
        """Return the margins of these ticks."""
        return self._margins(block)

    def finish(self) -> values.Bounds:
        """Return nothing: all is decided."""
        return values.NOTHING


class Combined:
    """Margins of several conditions at the same tick, combined.

    Args:
        children: the conditions.
        combine: takes their margins.
    """

    def __init__(self, children: Sequence[Stream], combine: Callable[..., values.Bounds]) -> None:
        self._children = children
        self._combine = combine
        self._waiting: list[values.Bounds] = [values.NOTHING] * len(children)

    def push(self, block: values.Block) -> values.Bounds:
        """Return the margins of the ticks that all conditions have decided."""
        return self._take([child.push(block) for child in self._children])

    def finish(self) -> values.Bounds:
        """Return the margins of all other ticks."""
        return self._take([child.finish() for child in self._children])

    def _take(self, news: Sequence[values.Bounds]) -> values.Bounds:
        waiting = [values.join(pair) for pair in zip(self._waiting, news, strict=True)]
        count = min(bounds.size for bounds in waiting)
        self._waiting = [bounds.cut(count) for bounds in waiting]
        if not count:
            return values.NOTHING
        return self._combine(*(bounds.cut(0, count) for bounds in waiting))


def all_of(*operands: values.Bounds) -> values.Bounds:
    """Return the margins of ``and``."""
    return values.map_bounds(lambda *parts: reduce(np.minimum, parts), *operands)


def any_of(*operands: values.Bounds) -> values.Bounds:
    """Return the margins of ``or``."""
    return values.map_bounds(lambda *parts: reduce(np.maximum, parts), *operands)


class Trigger:
    """Margins of ``A implies B``, which counts how often A becomes true.

    Args:
        first: the first tick at which it is asked for.
        last: the last; None for the end of the run.

    Attributes:
        times: how often.
    """

    def __init__(self, first: int, last: int | None) -> None:
        self.times = 0
        self._first, self._last = first, last
        self._tick = 0
        self._was_true = False

    def __call__(self, trigger: values.Bounds, response: values.Bounds) -> values.Bounds:
        """Return the margins of the next ticks."""
        is_true = trigger.low > 0.0
        is_true[: max(0, self._first - self._tick)] = False
        if self._last is not None:
            is_true[max(0, self._last + 1 - self._tick) :] = False
        self._tick += trigger.size
        self.times += int(np.count_nonzero(is_true[1:] & ~is_true[:-1]))
        self.times += int(is_true[0] and not self._was_true)
        self._was_true = bool(is_true[-1])
        return any_of(values.negate(trigger), response)


class BoundsShift:
    """Margins one tick late; at the first tick, the present one."""

    def __init__(self) -> None:
        self._last = values.NOTHING

    def __call__(self, operand: values.Bounds) -> values.Bounds:
        """Return the margins of the ticks before these."""
        first = self._last if self._last.size else operand.cut(0, 1)
        self._last = operand.cut(operand.size - 1)
        return values.join((first, operand.cut(0, -1)))


class ConditionTurn:
    """Margins of ``rises``, ``falls`` and ``changes`` of a condition."""

    def __init__(self, turn: Turn) -> None:
        self._turn = turn
        self._shift = BoundsShift()

    def __call__(self, operand: values.Bounds) -> values.Bounds:
        """Return the margins of the next ticks."""
        return values.turn_margins(self._turn, operand, self._shift(operand))


class Ahead:
    """The extreme over a window ahead; behind the end of the run, nothing is known.

    Args:
        child: the condition.
        extreme: ``np.minimum`` or ``np.maximum``.
        start: of the window, in ticks.
        end: of the window, in ticks, included.
    """

    def __init__(self, child: Stream, extreme: np.ufunc, start: int, end: int) -> None:
        self._child, self._extreme = child, extreme
        self._width, self._end = end - start + 1, end
        self._skipped = start
        self._kept = values.NOTHING

    def push(self, block: values.Block) -> values.Bounds:
        """Return the margins of the ticks whose window is over."""
        return self._take(self._child.push(block))

    def finish(self) -> values.Bounds:
        """Return the margins of all other ticks."""
        return self._take(values.join((self._child.finish(), values.unknown(self._end))))

    def _take(self, news: values.Bounds) -> values.Bounds:
        skipped = min(self._skipped, news.size)
        self._skipped -= skipped
        known = values.join((self._kept, news.cut(skipped)))
        found = values.map_bounds(
            lambda part: values.slide(self._extreme, part, self._width), known
        )
        self._kept = known.cut(found.size)
        return found


class AheadToEnd:
    """The extreme over all ticks from some time ahead on, which only the end decides."""

    def __init__(self, child: Stream, extreme: np.ufunc, start: int) -> None:
        self._child, self._extreme, self._start = child, extreme, start
        self._parts: list[values.Bounds] = []

    def push(self, block: values.Block) -> values.Bounds:
        """Keep the margins, and return none."""
        self._parts.append(self._child.push(block))
        return values.NOTHING

    def finish(self) -> values.Bounds:
        """Return all margins; a window that begins behind the end leaves them unknown."""
        whole = values.join((*self._parts, self._child.finish()))
        found = values.map_bounds(lambda part: self._extreme.accumulate(part[::-1])[::-1], whole)
        late = min(self._start, whole.size)
        return values.join((found.cut(late), values.unknown(late)))


class Back:
    """The extreme over a window back; before the run there was nothing.

    Args:
        extreme: ``np.minimum`` or ``np.maximum``.
        start: of the window, in ticks back.
        end: of the window, in ticks back, included.
    """

    def __init__(self, extreme: np.ufunc, start: int, end: int) -> None:
        self._extreme = extreme
        self._width, self._start = end - start + 1, start
        identity = identity_of(extreme)
        self._kept = values.constant(identity, identity, end)

    def __call__(self, news: values.Bounds) -> values.Bounds:
        """Return the margins of the next ticks."""
        known = values.join((self._kept, news))
        seen = known.cut(0, known.size - self._start)
        found = values.map_bounds(lambda part: values.slide(self._extreme, part, self._width), seen)
        self._kept = known.cut(news.size)
        return found


class BackToStart:
    """The extreme over all ticks up to some time ago."""

    def __init__(self, extreme: np.ufunc, start: int) -> None:
        self._extreme = extreme
        identity = identity_of(extreme)
        self._waiting = values.constant(identity, identity, start)
        self._so_far = values.constant(identity, identity, 1)

    def __call__(self, news: values.Bounds) -> values.Bounds:
        """Return the margins of the next ticks."""
        waiting = values.join((self._waiting, news))
        self._waiting = waiting.cut(news.size)
        known = values.join((self._so_far, waiting.cut(0, news.size)))
        found = values.map_bounds(self._extreme.accumulate, known)
        self._so_far = found.cut(found.size - 1)
        return found.cut(1)


class UntilAhead:
    """``A until B`` with B in a window ahead.

    That is: B in the window, A from now to its start, and from there A until B at any time
    (Donzé, Ferrère, Maler: Efficient Robust Monitoring for STL, CAV 2013, lemma 2).

    Args:
        child: A and B as one stream each.
        start: of the window, in ticks.
        end: of the window, in ticks, included; None for the end of the run.
    """

    def __init__(self, child: tuple[Stream, Stream], start: int, end: int | None) -> None:
        self._children = child
        self._start, self._end = start, end
        self._kept = [values.NOTHING, values.NOTHING]

    def push(self, block: values.Block) -> values.Bounds:
        """Return the margins of the ticks whose window is over."""
        self._keep([child.push(block) for child in self._children])
        return values.NOTHING if self._end is None else self._decide(self._end)

    def finish(self) -> values.Bounds:
        """Return the margins of all other ticks."""
        self._keep([child.finish() for child in self._children])
        if self._end is None:
            return self._decide(0)
        self._keep([values.unknown(self._end), values.unknown(self._end)])
        return self._decide(self._end)

    def _keep(self, news: Sequence[values.Bounds]) -> None:
        self._kept = [values.join(pair) for pair in zip(self._kept, news, strict=True)]

    def _decide(self, margin: int) -> values.Bounds:
        count = min(bounds.size for bounds in self._kept) - margin
        if count <= 0:
            return values.NOTHING
        held, goal = (bounds.cut(0, count + margin) for bounds in self._kept)
        start, end = self._start, self._end
        found = values.map_bounds(lambda a, b: windowed_until(a, b, start, end)[:count], held, goal)
        self._kept = [bounds.cut(count) for bounds in self._kept]
        return found


def windowed_until(
    held: values.Floats, goal: values.Floats, start: int, end: int | None
) -> values.Floats:
    """Return the margins of ``A until B``; behind the end of the arrays, B is not met."""
    count = len(held)
    whole = np.full(count + start, -math.inf)
    whole[:count] = values.until(held, goal)
    found = whole[start : start + count]
    if start:
        padded = np.concatenate((held, np.full(start - 1, math.inf)))
        found = np.minimum(found, values.slide(np.minimum, padded, start))
    if end is not None:
        padded = np.concatenate((goal, np.full(end, -math.inf)))
        found = np.minimum(found, values.slide(np.maximum, padded[start:], end - start + 1))
    return found


class SinceBack:
    """``A since B`` with B in a window back: `UntilAhead` with time reversed."""

    def __init__(self, start: int, end: int) -> None:
        self._start, self._end = start, end
        self._kept = (
            values.constant(math.inf, math.inf, end),
            values.constant(-math.inf, -math.inf, end),
        )

    def __call__(self, held: values.Bounds, goal: values.Bounds) -> values.Bounds:
        """Return the margins of the next ticks."""
        known = (values.join((self._kept[0], held)), values.join((self._kept[1], goal)))
        self._kept = (known[0].cut(held.size), known[1].cut(goal.size))
        count = held.size

        def reverse(a: values.Floats, b: values.Floats) -> values.Floats:
            found = windowed_until(a[::-1], b[::-1], self._start, self._end)
            return found[:count][::-1]

        return values.map_bounds(reverse, *known)


class SinceStart:
    """``A since B`` with B at any time since the start of the run."""

    def __init__(self) -> None:
        self._last = values.exact(np.array([-math.inf]))

    def __call__(self, held: values.Bounds, goal: values.Bounds) -> values.Bounds:
        """Return the margins of the next ticks."""
        identity = values.constant(math.inf, math.inf, 1)
        found = values.map_bounds(
            lambda a, b: values.until(a[::-1], b[::-1])[::-1],
            values.join((identity, held)),
            values.join((self._last, goal)),
        )
        self._last = found.cut(found.size - 1)
        return found.cut(1)
