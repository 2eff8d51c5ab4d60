"""The demo's sensors, on CANopen or on Modbus: the controller does not care which."""

from collections.abc import Sequence
from enum import StrEnum
from typing import Any, NamedTuple

from hil_bench.bench.configuration import BenchConfig, ModbusUnitConfig, NodeConfig
from hil_bench.errors import ConfigError
from hil_bench.kinds.kind import DeviceKind
from hil_bench.kinds.registry import ENCODER, PRESSURE
from hil_bench.plants.hydraulic_cylinder.quantities import PORTS
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


def canopen_sensors(network: Network, members: Sequence[NodeConfig]) -> Sensors:
    """Return the drivers of an axis' sensors on CANopen."""
    encoder = the_node(members, ENCODER)
    pressure_a, pressure_b = (
        PressureSensor(network, node.node_id, node.eds) for node in transducers(members)
    )
    return Sensors(PositionSensor(network, encoder.node_id, encoder.eds), (pressure_a, pressure_b))


def modbus_sensors(
    bench: VirtualBench, config: BenchConfig, members: Sequence[NodeConfig]
) -> Sensors:
    """Return the drivers of an axis' sensors on Modbus TCP, inside this process."""
    client = modbus.ModbusClient(bench.modbus_link(TcpFraming()), clock=bench.now)
    encoder = the_unit(config, the_node(members, ENCODER))
    pressure_a, pressure_b = (
        modbus.PressureSensor(client, unit.unit_id, registers_of(unit))
        for unit in (the_unit(config, node) for node in transducers(members))
    )
    position = modbus.PositionSensor(client, encoder.unit_id, registers_of(encoder))
    return Sensors(position, (pressure_a, pressure_b))


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


def the_node(members: Sequence[NodeConfig], kind: DeviceKind[Any]) -> NodeConfig:
    """Return the first node of an axis of this kind.

    Raises:
        ConfigError: there is none.
    """
    for node in members:
        if node.kind is kind:
            return node
    raise ConfigError(
        f"the first axis has no node of profile {kind.name}; the demo's controller needs one"
    )


def transducers(members: Sequence[NodeConfig]) -> tuple[NodeConfig, NodeConfig]:
    """Return the transducers of an axis at port A and at port B."""
    at_a, at_b = (transducer(members, port) for port in PORTS)
    return at_a, at_b


def transducer(members: Sequence[NodeConfig], port: str) -> NodeConfig:
    """Return the transducer at one port.

    Raises:
        ConfigError: there is none.
    """
    for node in members:
        if node.kind.measured(node) == port:
            return node
    raise ConfigError(
        f"the first axis has no {PRESSURE.name} at {port}; the demo's controller needs one"
    )
