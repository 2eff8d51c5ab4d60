"""The twin: a bench that hears the machine's bus, and what sets it apart from the machine.

The twin's devices obey the very frames that the machine's obey: NMT, SYNC, PDOs, and the SDO
downloads by which a controller configures them. Its plant therefore moves under the same commands.
A model that integrates a velocity drifts away from any machine, so at the end of each window the
plant is set to what the sensors say, and the next window shows how well it predicts from there.

A tick is long beside what sets a sound machine apart from its twin (0.2 m/s make 0.2 mm in 1 ms).
So a value is compared at the time when it was measured, which is that of its frame, or of the SYNC
before it where its PDO is synchronous; the velocities of the twin bridge the part of a tick.
"""

import math
from collections import deque
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import can
import numpy as np

from hil_bench.assembly import build_bench
from hil_bench.bench import Axis
from hil_bench.canopen_device.frame import Frame
from hil_bench.config import BenchConfig
from hil_bench.plant import PlantState
from hil_bench.shadow.decoder import Decoder, Reading
from hil_bench.shadow.sample_clock import SampleClock

QUANTITIES = {"position": "m", "P_A": "Pa", "P_B": "Pa", "spool_position": "-"}
"""What is compared, and in which unit."""

_NEEDED = ("position", "P_A", "P_B")
_NMT_START_ALL = Frame(0x000, b"\x01\x00")
_SECOND = 1_000_000_000
_LONGEST_SILENCE = 10.0
"""After a longer pause on the bus the twin begins anew [s]."""
_VELOCITY_SPAN = 0.012
"""Time over which the velocity at a window's begin is taken from positions [s]."""


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


class Window(NamedTuple):
    """How well the twin predicted one axis for a while.

    Attributes:
        axis: its name.
        begin: when the plant was set to what the sensors said, from the first frame [s].
        end: when the window ended [s].
        residuals: by the quantities of `QUANTITIES`.
    """

    axis: str
    begin: float
    end: float
    residuals: dict[str, Residual]


class Sample(NamedTuple):
    """One value of the machine beside the twin's.

    Attributes:
        time: of the frame that brought it, from the first frame [s].
        axis: the axis.
        quantity: one of `QUANTITIES`.
        machine: what the machine says, in that unit.
        twin: what the twin says.
    """

    time: float
    axis: str
    quantity: str
    machine: float
    twin: float


@dataclass(slots=True)
class _AxisTwin:
    """One axis: its twin, the latest readings, and the window that runs."""

    axis: Axis
    full_opening: float
    latest: dict[str, float] = field(default_factory=dict)
    positions: deque[tuple[float, float]] = field(default_factory=deque)
    begin: float | None = None
    residuals: dict[str, Residual] = field(default_factory=dict)

    def twin_value(self, quantity: str, lead: float) -> float:
        """Return what the twin has of a quantity some time [s] after its last tick."""
        output = self.axis.plant.output
        match quantity:
            case "position":
                return output.x + lead * output.v
            case "P_A":
                return output.P_A
            case "P_B":
                return output.P_B
            case _:
                return (output.nu + lead * self.axis.plant.state.nu_dot) / self.full_opening

    def note(self, quantity: str, value: float, time: float) -> None:
        self.latest[quantity] = value
        if quantity == "position":
            self.positions.append((time, value))
            while self.positions[0][0] < time - _VELOCITY_SPAN:
                self.positions.popleft()

    def anchor(self, time: float, now: float) -> None:
        """Set the plant to what the sensors say, and begin a window.

        Args:
            time: of the latest position [s].
            now: of the twin's last tick [s].
        """
        plant = self.axis.plant
        limit, floor = plant.parameters.h, plant.options.cavitation_floor
        pressures = (self.latest["P_A"], self.latest["P_B"])
        P_A, P_B = pressures if floor is None else (max(p, floor) for p in pressures)  # noqa: N806
        velocity = self._velocity()
        position = self.latest["position"] + velocity * (now - time)
        plant.restart(
            PlantState(
                x=min(max(position, -limit), limit),
                v=velocity,
                P_A=P_A,
                P_B=P_B,
                nu=plant.state.nu,
                nu_dot=plant.state.nu_dot,
            )
        )
        self.begin = time
        self.residuals = {quantity: Residual() for quantity in QUANTITIES}

    def _velocity(self) -> float:
        """Return the slope of the latest positions [m/s]; 0 where one says nothing."""
        times, values = np.array(self.positions).T
        times = times - times.mean()
        spread = float(times @ times)
        return float(times @ (values - values.mean())) / spread if spread > 0.0 else 0.0


