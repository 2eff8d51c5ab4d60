"""The twin: a bench that hears the machine's bus, and what sets it apart from the machine.

The twin's devices obey the very frames that the machine's obey: NMT, SYNC, PDOs, and the SDO
downloads by which a controller configures them. Its plant therefore moves under the same commands.
A model that integrates a velocity drifts away from any machine, so at the end of each window the
plant is set to what the sensors say, and the next window shows how well it predicts from there.

A tick is long beside what sets a sound machine apart from its twin (0.2 m/s make 0.2 mm in 1 ms).
So a value is compared at the time when it was measured, which is that of its frame, or of the SYNC
before it where its PDO is synchronous.
"""

from collections import deque
from dataclasses import replace
from typing import NamedTuple

import can

from hil_bench.assembly import build_bench
from hil_bench.canopen_device.frame import Frame
from hil_bench.config import BenchConfig
from hil_bench.shadow.axis_twin import AxisTwin, Residual
from hil_bench.shadow.decoder import Decoder, Reading
from hil_bench.shadow.sample_clock import SampleClock

_NMT_START_ALL = Frame(0x000, b"\x01\x00")
_SECOND = 1_000_000_000
_ROUNDING = 1000
"""Of time stamps, which count from 1970 in double precision [ns]."""
_LONGEST_SILENCE = 10.0
"""After a longer pause on the bus the twin begins anew [s]."""


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
        self._axes = {axis.name: AxisTwin(axis) for axis in self._bench.axes}
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
                twin.forget()
        # A set-point of this very time still belongs to the tick that ends now.
        while self._now + self._tick < time * _SECOND - _ROUNDING:
            frames, self._waiting = self._waiting, []
            self._bench.tick(frames, self._now)
            self._now += self._tick
            for twin in self._axes.values():
                twin.note(self._now / _SECOND)

    def _compare(self, reading: Reading, time: float) -> None:
        """Hold what was measured at a time [s] against the twin."""
        twin, value = self._axes[reading.axis], reading.value()
        expected = twin.compare(reading.quantity, value, time)
        if twin.begin is None:
            if twin.is_known:
                twin.anchor(time)
            return
        twin.residuals[reading.quantity].add(value - expected)
        self.samples.append(Sample(time, reading.axis, reading.quantity, value, expected))
        if time - twin.begin >= self._horizon and reading.quantity == "position":
            self.windows.append(Window(reading.axis, twin.begin, time, twin.residuals))
            twin.anchor(time)


def _sound(config: BenchConfig) -> BenchConfig:
    """Return a bench without faults, stored parameters and Modbus; it must have an axis."""
    axes = (config.first_axis, *config.axes[1:])
    nodes = tuple(replace(node, storage=None) for node in config.nodes)
    return replace(config, axes=axes, nodes=nodes, faults=(), modbus=None)
