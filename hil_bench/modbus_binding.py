"""Joins a bench with its Modbus units: publishes their values each tick, and takes writes.

The loop's part of Modbus is `ModbusBinding.exchange`, at the end of each tick: one row of values is
published, then at most one write request is obeyed. It never waits, and does the same whether the
server is in another process or in this one.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from hil_bench.bench import Bench
from hil_bench.canopen_device.node import Node
from hil_bench.config import BenchConfig, ModbusUnitConfig, Profile
from hil_bench.config.objects import parse_object
from hil_bench.config.register_maps import UNITS
from hil_bench.devices.quantities import (
    Quantity,
    encoder_quantities,
    object_quantity,
    pressure_quantities,
    valve_quantities,
)
from hil_bench.devices.valve_408 import ValveDevice
from hil_bench.errors import ConfigError, SdoAbort
from hil_bench.modbus.exceptions import ExceptionCode
from hil_bench.modbus.mailbox import Mailbox, Order
from hil_bench.modbus.register_map import Access, Register
from hil_bench.modbus.server_config import ServerConfig
from hil_bench.modbus.unit_image import UnitImage
from hil_bench.recording.channels import Channel
from hil_bench.recording.snapshot import Snapshot

_SAMPLE = "sample"
_SAMPLES = 1 << 32
_OBJECT_PREFIX = "0x"
_VALUE_ABORTS = range(0x06090030, 0x0609003A)


class ModbusPlan(NamedTuple):
    """What a server needs to know of a bench; it can be handed to another process.

    Attributes:
        server: where it is found.
        units: by unit-ID.
        rows: the newest row of values.
        mailbox: where writes go.
    """

    server: ServerConfig
    units: Mapping[int, UnitImage]
    rows: Snapshot
    mailbox: Mailbox


class ModbusBinding:
    """The loop's end of Modbus.

    Args:
        config: a bench with a Modbus server.
        bench: made from that configuration.

    Attributes:
        plan: what the server needs.

    Raises:
        ConfigError: the configuration has no Modbus server, or a register map asks for what its
            device has not.
    """

    def __init__(self, config: BenchConfig, bench: Bench) -> None:
        if config.modbus is None:
            raise ConfigError("modbus: there is no such table; give [modbus]")
        self._sample = 0
        self._obeyed: tuple[int, int] | None = None  # an order, and its answer
        nodes = dict(zip((node.name for node in config.nodes), bench.nodes, strict=True))
        profiles = {node.name: node.profile for node in config.nodes}
        valves = {
            id(axis.valve.node): axis.valve
            for axis in bench.axes
            if isinstance(axis.valve, ValveDevice)
        }
        self._quantities: list[Quantity] = []
        channels: list[Channel] = []
        units: dict[int, UnitImage] = {}
        for unit in config.modbus.units:
            registers, first = unit.register_map, len(self._quantities)
            node = nodes[unit.node]
            known = unit_quantities(profiles[unit.node], node, valves.get(id(node)))
            known[_SAMPLE] = Quantity("-", lambda: float(self._sample % _SAMPLES))
            self._quantities += bind_registers(unit, known, node)
            channels += (
                Channel(f"{unit.name}.{r.table}.{r.name}", "-") for r in registers.registers
            )
            units[unit.unit_id] = UnitImage(registers, first, commands=unit.commands)
        self._readers: list[Callable[[], float]] = [quantity.read for quantity in self._quantities]
        self.plan = ModbusPlan(config.modbus.server, units, Snapshot(channels), Mailbox())

    def exchange(self, _bench: Bench, now: int) -> None:
        """Publish the values of this tick, and obey a write that waits.

        It is answered after the next row, so that who reads then sees what became of it.

        Args:
            now: time of the tick [ns].
        """
        self._sample += 1
        self.plan.rows.write([read() for read in self._readers])
        mailbox = self.plan.mailbox
        if self._obeyed is not None:
            mailbox.answer(*self._obeyed)
        order = mailbox.take()
        self._obeyed = order and (order.number, self._obey(order, now))

    def _obey(self, order: Order, now: int) -> int:
        """Return 0, or the exception code of the first value that its device refuses."""
        for position, value in order.assignments:
            write = self._quantities[position].write
            if write is None:
                return ExceptionCode.ILLEGAL_DATA_ADDRESS
            try:
                write(value, now)
            except SdoAbort as abort:
                is_value = abort.code in _VALUE_ABORTS
                return (
                    ExceptionCode.ILLEGAL_DATA_VALUE
                    if is_value
                    else ExceptionCode.SERVER_DEVICE_FAILURE
                )
        return 0


def unit_quantities(profile: Profile, node: Node, valve: ValveDevice | None) -> dict[str, Quantity]:
    """Return what a device offers, by name.

    Args:
        profile: its device profile.
        node: it.
        valve: the valve behind that node, where it is one.
    """
    od = node.object_dictionary
    if profile is Profile.PRESSURE_404:
        return dict(pressure_quantities(od))
    if profile is Profile.ENCODER_406:
        return dict(encoder_quantities(od))
    return dict(valve_quantities(valve)) if valve else {}  # a generic device has objects only


def bind_registers(
    unit: ModbusUnitConfig, known: Mapping[str, Quantity], node: Node
) -> list[Quantity]:
    """Return the quantity behind each register of a unit, in the map's order.

    Raises:
        ConfigError: registers whose source is not there or does not fit, a line each.
    """
    quantities, problems = [], []
    for register in unit.register_map.registers:
        try:
            quantities.append(_bind(register, known, node))
        except ConfigError as error:
            place = f"{unit.register_map.source}:{register.table}.{register.name}"
            problems.append(f"{place}{error}")
    if problems:
        raise ConfigError("\n".join(problems))
    return quantities


def _bind(register: Register, known: Mapping[str, Quantity], node: Node) -> Quantity:
    """Return what a register shows.

    Raises:
        ConfigError: which key does not fit, and why.
    """
    source = register.source
    if source.startswith(_OBJECT_PREFIX):
        try:
            quantity = object_quantity(node.object_dictionary, *parse_object(source))
        except ConfigError as error:
            raise ConfigError(f".source: {error}") from None
    elif source in known:
        quantity = known[source]
    else:
        raise ConfigError(
            f'.source: "{source}" is unknown; give an object or one of {_list(known)}'
        )
    if register.unit not in UNITS[quantity.unit]:
        right = ", ".join(f'"{unit.symbol}"' for unit in UNITS[quantity.unit])
        raise ConfigError(f'.unit: "{register.unit.symbol}" does not fit; give one of {right}')
    if register.access is not Access.READ and quantity.write is None:
        raise ConfigError(f'.access: "{source}" cannot be written; give "r"')
    return quantity


def _list(names: Mapping[str, Quantity]) -> str:
    return ", ".join(f'"{name}"' for name in names)
