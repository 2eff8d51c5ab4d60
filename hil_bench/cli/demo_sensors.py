"""The demo's sensors, on CANopen or on Modbus: the controller does not care which."""

from enum import StrEnum
from typing import NamedTuple

from hil_bench.bench.configuration import BenchConfig, ModbusUnitConfig, NodeConfig
from hil_bench.bench.members import Members
from hil_bench.errors import ConfigError
from hil_bench.session.virtual_bench import VirtualBench
from hil_drivers import Network, PositionSensor, PressureSensor, modbus
from hil_drivers.interfaces import PositionSource, PressureSource
from hil_drivers.modbus.framing import TcpFraming
from hil_drivers.modbus.register_map import RegisterMap


class SensorBus(StrEnum):
    """Where the controller reads the sensors."""

    CANOPEN = "canopen"
    MODBUS = "modbus"


class Sensors(NamedTuple):
    """The sensors of an axis.

    Attributes:
        position: of its piston.
        pressures: at port A and at port B.
    """

    position: PositionSource
    pressures: tuple[PressureSource, PressureSource]


def canopen_sensors(network: Network, members: Members) -> Sensors:
    """Return the drivers of an axis' sensors on CANopen."""
    encoder = members.position
    at_a, at_b = (PressureSensor(network, node.node_id, node.eds) for node in members[2:])
    return Sensors(PositionSensor(network, encoder.node_id, encoder.eds), (at_a, at_b))


def modbus_sensors(bench: VirtualBench, config: BenchConfig, members: Members) -> Sensors:
    """Return the drivers of an axis' sensors on Modbus TCP, inside this process."""
    client = modbus.ModbusClient(bench.modbus_link(TcpFraming()), clock=bench.now)
    encoder, *transducers = (the_unit(config, node) for node in members[1:])
    at_a, at_b = (
        modbus.PressureSensor(client, unit.unit_id, registers_of(unit)) for unit in transducers
    )
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
    for unit in config.modbus.units if config.modbus else ():
        if unit.node == node.name:
            return unit
    raise ConfigError(f"no [modbus.units.NAME] shows nodes.{node.name}; the demo needs one")
