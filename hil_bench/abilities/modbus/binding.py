"""Joins a bench with its Modbus units: what stands behind each register.

The loop's part of Modbus is `ModbusBinding.exchange`, at the end of each tick: one row of values is
published, then at most one write request is obeyed. A scenario reads and writes `units` instead,
with the checks that a request meets.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Final, NamedTuple

from hil_bench.abilities.modbus.map_files import ModbusConfig, ModbusUnitConfig
from hil_bench.abilities.modbus.protocol.mailbox import BoundRegister, Exchange, Mailbox
from hil_bench.abilities.modbus.protocol.register_map import Register, RegisterAccess, ServerConfig
from hil_bench.abilities.modbus.protocol.unit_image import UnitImage
from hil_bench.abilities.modbus.quantities import quantities_of
from hil_bench.bench.bench import Bench
from hil_bench.bench.configuration import BenchConfig
from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import BooleanType, DataType, IntegerType, RealType
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.config.objects import parse_object
from hil_bench.devices.axis import RegisterValue
from hil_bench.errors import ConfigError, SdoAbort
from hil_bench.outside.helper_process import Snapshot
from hil_bench.units import UNITS_OF

_SAMPLE = "sample"
_WATCHDOG = "watchdog"
_SAMPLES = 1 << 32
_OBJECT_PREFIX = "0x"
_CONTROL = (0x604F, 0)


class ModbusPlan(NamedTuple):
    """The plan of a Modbus server for a bench; it can be handed to another process.

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


class BoundUnit:
    """One unit, for who reads and writes its registers in the thread of the bench.

    Args:
        name: in the configuration.
        image: how its clients see it.
        entries: its registers.
        exchange: of all units.

    Attributes:
        name: as passed in.
        entries: as passed in.
    """

    def __init__(
        self, name: str, image: UnitImage, entries: Sequence[BoundRegister], exchange: Exchange
    ) -> None:
        self.name, self.entries = name, entries
        self._image, self._exchange = image, exchange

    def may_write(self, register: Register) -> bool:
        """Return True if clients may write a register."""
        return self._image.may_write(register)

    def write(self, register: Register, value: float, now: int) -> None:
        """Write a register at once, as a request of a client does.

        Args:
            register: one of the unit's.
            value: in SI; what the register cannot hold stands at its nearest end.
            now: time of the tick [ns].

        `ModbusException` where the unit refuses it, `SdoAbort` where its device does.
        """
        words = register.encode(value)
        assignments = self._image.parse_write(register.table, register.address, words)
        self._exchange.write(assignments, now)


class ModbusBinding:
    """The loop's end of Modbus.

    Args:
        config: a bench with a Modbus server.
        bench: made from that configuration.

    Attributes:
        plan: what the server needs.
        units: in the order of the configuration.

    Raises:
        ConfigError: the configuration has no Modbus server, or a register map asks for what its
            device has not.
    """

    def __init__(self, config: BenchConfig, bench: Bench) -> None:
        modbus = config.of(ModbusConfig)
        if modbus is None:
            raise ConfigError("modbus: the file has no table [modbus]; add one")
        self._sample = 0
        devices = zip(config.nodes, bench.nodes, bench.fittings, strict=True)
        by_name = {config.name: (config.kind, node, fitting) for config, node, fitting in devices}
        entries: list[BoundRegister] = []
        units: dict[int, UnitImage] = {}
        parts: list[slice] = []
        for unit in modbus.units:
            registers, first = unit.register_map, len(entries)
            kind, node, fitting = by_name[unit.node]
            known = dict(quantities_of(kind, node, fitting))
            watchdog = known.get(_WATCHDOG)
            if watchdog is not None and watchdog.write is not None:
                watchdog.write(unit.watchdog, 0)
            known[_SAMPLE] = RegisterValue("-", self._number)
            entries += _entries(unit, bind_registers(unit, known, node))
            parts.append(slice(first, len(entries)))
            units[unit.unit_id] = UnitImage(
                registers, first, commands=unit.commands, holes=unit.holes
            )
        self.plan = ModbusPlan(modbus.server, units, Snapshot(len(entries)), Mailbox())
        self._exchange = Exchange(entries, self.plan.rows, self.plan.mailbox)
        self.units = tuple(
            BoundUnit(unit.name, units[unit.unit_id], entries[part], self._exchange)
            for unit, part in zip(modbus.units, parts, strict=True)
        )

    def join(self, bench: Bench) -> None:
        """Take no place in the tick: who serves its clients calls `exchange` after each."""

    def exchange(self, now: int) -> None:
        """Publish the values of this tick, and obey a write that waits.

        Args:
            now: time of the tick [ns].
        """
        self._exchange.exchange(now)
        self._sample += 1

    @property
    def orders(self) -> int:
        """Number of requests of clients that asked for a write; those of scenarios do not count."""
        return self._exchange.orders

    def _number(self) -> float:
        """Return the number of the row that this tick publishes, from 1."""
        return float((self._sample + 1) % _SAMPLES)


