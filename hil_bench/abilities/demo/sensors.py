"""The demo's sensors, on CANopen or on Modbus: the controller does not care which."""

import math
from enum import StrEnum
from typing import NamedTuple

from hil_bench.abilities.common.members import Members
from hil_bench.abilities.modbus.map_files import ModbusConfig, ModbusUnitConfig
from hil_bench.bench.configuration import BenchConfig, NodeConfig
from hil_bench.bench.virtual_bench import VirtualBench
from hil_bench.devices.kinds.encoder_406 import RotaryEncoderConfig
from hil_bench.errors import ConfigError
from hil_drivers import Network, PositionSensor, PressureSensor, RotarySensor, modbus
from hil_drivers.interfaces import PositionSource, PressureSource, Reading
from hil_drivers.modbus.framing import TcpFraming
from hil_drivers.modbus.register_map import RegisterMap


class SensorBus(StrEnum):
    """The bus on which the controller reads the sensors."""

    CANOPEN = "canopen"
    MODBUS = "modbus"


class Sensors(NamedTuple):
    """The sensors of an axis.

    Attributes:
        position: of its piston; of its shaft, in rad.
        pressures: at port A and at port B.
    """

    position: PositionSource
    pressures: tuple[PressureSource, PressureSource]


class Shaft:
    """A rotary sensor as the position source of a control loop, which then counts in rad.

    Args:
        sensor: on any bus.
    """

    def __init__(self, sensor: RotarySensor | modbus.RotarySensor) -> None:
        self._sensor = sensor
        self._begin, self._ahead = 0.0, math.nan
        self.max_age = sensor.max_age

    def begin_at(self, angle: float) -> None:
        """Count from the turn of an angle [rad]; below 0 an encoder shows the end of its range."""
        self._begin, self._ahead = angle, math.nan

    @property
    def position(self) -> float:
        """Angle [rad], over all turns."""
        angle = self._sensor.angle
        if math.isnan(self._ahead):
            self._ahead = math.tau * round((angle - self._begin) / math.tau)
        return angle - self._ahead

    @property
    def speed(self) -> float:
        """Speed [rad/s]."""
        return self._sensor.speed

    @property
    def is_valid(self) -> bool:
        """True if the device reports its value as valid."""
        return self._sensor.is_valid

    @property
    def reading(self) -> Reading:
        """The angle with unit, time and validity."""
        return self._sensor.reading

    @property
    def received_at(self) -> float:
        """When the oldest of its values came, on the controller's clock [s]."""
        return self._sensor.received_at

    @property
    def age(self) -> float:
        """Time since then [s]."""
        return self._sensor.age

    def setup(self) -> None:
        """Check that the device is what it should be, and have it give its values."""
        self._sensor.setup()

    def poll(self) -> bool:
        """Ask for the present values and return True; False where they come by themselves."""
        return self._sensor.poll()


def canopen_sensors(network: Network, members: Members) -> Sensors:
    """Return the drivers of an axis' sensors on CANopen."""
    encoder = members.position
    at_a, at_b = (PressureSensor(network, node.node_id, node.eds) for node in members[2:])
    position: PositionSource
    if isinstance(encoder, RotaryEncoderConfig):
        position = Shaft(RotarySensor(network, encoder.node_id, encoder.eds))
    else:
        position = PositionSensor(network, encoder.node_id, encoder.eds)
    return Sensors(position, (at_a, at_b))


def modbus_sensors(bench: VirtualBench, config: BenchConfig, members: Members) -> Sensors:
    """Return the drivers of an axis' sensors on Modbus TCP, inside this process."""
    client = modbus.ModbusClient(bench.modbus_link(TcpFraming()), clock=bench.now)
    encoder, *transducers = (the_unit(config, node) for node in members[1:])
    at_a, at_b = (
        modbus.PressureSensor(client, unit.unit_id, registers_of(unit)) for unit in transducers
    )
    position: PositionSource
    if isinstance(members.position, RotaryEncoderConfig):
        position = Shaft(modbus.RotarySensor(client, encoder.unit_id, registers_of(encoder)))
    else:
        position = modbus.PositionSensor(client, encoder.unit_id, registers_of(encoder))
    return Sensors(position, (at_a, at_b))


def registers_of(unit: ModbusUnitConfig) -> RegisterMap:
    """Return the register map of a unit as the drivers read it."""
    return RegisterMap(unit.register_map.source, word_order=unit.word_order)


def the_unit(config: BenchConfig, node: NodeConfig) -> ModbusUnitConfig:
    """Return the Modbus unit that shows a node.

    Raises:
        ConfigError: there is none.
    """
    modbus = config.of(ModbusConfig)
    for unit in modbus.units if modbus else ():
        if unit.node == node.name:
            return unit
    raise ConfigError(f"no [modbus.units.NAME] shows nodes.{node.name}; the demo needs one")
