"""One axis of the twin: its plant, what it has just done, and how far the machine is from it."""

import bisect
import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from hil_bench.axis import Axis
from hil_bench.plant import PlantState

QUANTITIES = {"position": "m", "P_A": "Pa", "P_B": "Pa", "spool_position": "-"}
"""What is compared, and in which unit."""

_NEEDED = ("position", "P_A", "P_B")
_PLACES = {quantity: place for place, quantity in enumerate(QUANTITIES, start=1)}
_REMEMBERED = 64
"""Ticks that the twin looks back: a value may come some milliseconds after it was measured."""
_VELOCITY_SPAN = 0.012
"""Time over which positions tell how much the velocity is off [s]."""


@dataclass(slots=True)
class Residual:
    """Machine less twin of one quantity over a window.

    Attributes:
        count: values compared.
        squares: sum of the residuals' squares.
        largest: largest residual in size.
    """

    count: int = 0
    squares: float = 0.0
    largest: float = 0.0

    @property
    def rms(self) -> float:
        """Root mean square of the residuals; NaN without any."""
        return math.sqrt(self.squares / self.count) if self.count else math.nan

    def add(self, residual: float) -> None:
        """Count one residual."""
        self.count += 1
        self.squares += residual * residual
        self.largest = max(self.largest, abs(residual))


@dataclass(slots=True)
class AxisTwin:
    """The twin of one axis.

    Attributes:
        axis: it moves as its bench does.
        begin: of the window that runs, None before the first [s].
        residuals: machine less twin of this window, by quantity.
    """

    axis: Axis
    begin: float | None = None
    residuals: dict[str, Residual] = field(default_factory=dict)
    _past: deque[tuple[float, ...]] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))
    _latest: dict[str, float] = field(default_factory=dict)
    _apart: deque[tuple[float, float]] = field(default_factory=deque)

    @property
    def is_known(self) -> bool:
        """Whether the sensors have said all that a window begins with."""
        return all(quantity in self._latest for quantity in _NEEDED)

    def forget(self) -> None:
        """Begin anew with the next values."""
        self.begin = None
        self._past.clear()
        self._latest.clear()
        self._apart.clear()

    def note(self, now: float) -> None:
        """Remember where the twin is at the end of a tick [s]."""
        output = self.axis.plant.output
        spool = output.nu / self.axis.valve.full_opening
        self._past.append((now, output.x, output.P_A, output.P_B, spool))

    def compare(self, quantity: str, value: float, time: float) -> float:
        """Take what the machine says of a quantity; return what the twin said at that time [s]."""
        expected = self._value_at(quantity, time)
        self._latest[quantity] = value - expected
        if quantity == "position":
            self._apart.append((time, value - expected))
            while self._apart[0][0] < time - _VELOCITY_SPAN:
                self._apart.popleft()
        return expected

    def anchor(self, time: float) -> None:
        """Move the plant to where the sensors say it is, and begin a window at a time [s]."""
        plant = self.axis.plant
        state, floor = plant.state, plant.options.cavitation_floor
        position, P_A, P_B = (self._latest[quantity] for quantity in _NEEDED)  # noqa: N806
        lowest = -math.inf if floor is None else floor
        P_A_now, P_B_now = max(state.P_A + P_A, lowest), max(state.P_B + P_B, lowest)  # noqa: N806
        plant.restart(
            PlantState(
                x=min(max(state.x + position, -plant.parameters.h), plant.parameters.h),
                v=state.v + self._excess_velocity(),
                P_A=P_A_now,
                P_B=P_B_now,
                nu=state.nu,
                nu_dot=state.nu_dot,
                V_CA=state.V_CA if P_A_now == floor else 0.0,
                V_CB=state.V_CB if P_B_now == floor else 0.0,
            )
        )
        moved = [(at, x + position, a + P_A, b + P_B, nu) for at, x, a, b, nu in self._past]
        self._past.clear()
        self._past.extend(moved)
        self._apart.clear()
        self._latest.update(dict.fromkeys(_NEEDED, 0.0))
        self.begin = time
        self.residuals = {quantity: Residual() for quantity in QUANTITIES}

    def _value_at(self, quantity: str, time: float) -> float:
        """Return what the twin had of a quantity at a time [s]: of the present tick or before."""
        past, place = self._past, _PLACES[quantity]
        if not past or time >= past[-1][0]:
            return self._present(quantity, time)
        later = max(1, bisect.bisect_right(past, time, key=lambda row: row[0]))
        before, after = past[later - 1], past[later]
        share = max(0.0, (time - before[0]) / (after[0] - before[0]))
        return before[place] + share * (after[place] - before[place])

    def _present(self, quantity: str, time: float) -> float:
        output = self.axis.plant.output
        match quantity:
            case "position":
                return output.x + output.v * (time - self._past[-1][0] if self._past else 0.0)
            case "P_A":
                return output.P_A
            case "P_B":
                return output.P_B
            case _:
                return output.nu / self.axis.valve.full_opening

    def _excess_velocity(self) -> float:
        """Return the slope of machine less twin [m/s]; 0 where one position says nothing."""
        times, values = np.array(self._apart).T
        times = times - times.mean()
        spread = float(times @ times)
        return float(times @ (values - values.mean())) / spread if spread > 0.0 else 0.0
