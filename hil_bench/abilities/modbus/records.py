"""The records of Modbus: the server, and the units that it shows."""

from dataclasses import dataclass

from hil_bench.abilities.modbus.protocol.data_types import WordOrder
from hil_bench.abilities.modbus.protocol.register_map import Holes, RegisterMap
from hil_bench.abilities.modbus.protocol.server_config import ServerConfig


@dataclass(frozen=True, slots=True)
class ModbusUnitConfig:
    """One device as Modbus clients see it.

    Attributes:
        name: the unit, as in ``[modbus.units.NAME]``.
        node: the name of the node that it shows.
        unit_id: its address, 1 to 247.
        register_map: what stands where.
        commands: whether clients may command the device.
        word_order: takes the place of the map's own, None where it does not.
        watchdog: of a valve, longest time between two commands at power-on [s]; 0 for any.
        holes: what an address is where the map has nothing.
    """

    name: str
    node: str
    unit_id: int
    register_map: RegisterMap
    commands: bool
    word_order: WordOrder | None
    watchdog: float
    holes: Holes


@dataclass(frozen=True, slots=True)
class ModbusConfig:
    """The Modbus server.

    Attributes:
        server: where it is found.
        units: the devices, each with its unit-ID.
    """

    server: ServerConfig
    units: tuple[ModbusUnitConfig, ...]
