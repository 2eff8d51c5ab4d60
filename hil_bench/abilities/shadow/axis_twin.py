"""The twin of an axis, its trace, and the residual between it and the machine."""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from hil_bench.abilities.shadow.followed_valve import FollowedValve
from hil_bench.abilities.shadow.sample_clock import STATUS_WORD, Reading, SampleTime
from hil_bench.devices.axis import Axis
from hil_bench.devices.valve_408 import ValveDevice
from hil_bench.devices.valve_state_machine import ValveState

# The deviation of a machine from its twin.


@dataclass(slots=True)
class Residual:
    """Machine less twin of one quantity over a window.

    A device that sends by event sends most while its value moves. So each residual counts for the
    time that it stands for, not for its number of frames.

    Attributes:
        count: values compared.
        time: what they stand for [s].
        squares: integral of the residual's square over that time.
        largest: largest residual in size.
    """

    count: int = 0
    time: float = 0.0
    squares: float = 0.0
    largest: float = 0.0

    @property
    def rms(self) -> float:
        """Root mean square over time; NaN without any value."""
        if not self.count:
            return math.nan
        return math.sqrt(self.squares / self.time) if self.time else self.largest

    def add(self, residual: float, duration: float) -> None:
        """Take one residual, which stands for the time [s] since the one before."""
        self.count += 1
        self.time += duration
        self.squares += residual * residual * duration
        self.largest = max(self.largest, abs(residual))


# The trace of an axis' twin over the last ticks.


class Row(NamedTuple):
    """The twin at the end of one tick.

    Attributes:
        time: of the tick's end [s].
        values: what each device would say without noise, by its name, in SI units.
    """

    time: float
    values: dict[str, float]


class Trace:
    """The last rows, to compare values of the machine with that are older than the twin's present.

    Args:
        length: how many rows are kept.
    """

    def __init__(self, length: int) -> None:
        self._rows: deque[Row] = deque(maxlen=length)

    def append(self, row: Row) -> None:
        """Take the newest row."""
        self._rows.append(row)

    def clear(self) -> None:
        """Forget all rows."""
        self._rows.clear()

    def shift(self, offsets: Mapping[str, float]) -> None:
        """Move all rows by what the twin was moved by."""
        for _, values in self._rows:
            for name, offset in offsets.items():
                values[name] += offset

    def at(self, name: str, time: float) -> float:
        """Return the value at a time [s], interpolated; beyond either end, that of the end."""
        rows = self._since(time)
        if len(rows) == 1:
            return rows[0].values[name]
        return _between(rows[0], rows[1], name, time)

    def distance(self, name: str, value: float, begin: float, end: float) -> float:
        """Return the distance of a value beyond all of the twin's from `begin` to `end` [s].

        Args:
            name: of the device.
            value: what the machine's says.
            begin: when it was measured at the earliest [s].
            end: when at the latest [s].

        Returns:
            The value less the nearest of the twin's; 0 if it lies among them.
        """
        rows = self._since(begin)
        found = [self.at(name, begin), self.at(name, end)]
        found += [row.values[name] for row in rows if begin <= row.time <= end]
        return value - min(max(value, min(found)), max(found))

    def _since(self, time: float) -> list[Row]:
        """Return the rows from the last one that is not after a time on; at least one."""
        found: list[Row] = []
        for row in reversed(self._rows):
            found.append(row)
            if row.time <= time:
                break
        found.reverse()
        return found


def _between(before: Row, after: Row, name: str, time: float) -> float:
    share = min(max((time - before.time) / (after.time - before.time), 0.0), 1.0)
    value = before.values[name]
    return value + share * (after.values[name] - value)


# One axis of the twin: what is known of the machine, and how far it is from the twin.

POSITION, SPEED = "position", "speed"
"""What a window begins and ends with, and what positions show by the way."""
SETPOINT = "set-point"
"""What else may be missing: a command to the valve."""

_REMEMBERED = 0.1
"""Time that the twin looks back: a value may come some milliseconds after it was measured [s]."""
_VELOCITY_SPAN = 0.012
"""Time over which positions show by how much the velocity is off [s]."""
_SETTLING = 0.1
"""Time from joining a machine to the first window: spool and pressures settle meanwhile [s]."""
_SHORTEST_PATIENCE = 1.0


