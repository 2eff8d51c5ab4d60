"""The twin of a machine, and the limits of its residuals."""

import math
from collections import deque
from dataclasses import replace
from typing import Any, NamedTuple

import can

from hil_bench.abilities.shadow.axis_twin import AxisTwin, Window
from hil_bench.abilities.shadow.followed_valve import NodeStates
from hil_bench.abilities.shadow.sample_clock import (
    OverheardDrivers,
    Reading,
    SampleClock,
    SampleTime,
)
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import BenchConfig, NodeConfig
from hil_bench.canopen_device.frame import Frame
from hil_bench.devices.measurement.low_pass import ChainParameters

# The twin: a bench that hears the machine's bus, and what sets it apart from the machine.
#
# The twin's devices obey the very frames that the machine's obey: NMT, SYNC, PDOs, and the SDO
# downloads by which a controller configures them. Its plant therefore moves under the same
# commands. A model that integrates a velocity drifts away from any machine, so at the end of each
# window the plant is set to what the sensors say, and the next window shows how well it predicts
# from there.
#
# A tick is long beside what sets a sound machine apart from its twin (0.2 m/s make 0.2 mm in 1
# ms). So a value is compared at the time when it was measured, which is that of its frame, or of
# the SYNC before it where its PDO is synchronous.

_SECOND = 1_000_000_000
_IDENTIFIER = 0x7FF
_ROUNDING = 1000
"""Of time stamps, which count from 1970 in double precision [ns]."""
_LONGEST_WAIT = 0.1
"""Of a value for the twin to come to its time [s]."""
_LONGEST_SILENCE = 10.0
"""After a longer pause on the bus the twin begins anew [s]."""


class Sample(NamedTuple):
    """One value of the machine beside the twin's.

    Attributes:
        time: of the frame that brought it, from the first frame [s].
        axis: the axis.
        quantity: of the plant.
        machine: what the machine says, in that unit.
        twin: what the twin says.
    """

    time: float
    axis: str
    quantity: str
    machine: float
    twin: float


