"""Two models that know no hydraulics, beside which an estimate by the plant is to be judged.

A straight line of the command for each way, and a linear system of second order with a gain each
way, a natural frequency, a damping and a delay. Both say the piston's position only.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import StateSpace, cont2discrete, lfilter

from stranger_prediction import TICK, Shown, Stroke, Values, delayed


class Line(NamedTuple):
    """Speed as gain times command plus offset, each way, while the valve is open."""

    gains: tuple[float, float]
    offsets: tuple[float, float]
    ends: tuple[float, float] = (-np.inf, np.inf)
    """Between which the positions stay that were logged [m]."""

    def speeds(self, command: Values) -> Values:
        """Return speeds [m/s]."""
        way = (command < 0.0).astype(int)
        gain, offset = np.array(self.gains)[way], np.array(self.offsets)[way]
        return np.where(command == 0.0, 0.0, gain * command + offset)

    def __call__(self, stroke: Stroke) -> Shown:
        """Add the speeds up from the start of a stroke."""
        return _placed(stroke, self.speeds(stroke.command), self.ends)


class SecondOrder(NamedTuple):
    """The line's speed behind a lag of second order and a delay."""

    line: Line
    omega: float
    damping: float
    delay: float

    def __call__(self, stroke: Stroke) -> Shown:
        """Add the speeds up from the start of a stroke."""
        speeds = self.line.speeds(delayed(stroke.command, self.delay))
        w, d = self.omega, self.damping
        system = StateSpace([[0.0, 1.0], [-w * w, -2.0 * d * w]], [[0.0], [w * w]], [[1.0, 0.0]], 0)
        a, b, c, _, _ = cont2discrete((system.A, system.B, system.C, system.D), TICK)
        numerator = np.array([0.0, (c @ b).item(), (c @ (a @ b - np.trace(a) * b)).item()])
        shown = lfilter(numerator, [1.0, -np.trace(a), np.linalg.det(a)], speeds)
        return _placed(stroke, shown, self.line.ends)


def _placed(stroke: Stroke, speeds: Values, ends: tuple[float, float]) -> Shown:
    unknown = np.full(len(speeds), np.nan)
    return Shown(np.clip(stroke.x[0] + np.cumsum(speeds) * TICK, *ends), unknown, unknown)


def _middle_speed(stroke: Stroke) -> tuple[float, float]:
    """Return the command and the speed in the middle of the way."""
    travel = np.abs(stroke.x - stroke.x[0])
    span = travel[-1]
    rows = np.flatnonzero((travel > 0.3 * span) & (travel < 0.7 * span) & (stroke.command != 0.0))
    slope = np.polyfit(rows * TICK, stroke.x[rows], 1)[0]
    return float(np.median(stroke.command[rows])), float(slope)


def fit_line(strokes: Sequence[Stroke]) -> Line:
    """Fit a straight line to the speeds in the middle of the strokes, each way."""
    pairs = np.array([_middle_speed(one) for one in strokes])
    lines = []
    for mine in (pairs[pairs[:, 0] > 0.0], pairs[pairs[:, 0] < 0.0]):
        degree = 1 if len(np.unique(mine[:, 0])) > 1 else 0
        line = np.polyfit(mine[:, 0], mine[:, 1], degree)
        lines.append(line if degree else (line[0] / mine[0, 0], 0.0))
    (forward, lift), (back, drop) = lines
    places = np.concatenate([one.x for one in strokes])
    ends = float(places.min()), float(places.max())
    return Line((float(forward), float(back)), (float(lift), float(drop)), ends)


def fit_second_order(strokes: Sequence[Stroke]) -> SecondOrder:
    """Fit gains, offsets, frequency, damping and delay to the positions of the strokes."""
    line = fit_line(strokes)

    def build(numbers: Values) -> SecondOrder:
        gains, offsets = (numbers[0], numbers[1]), (numbers[2], numbers[3])
        w, damping, delay = np.exp(numbers[4:7])
        return SecondOrder(Line(gains, offsets, line.ends), float(w), float(damping), float(delay))

    def missed(numbers: Values) -> Values:
        model = build(numbers)
        off = [((one.x - model(one).x) / 1e-3)[::5] for one in strokes]
        return np.clip(np.nan_to_num(np.concatenate(off), nan=1e3), -1e3, 1e3)

    start = np.array([*line.gains, *line.offsets, *np.log([100.0, 0.7, 5e-3])])
    low = np.array([-5.0, -5.0, -1.0, -1.0, *np.log([5.0, 0.05, 1e-4])])
    high = np.array([5.0, 5.0, 1.0, 1.0, *np.log([800.0, 3.0, 0.1])])
    found = least_squares(missed, start, bounds=(low, high), loss="soft_l1", diff_step=1e-4)
    return build(found.x)
