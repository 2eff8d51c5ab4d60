"""Effects of a logger and its inputs: samples lost, channels clipped.

All of it is found in the columns alone, before any fit, and named.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.record import (
    FLOORS,
    SIGNALS,
    AxisRecord,
    estimate_noise,
    quiet_noise,
)
from hil_bench.units import BAR, MILLIMETRE

Values = npt.NDArray[np.float64]
Marks = npt.NDArray[np.bool_]

_NEAR = 2  # rows on each side of a step that it is compared with
_FASTER = 1.6  # times the longest of these steps
_JUMP = 12.0  # standard deviations of the noise, beyond that
_LINE, _APART, _ROUGH = 8, 0.6, 6.0  # rows on each side; shares of the jump and the roughness
_STRUCK = (0.98, 3.0)  # of all changes from step to step, and times that: no change but a jump
_LONGEST = 8  # rows one after the other at one value that noise hardly gives
_STOP = 0.1  # of half the stroke, by which a stop may be elsewhere than configured
_EQUAL = 0.3  # share of rows like the row before: above, the column is coarse or without noise


class Jump(NamedTuple):
    """Rows between which samples are lost.

    Attributes:
        row: the last one before.
        way: by which the position jumps, less what it would move anyway.
        lost: about how many rows.
    """

    row: int
    way: float
    lost: int


def look_through(record: AxisRecord, half_stroke: float) -> AxisRecord:
    """Return a record of one recording with what its logger has done, named in its notes.

    Nothing of the fit reaches across lost samples; clipped values count for nothing.

    Args:
        record: of one recording.
        half_stroke: at about which the piston stands in its stop, rather than its sensor [m].
    """
    notes: list[str] = []
    clipped = np.zeros(record.measured.shape, dtype=np.bool_)
    noise = record.noise.copy()
    for signal, name in enumerate(SIGNALS):
        values = record.measured[:, signal]
        if not np.isfinite(values).all():
            continue
        stop = half_stroke if signal == 0 else math.inf
        clipped[:, signal], ends = find_clipped(values, FLOORS[signal], stop)
        if ends:
            unit = BAR if signal else MILLIMETRE
            places = " and ".join(f"{unit.from_si(end):.4g} {unit.symbol}" for end in ends)
            share = clipped[:, signal].mean()
            notes.append(f"{name} is clipped at {places}: {share:.1%} of its rows do not count")
            noise[signal] = estimate_noise(values[~clipped[:, signal]], FLOORS[signal])
    jumps = [
        jump._replace(row=jump.row + part.start)
        for part in record.stretches
        for jump in find_jumps(record.measured[part.start : part.stop, 0], noise[0])
    ]
    if jumps:
        farthest = MILLIMETRE.from_si(max(abs(one.way) for one in jumps))
        notes.append(
            f"behind an even column of time the position jumps in {len(jumps)} of {len(record)} "
            f"rows, first at {record.times[jumps[0].row]:.6g} s, by up to {farthest:.3g} mm: rows "
            f"are missing, about {sum(jump.lost for jump in jumps)}"
        )
        record = record.split_at([one.row for one in jumps])
    return replace(record, noise=noise, clipped=clipped, notes=(*record.notes, *notes))


def find_jumps(position: Values, noise: float) -> list[Jump]:
    """Find the jumps at which samples are lost behind an even column of time.

    A piston that is struck gets from one velocity to another, and its way from row to row lies
    between both. Where rows are missing, that way is longer than those on both sides, by more than
    the ways of this record change from row to row.

    Args:
        position: of each row.
        noise: its standard deviation.
    """
    steps = np.diff(position)
    sizes = np.abs(steps)
    if len(steps) < 4 * _NEAR:
        return []
    windows = np.lib.stride_tricks.sliding_window_view(sizes, _NEAR)
    count = len(steps) - 2 * _NEAR
    beside = np.maximum(windows[:count].max(axis=1), windows[_NEAR + 1 :].max(axis=1))
    places = np.flatnonzero(sizes[_NEAR : _NEAR + count] > _FASTER * beside + _JUMP * noise)
    share, times = _STRUCK
    least = times * float(np.quantile(np.abs(np.diff(steps)), share))
    jumps = []
    for place in (places + _NEAR).tolist():
        near = [*range(place - _NEAR, place), *range(place + 1, place + 1 + _NEAR)]
        usual, step = float(steps[near].mean()), float(steps[place])
        if abs(step - usual) < least or not _is_apart(position, place, abs(step - usual)):
            continue
        is_way = usual * step > 0.0 and abs(usual) > noise
        lost = max(1, round(step / usual) - 1) if is_way else 1
        jumps.append(Jump(place, step - usual, lost))
    return jumps


def _is_apart(position: Values, place: int, way: float) -> bool:
    """Return True if lines through the rows before and after a place are as far apart as a jump.

    The steps of a coarse sensor are jumps beside their neighbours, but return to the line.
    """
    sides = position[max(place + 1 - _LINE, 0) : place + 1][::-1], position[place + 1 :][:_LINE]
    middle, rough = [], []
    for side in sides:
        rows = np.arange(len(side)) + 0.5
        line = np.polyfit(rows, side, 1)
        middle.append(line[1])
        rough.append(np.square(side - np.polyval(line, rows)).mean())
    apart = abs(middle[1] - middle[0])
    return bool(apart > max(_APART * way, _ROUGH * math.sqrt(np.mean(rough))))


def find_clipped(values: Values, floor: float, stop: float = math.inf) -> tuple[Marks, list[float]]:
    """Return the rows at which a channel is at an end of its range, and these ends.

    Noise does not stand still. A channel that does so for a while at its highest or lowest value,
    and hardly elsewhere, shows the end of a range.

    Args:
        values: of each row.
        floor: noise below which nothing can be said.
        stop: size at about which what is measured stands still itself.
    """
    marks, ends = np.zeros(len(values), dtype=np.bool_), []
    is_like = np.diff(values, prepend=np.nan) == 0.0
    low, high = values.min(), values.max()
    is_inside = (values != low) & (values != high)
    if not is_inside.any():
        return marks, []
    if is_like[is_inside].mean() > _EQUAL or quiet_noise(values[is_inside]) < floor:
        return marks, []
    for end in (low, high):
        long = [run for run in _runs(values == end) if len(run) >= _LONGEST]
        if not long or abs(abs(end) - stop) < _STOP * stop:
            continue
        ends.append(float(end))
        for run in long:
            marks[run.start : run.stop] = True
    return marks, ends


def _runs(marks: Marks) -> list[range]:
    """Return the runs of rows that are marked."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marks, [False]]).astype(np.int8)))
    return [range(first, last) for first, last in edges.reshape(-1, 2).tolist()]


# The response of sensors that are behind: a position that is late, pressures behind a lag.

_PROMPT = 1e-3  # of a row: a lag below it counts as nothing


def sense(motion: Values, delay: float, lag: float) -> Values:
    """Return the sensors' values along a motion that begins at rest.

    Args:
        motion: position [m], P_A and P_B [Pa] at the start and in each row, shape (rows + 1, 3).
        delay: of the position, in rows.
        lag: time constant of the first-order lag of the pressures, in rows; exact for pressures
            that are straight between two rows.

    Returns:
        The values in each row, shape (rows, 3).
    """
    places = np.arange(len(motion))
    shown = motion[1:].copy()
    shown[:, 0] = np.interp(places[1:] - delay, places, motion[:, 0])
    if lag > _PROMPT:
        from scipy.signal import lfilter  # noqa: PLC0415 - an extra

        fade = np.exp(-1.0 / lag)
        share = lag * (1.0 - fade)
        # y_k+1 = fade y_k + (share - fade) x_k + (1 - share) x_k+1
        coefficients = ([1.0 - share, share - fade], [1.0, -fade])
        state = share * motion[:1, 1:]
        shown[:, 1:], _ = lfilter(*coefficients, motion[1:, 1:], axis=0, zi=state)
    return shown
