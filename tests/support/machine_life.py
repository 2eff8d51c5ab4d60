"""The frames of a machine's life on its bus, for a twin to join at any moment of it."""

import functools
import itertools
import math
import random
from collections.abc import Callable, Sequence
from typing import NamedTuple

import can

from hil_bench import BenchConfig, VirtualBench, load_config
from hil_bench.abilities.recording.frames import message_of
from hil_drivers import Network, PositionSensor, PressureSensor, ProportionalValve

PERIOD = 0.01
"""Of the controller [s]."""
FRAME_TIME = 0.25e-3
"""What a frame takes of a bus with 500 kbit/s, about [s]."""
JITTER = 0.2e-3
"""Of its time stamp [s]."""


class Pdos(NamedTuple):
    """How the machine's devices were set to send, before anybody listened."""

    transmission_type: int
    event_timer: float


SYNCHRONOUS = Pdos(1, 0.0)
BY_EVENT = Pdos(254, 0.007)
"""Out of step with the controller."""


class Life(NamedTuple):
    """What was on the bus.

    Attributes:
        frames: in the order of their times.
        begins: when each part of it began, by its name [s].
    """

    frames: tuple[can.Message, ...]
    begins: dict[str, float]

    def part(self, begin: float, duration: float = math.inf) -> list[can.Message]:
        """Return the frames from a time on [s]."""
        return [m for m in self.frames if begin <= m.timestamp < begin + duration]


class _Controller:
    """What moves the machine: a set-point each period."""

    def __init__(self, bench: VirtualBench, network: Network, pdos: Pdos) -> None:
        self.bench, self.network, self.pdos = bench, network, pdos
        self.valve = ProportionalValve(network, node_id=1)
        self.sensors = [
            PositionSensor(network, node_id=4),
            PressureSensor(network, node_id=2),
            PressureSensor(network, node_id=3),
        ]

    def set_up(self) -> None:
        self.bench.run(0.05)
        self.valve.setup(**self.pdos._asdict(), command_timeout=0.1)
        for sensor in self.sensors:
            sensor.setup(**self.pdos._asdict())
        self.network.start_node()
        self.bench.run(0.02)

    def drive(self, duration: float, setpoint: Callable[[float], float | None]) -> None:
        begin = self.bench.now()
        for number in range(round(duration / PERIOD)):
            if self.pdos is SYNCHRONOUS:
                self.network.sync()
            value = setpoint(number * PERIOD)
            if value is not None:
                self.valve.spool_setpoint = value
            self.network.pump_until(begin + (number + 1) * PERIOD)


def steps(*setpoints: float, each: float = 0.2) -> Callable[[float], float]:
    """Return a course of set-points."""
    return lambda time: setpoints[int(time / each) % len(setpoints)]


@functools.cache
def whole_life(pdos: Pdos) -> Life:
    """Return a life of the built-in bench with each state in which one may find a machine."""

    def live(controller: _Controller, begin: Callable[[str], None]) -> None:
        begin("boot")
        controller.set_up()
        controller.valve.enable()
        begin("motion")
        controller.drive(0.8, lambda time: 0.6 * math.sin(10.0 * time))
        begin("steps")
        controller.drive(0.8, steps(0.5, -0.6, 0.8, -0.7))
        begin("silent controller")  # the valve's command time-out makes that a fault
        controller.drive(0.3, lambda _: None)
        begin("fault")  # and it is not reset yet
        controller.drive(0.3, lambda _: 0.4)
        controller.valve.reset_fault()
        controller.valve.enable()
        begin("after the fault")
        controller.drive(0.4, steps(-0.5, 0.45))
        controller.valve.disable()
        begin("disabled")
        controller.drive(0.4, lambda _: 0.0)
        controller.valve.hold()
        begin("hold")
        controller.drive(0.3, lambda _: 0.0)
        controller.valve.enable()
        begin("end")
        controller.drive(0.9, steps(0.5, -0.3, 0.6))

    return _record(load_config(), pdos, live)


def motion(config: BenchConfig, pdos: Pdos) -> Life:
    """Return a life of 1.6 s of motion, which begins before anything is recorded."""

    def live(controller: _Controller, begin: Callable[[str], None]) -> None:
        controller.set_up()
        controller.valve.enable()
        controller.drive(0.2, lambda _: 0.4)
        begin("motion")
        controller.drive(1.6, steps(0.5, -0.6, 0.8, -0.7))

    return _record(config, pdos, live)


def commanded_blindly(
    config: BenchConfig, prepare: Callable[[VirtualBench], None], duration: float = 1.2
) -> list[can.Message]:
    """Return the frames of a machine that is told to be ACTIVE and to move, whatever it answers.

    Args:
        config: of the machine.
        prepare: what happens to it; called before it starts.
        duration: of the commands [s].
    """

    def live(controller: _Controller, begin: Callable[[str], None]) -> None:
        prepare(controller.bench)
        controller.set_up()
        begin("commands")
        controller.drive(duration, lambda time: command(controller, time))

    def command(controller: _Controller, time: float) -> None:
        setpoint = round(16384 * 0.5 * math.cos(10.0 * time))
        word = (7).to_bytes(2, "little") + setpoint.to_bytes(2, "little", signed=True)
        controller.network.send(0x201, word)

    return list(_record(config, BY_EVENT, live).frames)


def _record(
    config: BenchConfig, pdos: Pdos, live: Callable[[_Controller, Callable[[str], None]], None]
) -> Life:
    with VirtualBench(config) as bench, Network(bench.bus, clock=bench.now) as network:
        bench.pump = network.pump
        begins: dict[str, float] = {}
        live(_Controller(bench, network, pdos), lambda name: begins.update({name: bench.now()}))
        frames = [message_of(logged) for logged in bench.frames]
    return Life(tuple(as_on_a_wire(frames)), begins)


def as_on_a_wire(frames: Sequence[can.Message]) -> list[can.Message]:
    """Return the frames one after the other, as a bus carries them, with uncertain time stamps."""
    uncertain = random.Random(1)  # noqa: S311 - no secrets
    sent_at = itertools.accumulate(
        (frame.timestamp for frame in frames), lambda before, now: max(before + FRAME_TIME, now)
    )
    stamped = [
        can.Message(
            timestamp=time + uncertain.uniform(0.0, JITTER),
            arbitration_id=frame.arbitration_id,
            data=frame.data,
            is_extended_id=False,
        )
        for frame, time in zip(frames, sent_at, strict=True)
    ]
    return sorted(stamped, key=lambda frame: frame.timestamp)
