"""The strokes of a record: where the machine goes from rest to rest, and how each begins."""

import itertools
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.errors import ConfigError

Values = npt.NDArray[np.float64]

_AVERAGED, _AVERAGED_MOST = 0.01, 0.05  # [s] over which speed is taken
_RESTED = 0.03  # [s] of rest before a stroke over which its start is averaged
_SLOW = 0.03  # of the fast motion: slower is rest
_REST = 0.05  # [s] of rest between two strokes
_SHORTEST, _LONGEST = 0.3, 8.0  # [s]
_LIKE = 0.01  # of the full opening, by which a command at rest may change
_MOST_ROWS = 40_000
_MOST_STROKES = 60


class Stroke(NamedTuple):
    """One stroke.

    Attributes:
        number: of the stroke, from 1, in the order of the records.
        session: the recording that it is from.
        rows: of the record; the first is where it starts.
        start: position [m], velocity [m/s], P_A and P_B [Pa]; not a number for what is missing.
        opening: the largest set-point, as a share of the full opening.
        is_forth: whether the piston extends.
    """

    number: int
    session: int
    rows: range
    start: Values
    opening: float
    is_forth: bool


@dataclass(frozen=True, slots=True)
class Course:
    """A record in strokes.

    Attributes:
        record: with a row each so many ms.
        strokes: of it.
        commands: set-point of each half row of the record before, shape (2 rows,) [m].
        factor: of these halves make a row of `record`.
        dropped: strokes of the record that are left out because there are enough.
    """

    record: AxisRecord
    strokes: tuple[Stroke, ...]
    commands: Values
    factor: int
    dropped: int = 0

    def some(self, chosen: list[int]) -> "Course":
        """Return the course of some strokes, by their places."""
        return replace(self, strokes=tuple(self.strokes[place] for place in chosen))

    def commands_of(self, stroke: Stroke, every: int) -> Values:
        """Return the set-point of each step of a stroke [m], as the record before has it.

        A step inside a row excites more than two small ones at its ends.

        Args:
            stroke: of the course.
            every: steps in a row.
        """
        first, last = (self.factor * row + 2 for row in (stroke.rows.start, stroke.rows.stop - 1))
        common = math.gcd(every, self.factor)
        fine = np.repeat(self.commands[first:last], every // common)
        return np.asarray(fine.reshape(-1, self.factor // common).mean(axis=1))


def make_course(record: AxisRecord, interval: float) -> Course:
    """Return the strokes of a record, with a row each `interval` or rarer.

    Raises:
        ConfigError: it has no stroke.
    """
    moving = find_motion(record)
    factor = max(1, round(interval / record.interval), -(-len(record) // _MOST_ROWS))
    factor = min(factor, max(1, round(8e-3 / record.interval)))
    thin = record.thinned(factor)
    # The set-point may step right behind the first row of a stroke, so that one is never left out.
    pairs = [
        (part, range(max(part.start // factor, rows.start), (part.stop - 1) // factor + 1))
        for stretch, rows in zip(record.stretches, thin.stretches, strict=True)
        for part in _cut(record, stretch, moving)
    ]
    pairs = [pair for pair in pairs if len(pair[1]) > 10]
    strokes = [_make_stroke(record, thin, n, *pair) for n, pair in enumerate(pairs, start=1)]
    if not strokes:
        raise ConfigError(
            "the recording has no stretch of 0.3 s with motion; record strokes both ways, with a "
            "short rest before each"
        )
    total = len(strokes)
    most = min(_MOST_STROKES, max(4, _MOST_ROWS * total // sum(len(one.rows) for one in strokes)))
    if total > most:
        strokes = [strokes[place] for place in np.linspace(0, total - 1, most).astype(int)]
    commands = np.repeat(record.setpoints, 2)
    if record.is_sampled:  # so it changed between two rows, most likely half-way
        commands = np.concatenate([commands[:1], commands[:-1]])
    return Course(thin, tuple(strokes), commands, 2 * factor, total - len(strokes))


def find_motion(record: AxisRecord) -> npt.NDArray[np.bool_]:
    """Mark the rows in which the piston moves, shape (rows,)."""
    fast = float(np.quantile(np.abs(find_speed(record, _half(record))), 0.98))
    # A coarse or noisy sensor shows a slow stroke over a longer time only.
    span = 4.0 * record.noise[0] / max(_SLOW * fast, 1e-9)
    half = max(_half(record), record.rows_in(min(span, _AVERAGED_MOST)))
    noise = 4.0 * record.noise[0] / (half * record.interval)
    return np.asarray(np.abs(find_speed(record, half)) > max(_SLOW * fast, min(noise, 0.2 * fast)))


def find_speed(record: AxisRecord, half: int) -> Values:
    """Return the velocity over so many rows on both sides of each, shape (rows,) [m/s]."""
    speed = np.zeros(len(record))
    for part in record.stretches:
        x = record.measured[part.start : part.stop, 0]
        span = min(half, (len(x) - 1) // 2)
        if span < 1:
            continue
        places = np.arange(len(x))
        ahead, behind = np.minimum(places + span, len(x) - 1), np.maximum(places - span, 0)
        passed = record.interval * (ahead - behind)
        speed[part.start : part.stop] = (x[ahead] - x[behind]) / passed
    return speed


def _half(record: AxisRecord) -> int:
    return max(1, record.rows_in(_AVERAGED))


def _cut(record: AxisRecord, part: range, moving: npt.NDArray[np.bool_]) -> list[range]:
    """Return the strokes of a stretch: cut at rests, and where they are too long."""
    u = record.setpoints[part.start : part.stop]
    is_moving = moving[part.start : part.stop]
    rest, least = max(2, record.rows_in(_REST)), record.rows_in(_SHORTEST)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], is_moving, [True]]).astype(np.int8)))
    cuts = [0]
    for first, last in edges.reshape(-1, 2).tolist():
        if last - first < rest:
            continue
        place = _steady_place(u[first:last], rest, _LIKE * record.full_opening) + first
        if place - cuts[-1] >= least:
            cuts.append(place)
    longest = record.rows_in(_LONGEST)
    cuts.append(len(u))
    edges_all = []
    for first, last in itertools.pairwise(cuts):
        count = -(-(last - first) // longest)
        edges_all += np.linspace(first, last, count + 1).astype(int)[:-1].tolist()
    edges_all.append(len(u))
    return [
        range(part.start + first, part.start + last)
        for first, last in itertools.pairwise(edges_all)
        if last - first >= least and is_moving[first:last].any()
    ]


def _steady_place(u: Values, rest: int, like: float) -> int:
    """Return the last row of a rest behind a steady command, or its middle."""
    changed = np.flatnonzero(np.abs(np.diff(u)) > like)
    ends = [*changed.tolist(), len(u) - 1]
    starts = [0, *(changed + 1).tolist()]
    fit = [end for start, end in zip(starts, ends, strict=True) if end - start + 1 >= rest // 2]
    return fit[-1] if fit else len(u) // 2


def _make_stroke(
    record: AxisRecord, thin: AxisRecord, number: int, part: range, rows: range
) -> Stroke:
    factor = max(1, round(thin.interval / record.interval))
    first = rows.start * factor
    begin = next((each.start for each in record.stretches if first in each), first)
    low = max(begin, first - _half(record))
    way = record.measured[min(len(record) - 1, first + 1), 0] - record.measured[low, 0]
    v = way / ((first + 1 - low) * record.interval)
    is_rest = abs(way) < 6.0 * record.noise[0] + 1e-5
    rest = record.rows_in(_RESTED) if is_rest else _half(record)
    near = record.measured[max(begin, first - rest) : first + 1]
    x = near[:, 0]
    start = np.array([x.mean() if is_rest else x[-1], 0.0 if is_rest else v, *near[:, 1:].mean(0)])
    setpoints = record.setpoints[part.start : part.stop] / record.full_opening
    x = record.measured[part.start : part.stop, 0]
    return Stroke(
        number=number,
        session=record.session_of(first),
        rows=rows,
        start=start,
        opening=float(np.quantile(np.abs(setpoints), 0.98)),
        is_forth=bool(x[-1] > x[0]),
    )
