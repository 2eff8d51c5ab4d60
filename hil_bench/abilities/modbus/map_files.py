"""Files of register maps, and the records of a bench with them."""

from dataclasses import dataclass, fields, replace
from pathlib import Path

from hil_bench.abilities.modbus.protocol import register_map as maps
from hil_bench.config.document import Sort, Tables
from hil_bench.config.settings import Key, Problems, Settings
from hil_bench.config.values import choice, describe, integer, number, text
from hil_bench.devices.kinds.registry import PRESSURE, kind_name
from hil_bench.errors import ConfigError
from hil_bench.units import ONE, UNITS_OF

# Register map files: TOML, one table a register, to a checked `RegisterMap`.
#
# `docs/modbus.md` tells the meaning of each key.

_KNOWN_UNITS = {unit.symbol: unit for units in UNITS_OF.values() for unit in units}
HIGHEST_ADDRESS = 0xFFFF
_LONGEST_TEXT = 64


def _identity(value: object) -> str:
    """Return text that an object of function 43/14 can carry.

    Raises:
        ConfigError: it is none.
    """
    if not isinstance(value, str) or not value.isascii() or len(value) > _LONGEST_TEXT:
        raise ConfigError(
            f"{describe(value)} cannot be sent; give at most {_LONGEST_TEXT} ASCII characters"
        )
    return value


def _scale(value: object) -> float:
    """Return the value of one count.

    Raises:
        ConfigError: it is not positive.
    """
    scale: float = number()(value)
    if scale <= 0:
        raise ConfigError(f"{describe(value)} is not positive; give the value of one count")
    return scale


_EXAMPLES = {"vendor_name": '"maker"', "product_code": '"PT-1"', "revision": '"1.0"'}

_DEVICE_KEYS = (
    Key("profile", kind_name, example=f'"{PRESSURE.name}"'),
    Key("word_order", choice(maps.WordOrder), maps.WordOrder.BIG),
    *(
        Key(item.name, _identity, "", example=_EXAMPLES.get(item.name, ""))
        for item in fields(maps.DeviceIdentification)
    ),
)

_REGISTER_KEYS = (
    Key("address", integer(0, HIGHEST_ADDRESS), example="0"),
    Key("source", text, example='"pressure"'),
    Key("access", choice(maps.RegisterAccess), maps.RegisterAccess.READ),
    Key("description", text, ""),
)

_NUMBER_KEYS = (
    *_REGISTER_KEYS,
    Key("type", choice(maps.DATA_TYPES), example='"float32"'),
    Key("unit", choice(_KNOWN_UNITS), ONE.symbol),
    Key("scale", _scale, 1.0),
    Key("word_order", choice(maps.WordOrder)),
    Key("low", number()),
    Key("high", number()),
)


def load_register_map(path: Path, word_order: maps.WordOrder | None = None) -> maps.RegisterMap:
    """Return the register map of a file.

    Whatever is wrong in it comes as one `ConfigError`, a line a problem.

    Args:
        path: the file.
        word_order: takes the place of the file's where a register has none of its own.
    """
    file = Tables.of_file(path, Sort.REGISTER_MAP, ("device", *maps.Table))
    problems = file.problems
    device = file.table("device", _DEVICE_KEYS)
    tables = {table: _read_registers(file, table) for table in maps.Table}
    problems.raise_any()

    order = word_order or device["word_order"].value
    registers = [
        _build_register(name, table, settings, order)
        for table, sections in tables.items()
        for name, settings in sections.items()
    ]
    registers.sort(key=_order)
    _check_addresses(registers, problems)
    problems.raise_any()
    names = [item.name for item in fields(maps.DeviceIdentification)]
    return maps.RegisterMap(
        source=str(path),
        profile=device["profile"].value,
        identification=maps.DeviceIdentification(**{name: device[name].value for name in names}),
        registers=tuple(registers),
    )