class Window(NamedTuple):
    """The quality of the twin's prediction of one axis for a while.

    Attributes:
        axis: its name.
        begin: when the plant was set to what the sensors said, from the first frame [s].
        end: when the window ended [s].
        residuals: by the quantities that a twin compares.
        lateness: by how much a PDO came later than usual, at most [s].
    """

    axis: str
    begin: float
    end: float
    residuals: dict[str, Residual]
    lateness: float


class Correction(NamedTuple):
    """The machine's valve was in another state than the twin's, which then took over that state.

    Attributes:
        time: when, from the first frame [s].
        axis: of the valve.
        twin: the state in which the twin's was.
        machine: the state in which the machine's is.
    """

    time: float
    axis: str
    twin: ValveState
    machine: ValveState


class AxisTwin:
    """The twin of one axis.

    It joins the machine as soon as everything is known that its motion depends on, whatever the
    machine is doing then, and leaves it when that is known no longer.

    Args:
        axis: of the twin's bench.
        readings: what the machine's devices of this axis say.
        tick: of the twin's bench [s].
        horizon: length of a window [s].

    Attributes:
        axis: as passed in, with a valve that follows the machine's.
        valve: that valve; None where another device commands the spool.
        begin: of the window that runs, None while there is none [s].
        patience: how long a quantity may be silent and still count as known [s].
        compared: the quantities that the machine's devices say.
        corrections: of the valve's state while the twin followed; take them out at will.
    """

    def __init__(
        self, axis: Axis, readings: Sequence[Reading], *, tick: float, horizon: float
    ) -> None:
        self.axis = axis
        self.valve: FollowedValve | None = None
        if isinstance(axis.valve, ValveDevice):
            self.valve = FollowedValve(axis.valve)
            self.axis = replace(axis, valve=self.valve)
        self.begin: float | None = None
        self.patience = max(_SHORTEST_PATIENCE, 2.0 * horizon)
        self.corrections: deque[Correction] = deque(maxlen=1000)
        self._horizon = horizon
        quantities = [q.name for q in axis.quantities if q.residual is not None]
        self._anchors = tuple(q.name for q in axis.quantities if q.is_anchor)
        self._outputs = {q.name: q.output for q in axis.quantities if q.output is not None}
        self._spool = next(name for name, at in self._outputs.items() if at == axis.follower)
        self._needed = (*self._anchors, *((STATUS_WORD,) if self.valve else ()))
        self._quantities = {
            reading.name: reading.quantity
            for reading in readings
            if reading.quantity != STATUS_WORD
        }
        said = set(self._quantities.values())
        self.compared = tuple(quantity for quantity in quantities if quantity in said)
        self._trace = Trace(max(2, math.ceil(_REMEMBERED / tick)))
        self._joined_at: float | None = None
        self._heard: dict[str, float] = {}
        self._invalid: set[str] = set()
        self._apart = dict.fromkeys(quantities, 0.0)
        self._slope: deque[tuple[float, float]] = deque()
        self._residuals: dict[str, Residual] = {}
        self._counted: dict[str, float] = {}
        self._lateness = 0.0

    @property
    def is_comparable(self) -> bool:
        """Return True if there are devices that report all that a window begins with."""
        return POSITION in self._anchors and set(self._anchors) <= set(self._quantities.values())

    def missing(self, now: float) -> dict[str, str]:
        """Return the unknown values at a time [s], with the reasons."""
        found = {}
        for name in self._needed:
            heard = self._heard.get(name)
            if name in self._invalid:
                found[name] = "not valid, says the device"
            elif heard is None:
                found[name] = "not heard"
            elif now - heard > self.patience:
                found[name] = f"silent for {now - heard:.1f} s"
        valve = self.valve
        if valve is not None and valve.reported is ValveState.ACTIVE and valve.obstacle:
            found[SETPOINT] = valve.obstacle
        return found

    def forget(self) -> None:
        """Leave the machine, and forget what it said."""
        self.leave()
        self._heard.clear()
        self._invalid.clear()
        self._slope.clear()
        self._trace.clear()

    def leave(self) -> None:
        """End the window that runs, unjudged; the next position joins the machine anew."""
        self.begin = self._joined_at = None

    def note(self, now: float) -> None:
        """Remember what the twin's devices measure at the end of a tick [s]."""
        values = {
            sensor.name: sensor.measured
            for sensor in self.axis.sensors
            if sensor.name in self._quantities
        }
        spool = self.axis.plant.output[self.axis.follower] / self.axis.valve.full_opening
        for name, quantity in self._quantities.items():
            if quantity == self._spool:
                values[name] = spool
        self._trace.append(Row(now, values))

    def take(self, reading: Reading, value: float, sampled: SampleTime) -> float | None:
        """Take a value of the machine.

        Args:
            reading: what it is.
            value: the value in SI units, NaN if it is not valid.
            sampled: when it was measured.

        Returns:
            What the twin had, if the value counts in the window that runs.
        """
        quantity = reading.quantity
        if math.isnan(value):
            self._invalid.add(quantity)
            self.leave()
            return None
        self._invalid.discard(quantity)
        self._heard[quantity] = sampled.frame
        if quantity == STATUS_WORD:
            self._follow_valve(int(value), sampled)
            return None
        expected = self._trace.at(reading.name, sampled.likely)
        if math.isnan(expected):
            return None
        self._apart[quantity] = value - expected
        if quantity == POSITION:
            self._note_slope(sampled.likely, value - expected)
        if self.missing(sampled.frame):
            self.leave()
        elif self.begin is not None:
            self._count(reading, value, sampled)
            return expected
        elif quantity == POSITION:
            self._join(sampled.frame)
        return None

    def window_at(self, time: float) -> Window | None:
        """Return the window that ends at the time of a position [s], and begin the next one."""
        if self.begin is None or time - self.begin < self._horizon:
            return None
        window = Window(self.axis.name, self.begin, time, self._residuals, self._lateness)
        self._begin(time)
        return window

    def _follow_valve(self, status_word: int, sampled: SampleTime) -> None:
        valve = self.valve
        if valve is None:
            return
        before = valve.state
        if valve.hear(status_word, sampled.earliest):
            if self.begin is not None:
                machine = valve.reported or before
                self.corrections.append(Correction(sampled.frame, self.axis.name, before, machine))
            self.leave()

    def _join(self, now: float) -> None:
        """Join the machine, or begin the first window once the twin has settled."""
        if self._joined_at is None:
            self._joined_at = now
            self._anchor_all()
        elif now - self._joined_at >= _SETTLING and self._can_shift():
            self._anchor_all()
            self._begin(now)

    def _can_shift(self) -> bool:
        if self.valve is None:
            return True
        spool = self.axis.plant.output[self.axis.follower] / self.axis.valve.full_opening
        return self.valve.can_shift(spool + self._apart[self._spool])

    def _anchor_all(self) -> None:
        """Set the spool, and what commands it, to what the machine says, too."""
        if self.valve is not None:
            self.valve.shift(self._apart[self._spool], self._apart[POSITION])
        self._anchor((*self._anchors, self._spool))

    def _begin(self, time: float) -> None:
        self._anchor(self._anchors)
        self.begin = time
        self._residuals = {quantity: Residual() for quantity in self.compared}
        self._counted = dict.fromkeys(self.compared, time)
        self._lateness = 0.0

    def _count(self, reading: Reading, value: float, sampled: SampleTime) -> None:
        quantity = reading.quantity
        self._lateness = max(self._lateness, sampled.lateness)
        residual = self._trace.distance(reading.name, value, sampled.earliest, sampled.latest)
        since, self._counted[quantity] = self._counted[quantity], sampled.frame
        self._residuals[quantity].add(residual, max(sampled.frame - since, 0.0))

    def _anchor(self, quantities: tuple[str, ...]) -> None:
        """Move the plant to where the sensors say it is."""
        apart = {quantity: self._apart[quantity] for quantity in quantities}
        output = self.axis.plant.output
        values = {name: output[self._outputs[name]] + off for name, off in apart.items()}
        if self._spool in apart:
            off = apart[self._spool] * self.axis.valve.full_opening
            values[self._spool] = output[self.axis.follower] + off
        if SPEED in self._outputs:
            values[SPEED] = output[self._outputs[SPEED]] + self._excess_velocity()
        self.axis.plant.go_to(values)
        self._trace.shift(
            {name: apart.get(quantity, 0.0) for name, quantity in self._quantities.items()}
        )
        self._slope.clear()
        self._apart.update(dict.fromkeys(apart, 0.0))

    def _note_slope(self, time: float, apart: float) -> None:
        self._slope.append((time, apart))
        while self._slope[0][0] < time - _VELOCITY_SPAN:
            self._slope.popleft()

    def _excess_velocity(self) -> float:
        """Return the slope of machine less twin [m/s]; 0 where one position says nothing."""
        if not self._slope:
            return 0.0
        times, values = np.array(self._slope).T
        times = times - times.mean()
        spread = float(times @ times)
        return float(times @ (values - values.mean())) / spread if spread > 0.0 else 0.0