class _Measured(NamedTuple):
    """A value of the machine that waits until the twin has come to its time."""

    reading: Reading
    value: float
    sampled: SampleTime


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
        now: the time of the last frame, from the first one [s].
        axes: the twins of the axes by name; those that have sensors for it.
        others: the names of the other axes.
        states: what is known of the NMT states of the machine's nodes.
        readings: what the devices can say.
        units: of the quantities that are compared, by their names.
    """

    def __init__(self, config: BenchConfig, *, horizon: float = 0.5) -> None:
        config = _sound(config)
        self.windows: deque[Window] = deque()
        self.samples: deque[Sample] = deque(maxlen=1_000_000)
        self.frames = 0
        self.now = 0.0
        self._tick = config.tick_ns
        self._decoder = OverheardDrivers(config)
        self.readings = self._decoder.readings
        self._bench = build_bench(config)
        self._bench.start(-config.tick_ns)
        self._bench.tick((), -config.tick_ns)  # all boot, before there is anything to hear
        self.states = NodeStates(self._bench.nodes)
        self._clock = SampleClock(map(self.identifier, self.readings), self.states.is_synchronous)
        tick = config.tick_ns / _SECOND
        twins = [
            AxisTwin(axis, self._of_axis(axis.name), tick=tick, horizon=horizon)
            for axis in self._bench.axes
        ]
        self._bench.axes = tuple(twin.axis for twin in twins)
        self.axes = {twin.axis.name: twin for twin in twins if twin.is_comparable}
        self.others = [twin.axis.name for twin in twins if not twin.is_comparable]
        self.units = {
            quantity.name: quantity.unit
            for axis in self._bench.axes
            for quantity in axis.quantities
            if quantity.residual is not None
        }
        self._waiting: list[Frame] = []
        self._measured: deque[_Measured] = deque()
        self._twin_now = 0
        self._note()
        self._first: float | None = None

    def take(self, message: can.Message) -> None:
        """Take a frame that was on the bus; frames come in the order of their time stamps."""
        self.frames += 1
        if message.is_error_frame or message.is_fd:
            return
        if self._first is None:
            self._first = message.timestamp
        time = self.now = message.timestamp - self._first
        self._advance(time)
        sampled = self._clock.take(message, time)
        for reading in self._decoder.take(message, time):
            self._measured.append(_Measured(reading, reading.read(), sampled))
        if not message.is_extended_id:
            self._waiting += self.states.hear(message, time)
            self._waiting.append(
                Frame(
                    message.arbitration_id,
                    bytes(message.data),
                    is_remote=message.is_remote_frame,
                )
            )

    def finish(self) -> None:
        """Compare what still waits for the twin, at the end of all frames."""
        self._advance(self.now + _LONGEST_WAIT)

    def identifier(self, reading: Reading) -> int:
        """Return the CAN identifier of the PDO that brings a reading."""
        node = next(node for node in self._bench.nodes if node.node_id == reading.node_id)
        index = reading.source.pdo.mapping.communication_index
        return node.object_dictionary.number(index, 1) & _IDENTIFIER

    def _of_axis(self, axis: str) -> list[Reading]:
        return [reading for reading in self.readings if reading.axis == axis]

    def _advance(self, time: float) -> None:
        """Run the twin up to a time [s], and compare what was measured until then."""
        if time - self._twin_now / _SECOND > _LONGEST_SILENCE:
            self._twin_now = round(time * _SECOND)
            self._measured.clear()
            for twin in self.axes.values():
                twin.forget()
            self._note()
        # A set-point of this very time still belongs to the tick that ends now.
        while self._twin_now + self._tick < time * _SECOND - _ROUNDING:
            frames, self._waiting = self._waiting, []
            self._bench.tick(frames, self._twin_now)
            self._twin_now += self._tick
            self._note()
            self._compare(self._twin_now / _SECOND)

    def _note(self) -> None:
        for twin in self.axes.values():
            twin.note(self._twin_now / _SECOND)

    def _compare(self, now: float) -> None:
        """Hold what was measured a tick ago or before against the twin."""
        while self._measured and self._measured[0].sampled.latest <= now + _ROUNDING / _SECOND:
            reading, value, sampled = self._measured.popleft()
            twin = self.axes.get(reading.axis)
            if twin is None:
                continue
            expected = twin.take(reading, value, sampled)
            if expected is None:
                continue
            sample = Sample(sampled.likely, reading.axis, reading.quantity, value, expected)
            self.samples.append(sample)
            if reading.quantity == "position" and (window := twin.window_at(sampled.frame)):
                self.windows.append(window)


def _sound(config: BenchConfig) -> BenchConfig:
    """Return a bench without faults, stored parameters, Modbus and noise; it must have an axis."""
    axes = (config.first_axis, *config.axes[1:])
    nodes = tuple(_sound_node(node) for node in config.nodes)
    return replace(config, axes=axes, nodes=nodes, parts=())


def _sound_node(node: NodeConfig) -> NodeConfig:
    node = replace(node, storage=None)
    chain = getattr(node, "chain", None)
    if chain is None:
        return node
    changes: Any = {"chain": replace(chain, noise_rms=0.0, noise_density=0.0)}
    return replace(node, **changes)


# Up to which residual a twin follows its machine.

_PUNCTUAL = 2e-3
"""Lateness of frames up to which the limits hold; more widens them, in proportion [s]."""
_NOISE = 3.0
"""How many standard deviations of a sensor's noise come to that."""
_FIRST_ORDER = 0.5 * math.pi
"""Bandwidth of white noise behind a low-pass of first order, by its frequency of -3 dB."""


def fit_limits(config: BenchConfig) -> dict[str, dict[str, float]]:
    """Return the limits of each axis by quantity, for the sensors that a configuration gives it."""
    limits = {
        axis.name: {
            quantity.name: quantity.residual
            for quantity in axis.kind.quantities
            if quantity.residual is not None
        }
        for axis in config.axes
    }
    bases = {axis: dict(of_axis) for axis, of_axis in limits.items()}
    for node in config.nodes:
        quantity, axis = node.kind.measured(node), str(node.axis)
        chain = getattr(node, "chain", None)
        if quantity is None or chain is None or quantity not in bases.get(axis, {}):
            continue
        fitted = math.hypot(bases[axis][quantity], _NOISE * noise_of(chain))
        limits[axis][quantity] = max(limits[axis][quantity], fitted)
    return limits


def noise_of(chain: ChainParameters) -> float:
    """Return the standard deviation of a measuring chain's noise, in the quantity's unit."""
    return math.hypot(
        chain.noise_rms, chain.noise_density * math.sqrt(_FIRST_ORDER * chain.bandwidth)
    )


def widening(lateness: float) -> float:
    """Return by how much the limits grow if frames came late: the commands did so, too.

    Args:
        lateness: of a window's frames [s].
    """
    return max(1.0, lateness / _PUNCTUAL)