class Shadow:
    """The twin of a machine on a bus.

    Args:
        config: what the machine should be; its plant's parameters are the twin's. The twin has no
            faults and stores no parameters, whatever is configured.
        horizon: length of a window [s].

    Attributes:
        windows: those that ended, oldest first; take them out at will.
        samples: values side by side since you last took them out.
        frames: how many were heard.
    """

    def __init__(self, config: BenchConfig, *, horizon: float = 0.5) -> None:
        config = _sound(config)
        self.windows: deque[Window] = deque()
        self.samples: deque[Sample] = deque(maxlen=1_000_000)
        self.frames = 0
        self._horizon = horizon
        self._tick = config.tick_ns
        self._decoder = Decoder(config)
        self._bench = build_bench(config)
        self._bench.start(0)
        self._clock = SampleClock(self._bench.nodes)
        self._axes = {
            axis.name: _AxisTwin(axis, axis.valve.full_opening) for axis in self._bench.axes
        }
        # The machine may have been started before we listened.
        self._waiting = [_NMT_START_ALL]
        self._now = 0
        self._first: float | None = None

    def take(self, message: can.Message) -> None:
        """Take a frame that was on the bus; frames come in the order of their time stamps."""
        self.frames += 1
        if message.is_error_frame or message.is_fd:
            return
        if self._first is None:
            self._first = message.timestamp
        time = message.timestamp - self._first
        self._advance(time)
        sampled = self._clock.sample_time(message, time)
        for reading in self._decoder.take(message, time):
            self._compare(reading, sampled)
        if not message.is_extended_id:
            self._waiting.append(
                Frame(
                    message.arbitration_id,
                    bytes(message.data),
                    is_remote=message.is_remote_frame,
                )
            )

    def _advance(self, time: float) -> None:
        """Run the twin up to a time [s]."""
        if time - self._now / _SECOND > _LONGEST_SILENCE:
            self._now = round(time * _SECOND)
            for twin in self._axes.values():
                twin.begin = None
        while self._now + self._tick <= time * _SECOND:
            frames, self._waiting = self._waiting, []
            self._bench.tick(frames, self._now)
            self._now += self._tick

    def _compare(self, reading: Reading, time: float) -> None:
        """Hold what was measured at a time [s] against the twin."""
        twin, now = self._axes[reading.axis], self._now / _SECOND
        value = reading.value()
        twin.note(reading.quantity, value, time)
        if twin.begin is None:
            if all(quantity in twin.latest for quantity in _NEEDED):
                twin.anchor(time, now)
            return
        expected = twin.twin_value(reading.quantity, time - now)
        twin.residuals[reading.quantity].add(value - expected)
        self.samples.append(Sample(time, reading.axis, reading.quantity, value, expected))
        if time - twin.begin >= self._horizon and reading.quantity == "position":
            self.windows.append(Window(reading.axis, twin.begin, time, twin.residuals))
            twin.anchor(time, now)


def _sound(config: BenchConfig) -> BenchConfig:
    """Return a bench without faults, stored parameters and Modbus."""
    nodes = tuple(replace(node, storage=None) for node in config.nodes)
    return replace(config, nodes=nodes, faults=(), modbus=None)