def bind_registers(
    unit: ModbusUnitConfig, known: Mapping[str, RegisterValue], node: Node
) -> list[RegisterValue]:
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


def _entries(
    unit: ModbusUnitConfig, quantities: Sequence[RegisterValue]
) -> Iterator[BoundRegister]:
    """Yield what stands behind each register of a unit."""
    for register, quantity in zip(unit.register_map.registers, quantities, strict=True):
        source = register.source
        place = parse_object(source) if source.startswith(_OBJECT_PREFIX) else None
        yield BoundRegister(
            register,
            quantity.read,
            None if register.access is RegisterAccess.READ else quantity.write,
            is_setting=place is not None,
            is_first=place == _CONTROL,
        )


def _bind(register: Register, known: Mapping[str, RegisterValue], node: Node) -> RegisterValue:
    """Return the value that a register shows.

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
    if register.unit not in UNITS_OF[quantity.unit]:
        right = ", ".join(f'"{unit.symbol}"' for unit in UNITS_OF[quantity.unit])
        raise ConfigError(f'.unit: "{register.unit.symbol}" does not fit; give one of {right}')
    if register.access is not RegisterAccess.READ and quantity.write is None:
        raise ConfigError(f'.access: "{source}" cannot be written; give "r"')
    return quantity


def _list(names: Mapping[str, RegisterValue]) -> str:
    return ", ".join(f'"{name}"' for name in names)


_WIDEST: Final = 32  # bits of an integer that a float surely holds, and two registers too


def object_quantity(
    object_dictionary: ObjectDictionary, index: int, subindex: int
) -> RegisterValue:
    """Return an object as a quantity.

    Raises:
        ConfigError: there is none, or it is no number of at most 32 bits.
    """
    variable = object_dictionary.find(index, subindex)
    name = f"object 0x{index:04X}.{subindex:02X}"
    if variable is None:
        raise ConfigError(f"{name} is not in {object_dictionary.source}; give one that is")
    data_type = variable.data_type
    if not isinstance(data_type, BooleanType | IntegerType | RealType) or data_type.bits > _WIDEST:
        raise ConfigError(f"{name} is a {data_type}; a number of at most {_WIDEST} bits is right")
    write = partial(_write_object, variable) if variable.access.writable else None
    return RegisterValue("-", lambda: math.nan if variable.value is None else variable.value, write)


def _write_object(variable: Variable, value: float, _now: int) -> None:
    """Write an object as the bus does.

    Raises:
        SdoAbort: its data type does not hold the value.
    """
    data_type: DataType = variable.data_type
    number: float = value if isinstance(data_type, RealType) else round(value)
    if data_type.low is not None and not data_type.low <= number <= (data_type.high or 0):
        raise SdoAbort(*abort_codes.VALUE)
    variable.write(number)