def copy_inputs(register_map: maps.RegisterMap, start: int) -> maps.RegisterMap:
    """Return the map with its input registers among the holding registers too, read-only.

    Many masters know function 3 alone.

    Args:
        register_map: the map.
        start: address of the holding register that shows input register 0.

    Raises:
        ConfigError: they do not fit there.
    """
    holding = register_map.table(maps.Table.HOLDING_REGISTERS)
    copies = [
        replace(
            register,
            name=f"input_{register.name}",
            table=maps.Table.HOLDING_REGISTERS,
            address=start + register.address,
            access=maps.RegisterAccess.READ,
        )
        for register in register_map.table(maps.Table.INPUT_REGISTERS)
    ]
    free = max((register.address + register.count for register in holding), default=0)
    end = max((copy.address + copy.count for copy in copies), default=0)
    if end > HIGHEST_ADDRESS + 1:
        right = f"give at most {start - (end - HIGHEST_ADDRESS - 1)}"
        raise ConfigError(f"{start} leaves no room for all input registers; {right}")
    taken = {register.address + part for register in holding for part in range(register.count)}
    for copy in copies:
        if not taken.isdisjoint(range(copy.address, copy.address + copy.count)):
            raise ConfigError(f"{start} puts {copy.name} on a holding register; {free} is free")
    return replace(
        register_map, registers=tuple(sorted([*register_map.registers, *copies], key=_order))
    )


def _order(register: maps.Register) -> tuple[int, int]:
    return list(maps.Table).index(register.table), register.address


def _read_registers(file: Tables, table: maps.Table) -> dict[str, Settings]:
    registers = file.named(table, _REGISTER_KEYS if table.holds_bits else _NUMBER_KEYS)
    for name, settings in registers.items():
        _check_register(f"{table}.{name}", table, settings, file.problems)
    return registers


def _check_register(place: str, table: maps.Table, settings: Settings, problems: Problems) -> None:
    access = settings.get("access")
    if access and access.value is not maps.RegisterAccess.READ and not table.is_writable:
        wrong = f'"{access.value}" cannot be, for Modbus only reads {table}'
        problems.add(problems.place(place, "access"), f'{wrong}; give "r"')
    low, high = settings.get("low"), settings.get("high")
    if low and high and None not in {low.value, high.value} and low.value > high.value:
        problems.add(problems.place(place, "low"), f"{low.value:g} is above high; give less")


def _build_register(
    name: str, table: maps.Table, settings: Settings, order: maps.WordOrder
) -> maps.Register:
    values = {key: setting.value for key, setting in settings.items()}
    if not table.holds_bits:
        values["data_type"] = maps.DATA_TYPES[values.pop("type")]
        values["unit"] = _KNOWN_UNITS[values["unit"]]
        values["word_order"] = values["word_order"] or order
    return maps.Register(name=name, table=table, **values)


def _check_addresses(registers: list[maps.Register], problems: Problems) -> None:
    """Note values that overlap, or reach beyond the last address."""
    for before, register in zip([None, *registers], registers, strict=False):
        place = problems.place(f"{register.table}.{register.name}", "address")
        if register.address + register.count > HIGHEST_ADDRESS + 1:
            right = f"give at most {HIGHEST_ADDRESS + 1 - register.count}"
            problems.add(place, f"{register.address} leaves no room for the value; {right}")
        if before is None or before.table is not register.table:
            continue
        free = before.address + before.count
        if register.address < free:
            wrong = f"{register.address} is taken by {before.name}"
            problems.add(place, f"{wrong}; {free} is the next address behind it")


# The records of Modbus: the server, and the units that it shows.


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
    register_map: maps.RegisterMap
    commands: bool
    word_order: maps.WordOrder | None
    watchdog: float
    holes: maps.Holes


@dataclass(frozen=True, slots=True)
class ModbusConfig:
    """The Modbus server.

    Attributes:
        server: where it is found.
        units: the devices, each with its unit-ID.
    """

    server: maps.ServerConfig
    units: tuple[ModbusUnitConfig, ...]
