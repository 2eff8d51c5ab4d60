"""The example controllers of the package: on the drivers alone.

Each is a generator that lets bench time pass, and yields after each of its cycles.
"""

from collections.abc import Callable, Generator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Final, NamedTuple

from hil_bench.abilities.common.members import find_members
from hil_bench.abilities.controllers.python.controller import Rig
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.configuration.records import FIRST_BUS
from hil_bench.errors import ConfigError
from hil_drivers import (
    ControllerParameters,
    DriverError,
    MotionProfile,
    Network,
    PositionController,
    PositionLoop,
    PositionSensor,
    PressureSensor,
    ProportionalValve,
)

CYCLE = 0.002
"""Period of the controllers [s]."""

_FOR_EVER = 1e9  # [s]
_PAUSE = 0.1  # between a fault of the valve and a new start [s]


_LAW = ControllerParameters()


@dataclass(frozen=True, slots=True)
class ControllerSettings:
    """The settings of a scenario's controller, each by its own name.

    Attributes:
        target_mm: where the piston is to go [m].
        speed_mm_s: greatest speed of the way there [m/s].
        acceleration_mm_s2: greatest acceleration [m/s²].
        position_gain: speed per position error [1/s].
        heartbeat_timeout_ms: after which the valve takes the controller for dead [s]; 0 for never.
        checks_sensor: whether a position that is not valid stops the motion: 1 or 0.
        restarts: how often it starts the valve again after a fault.
        full_speed_mm_s: speed of the piston with the valve wide open [m/s].
        dead_zone_percent: spool travel that opens nothing, as a share of the full opening [-].
    """

    target_mm: float = 0.1
    speed_mm_s: float = 0.15
    acceleration_mm_s2: float = 1.0
    position_gain: float = 20.0
    heartbeat_timeout_ms: float = 0.2
    checks_sensor: float = 1.0
    restarts: float = 0.0
    full_speed_mm_s: float = _LAW.full_speed
    dead_zone_percent: float = _LAW.dead_zone


def settings_of(parameters: Mapping[str, float]) -> ControllerSettings:
    """Return the settings in the parameters [SI]; parameters of no controller are left out.

    Raises:
        ConfigError: no valve has such a full speed or dead zone.
    """
    known = {field.name for field in fields(ControllerSettings)}
    settings = ControllerSettings(**{k: v for k, v in parameters.items() if k in known})
    if settings.full_speed_mm_s <= 0.0:
        raise ConfigError("parameters.full_speed_mm_s: no valve is so slow; give more than 0")
    if not 0.0 <= settings.dead_zone_percent < 1.0:
        raise ConfigError("parameters.dead_zone_percent: is out of range; give 0 to below 100")
    return settings


class Devices(NamedTuple):
    """The drivers of the first axis.

    Attributes:
        valve: of the spool.
        position: of the piston.
        pressures: at A and B.
    """

    valve: ProportionalValve
    position: PositionSensor
    pressures: tuple[PressureSensor, PressureSensor]


def position_control(rig: Rig, settings: ControllerSettings) -> Generator[None]:
    """Bring the piston of the first axis to the target, and hold it there.

    Yields:
        After each cycle.

    Raises:
        DriverError: a device has failed, or is not there.
    """
    with ExitStack() as stack:
        network = stack.enter_context(rig.network())
        devices = _set_up(network, rig.config, settings, stack)
        law = PositionController(
            ControllerParameters(
                position_gain=settings.position_gain,
                full_speed=settings.full_speed_mm_s,
                dead_zone=settings.dead_zone_percent,
            )
        )
        loop = PositionLoop(
            network,
            valve=devices.valve,
            position=devices.position,
            pressures=devices.pressures,
            controller=law,
            period=CYCLE,
        )
        restarts = int(settings.restarts)
        while True:
            try:
                devices.valve.reset_fault()
                yield from _move(loop, devices, settings)
            except DriverError:
                if not restarts:
                    raise
            restarts -= 1
            network.pump(_PAUSE)


def manual(rig: Rig, settings: ControllerSettings) -> Generator[None]:
    """Set the devices of the first axis up, enable its valve, and leave set-points to the steps.

    Yields:
        After each cycle.
    """
    with ExitStack() as stack:
        network = stack.enter_context(rig.network())
        devices = _set_up(network, rig.config, settings, stack, command_timeout=0.0)
        devices.valve.enable()
        due = network.now()
        while True:
            network.sync()
            due += CYCLE
            network.pump_until(due)
            yield


Example = Callable[[Rig, ControllerSettings], Generator[None]]

CONTROLLERS: Final[Mapping[str, Example]] = MappingProxyType(
    {"position_control": position_control, "manual": manual}
)
"""Each example by its name."""


def _move(loop: PositionLoop, devices: Devices, settings: ControllerSettings) -> Generator[None]:
    """Follow the way to the target.

    Yields:
        After each cycle.

    Raises:
        DriverError: a device has failed.
    """
    profile = MotionProfile(
        loop.sample(),
        [settings.target_mm],
        speed=settings.speed_mm_s,
        acceleration=settings.acceleration_mm_s2,
    )
    devices.valve.enable()
    for _ in loop.run(profile, _FOR_EVER):
        if settings.checks_sensor and not devices.position.is_valid:
            devices.valve.hold()
            raise DriverError("the position is not valid; the valve is in HOLD")
        yield


def _set_up(
    network: Network,
    config: BenchConfig,
    settings: ControllerSettings,
    stack: ExitStack,
    command_timeout: float = 0.1,
) -> Devices:
    """Set the devices of the first axis up, and start their nodes.

    Raises:
        ConfigError: one is missing, or on another bus.
    """
    nodes = find_members(config, config.first_axis.name, "the controller")
    if any(node.bus != FIRST_BUS for node in nodes):
        raise ConfigError("controller: the examples need all devices of the axis on the first bus")
    network.start_heartbeat()
    valve = ProportionalValve(network, nodes.valve.node_id, nodes.valve.eds)
    stack.enter_context(valve)
    at_a, at_b = (PressureSensor(network, node.node_id, node.eds) for node in nodes[2:])
    position = PositionSensor(network, nodes.position.node_id, nodes.position.eds)
    devices = Devices(valve, position, (at_a, at_b))
    for sensor in (devices.position, *devices.pressures):
        sensor.setup()
    valve.setup(heartbeat_timeout=settings.heartbeat_timeout_ms, command_timeout=command_timeout)
    for node in network.nodes:
        network.start_node(node)
    return devices
