"""The tables ``[modbus]`` and ``[modbus.units.NAME]``: which devices are on Modbus too, and how."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from hil_bench.abilities.modbus.binding import ModbusBinding
from hil_bench.abilities.modbus.map_files import (
    HIGHEST_ADDRESS,
    ModbusConfig,
    ModbusUnitConfig,
    copy_inputs,
    load_register_map,
)
from hil_bench.abilities.modbus.protocol.register_map import (
    Holes,
    Parity,
    SerialConfig,
    ServerConfig,
    TlsConfig,
    WordOrder,
)
from hil_bench.bench.bench import Bench
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.configuration.records import Part
from hil_bench.bench.session import Session
from hil_bench.canopen_device.nmt import UNCONFIGURED
from hil_bench.config.document import Document, Tables, read_section
from hil_bench.config.settings import Key, Origin, Problems, Settings, convert, read_table
from hil_bench.config.values import boolean, choice, describe, find_nearest, integer, number, text
from hil_bench.devices.kinds.registry import KINDS, kind_of
from hil_bench.errors import ConfigError
from hil_bench.units import MILLISECOND, Unit

if TYPE_CHECKING:
    from hil_bench.abilities.modbus.serving import OpenModbus


# Modbus as a part of a bench: from its table to the server of a run.


@dataclass(frozen=True, slots=True)
class ModbusPart(Part, ModbusConfig):
    """The part that the table ``[modbus]`` describes; `ModbusConfig` is its data.

    Attributes:
        real_time_only: why clients can be served in real time only.
        is_fitted: True: registers want what the devices have.
    """

    is_fitted: ClassVar[bool] = True

    real_time_only: ClassVar[str] = (
        "Modbus clients ask in real time, and bench time would stand while they do; "
        "leave --modbus and [modbus] out"
    )

    def extension(self, config: BenchConfig, bench: Bench) -> ModbusBinding:
        """Return the binding of the registers to a bench; `ConfigError` where one has no source."""
        return ModbusBinding(config, bench)

    @contextmanager
    def attached(self, session: Session, config: BenchConfig) -> Iterator[None]:  # noqa: ARG002 - of every part
        """Exchange values and writes in each tick of a session.

        Yields:
            When it is so.
        """
        session.watch(ticks=session.bench.part(ModbusBinding).exchange)
        yield

    def served(
        self,
        session: Session,
        config: BenchConfig,  # noqa: ARG002 - of every such part
    ) -> "AbstractContextManager[OpenModbus]":
        """Serve clients in real time, by a process of its own."""
        from hil_bench.abilities.modbus.serving import open_modbus  # noqa: PLC0415 - for runs alone

        return open_modbus(self, session)


HIGHEST_UNIT_ID = 247
"""Of a device (MODBUS over Serial Line V1.02, 2.2); higher ones are reserved."""

_BIT_RATE = Unit("bit/s", "")

MODBUS_KEYS = (
    Key("tcp", boolean, True),
    Key("host", text, "127.0.0.1"),
    Key("port", integer(0, 65535), 5020),
    Key("connections", integer(1, 1000), 64),
    Key("default_unit", text),
    Key("serial_port", text),
    Key("baud_rate", integer(300, 4_000_000), 19200, _BIT_RATE),
    Key("parity", choice(Parity), Parity.EVEN),
    Key("stop_bits", integer(1, 2), 1),
    Key("tls_certificate", text),
    Key("tls_key", text),
    Key("tls_client_ca", text),
    Key("tls_writer_role", text, "operator"),
)

_TLS_FILES = ("tls_certificate", "tls_key", "tls_client_ca")

UNIT_KEYS = (
    Key("node", text),
    Key("unit_id", integer(1, HIGHEST_UNIT_ID)),
    Key("registers", text),
    Key("word_order", choice(WordOrder)),
    Key("commands", boolean, False),
    Key("watchdog_ms", number(MILLISECOND, low=0, high=65535), 1000, MILLISECOND, "watchdog"),
    Key("holes", choice(Holes), Holes.REFUSE),
    Key("inputs_also_at", integer(0, HIGHEST_ADDRESS)),
)
_RECORD_KEYS = tuple(key for key in UNIT_KEYS if key.name not in {"registers", "inputs_also_at"})
_OF_VALVES = ("commands", "watchdog_ms")


class ModbusSection:
    """The ``[modbus]`` table; without units every sensor becomes one.

    Args:
        document: the file.
        base: the folder that files are named from.
        problems: where problems are noted.
        nodes: the tables of the nodes, by name.

    Attributes:
        server: the table itself.
        units: the tables of the units, by name.
    """

    of_nodes: ClassVar[bool] = True

    def __init__(
        self,
        document: Document,
        _buses: tuple[str, ...],
        base: Path,
        problems: Problems,
        nodes: Mapping[str, Settings],
    ) -> None:
        self._nodes, self._base, self._problems = nodes, base, problems
        given = read_section(document, "modbus", problems)
        units: object = {name: {} for name, node in nodes.items() if _is_sensor(node)}
        if "units" in given:
            units = given.pop("units").value
        self.server: Settings = read_table("modbus", given, MODBUS_KEYS, problems)
        file = Tables({"modbus.units": units}, problems)
        self.units: dict[str, Settings] = file.named("modbus.units", UNIT_KEYS)

    def resolve(self) -> None:
        """Fill in what a unit takes from its node, and note what does not fit together."""
        server, problems = self.server, self._problems
        if not server["tcp"].value and server["serial_port"].value is None:
            right = "give tcp = true, or a serial_port"
            problems.add(problems.place("modbus", "tcp"), f"false leaves no way in; {right}")
        _resolve_tls(server, self._base, problems)
        if not self.units:
            right = "give it a node, as in [modbus.units.pressure_a]"
            problems.add(problems.place("modbus.units"), f"there is no unit; {right}")
        for name, unit in self.units.items():
            _resolve_unit(name, unit, self._nodes, self._base, problems)
        _check_unit_ids(self.units, problems)
        _resolve_default_unit(server, self.units, problems)

    def build(self) -> dict[str, Any]:
        """Return the record; problems of register maps are noted."""
        values = {key: setting.value for key, setting in self.server.items()}
        tcp, serial_port = values.pop("tcp"), values.pop("serial_port")
        serial = {key: values.pop(key) for key in ("baud_rate", "parity", "stop_bits")}
        units = [
            _build_unit(
                name, unit, self._nodes[unit["node"].value]["profile"].value, self._problems
            )
            for name, unit in self.units.items()
        ]
        certificate, tls_key, client_ca = (values.pop(key) for key in _TLS_FILES)
        writer_role = values.pop("tls_writer_role")
        default_unit = values.pop("default_unit")
        default_id = self.units[default_unit]["unit_id"].value if default_unit else None
        tls = None
        if certificate and tls_key and client_ca:
            tls = TlsConfig(Path(certificate), Path(tls_key), Path(client_ca), writer_role)
        line = None if serial_port is None else SerialConfig(port=serial_port, **serial)
        server = ServerConfig(
            is_on_tcp=tcp, serial=line, tls=tls, default_unit=default_id, **values
        )
        known = tuple(unit for unit in units if unit is not None)
        return {"modbus": ModbusPart(server=server, units=known)}

    def tables(self) -> Iterable[Settings]:
        """Return the table of the server, and those of its units."""
        return (self.server, *self.units.values())


def _resolve_tls(server: Settings, base: Path, problems: Problems) -> None:
    """Make the paths of the certificates absolute, and note one that is missing."""
    given = [key for key in _TLS_FILES if server[key].value is not None]
    for key in given:
        server[key] = server[key]._replace(value=str(base / server[key].value))
    if given and len(given) < len(_TLS_FILES):
        missing = [key for key in _TLS_FILES if key not in given]
        right = f"give {' and '.join(missing)}, too"
        problems.add(problems.place("modbus", given[0]), f"TLS needs three files; {right}")
    if server["tls_key"].value is not None and not server["tcp"].value:
        problems.add(
            problems.place("modbus", "tls_key"), "TLS is for TCP; give tcp = true, or leave it out"
        )


def _is_sensor(node: Settings) -> bool:
    if "profile" not in node:
        return False
    kind = kind_of(node["profile"].value)
    return kind.registers is not None and not kind.is_drive


def _resolve_unit(
    name: str, unit: Settings, nodes: Mapping[str, Settings], base: Path, problems: Problems
) -> None:
    table = f"modbus.units.{name}"
    if unit["node"].value is None:
        unit["node"] = unit["node"]._replace(value=name)
    wanted = unit["node"].value
    node = nodes.get(wanted)
    if node is None:
        given = unit["node"].origin is not Origin.DEFAULT
        place = problems.place(table, "node" if given else "")
        right = f"the nearest is {find_nearest(wanted, nodes)}"
        problems.add(place, f"there is no node {describe(wanted)}; {right}")
        return
    _resolve_unit_id(table, unit, node, problems)
    kind = kind_of(node["profile"].value)
    registers = unit["registers"].value
    if registers is None and kind.registers is None:
        wrong = f"missing, as {wanted} has no device profile"
        problems.add(problems.place(table, "registers"), f"{wrong}; give a register map")
    path = (kind.registers or Path()) if registers is None else base / registers
    unit["registers"] = unit["registers"]._replace(value=str(path))
    for key in _OF_VALVES:
        if unit[key].value != unit[key].key.default and not kind.is_drive:
            drives = " and ".join(each.name for each in KINDS.built_in.values() if each.is_drive)
            wrong = f"is for {drives} alone, and {wanted} is {kind.name}"
            problems.add(problems.place(table, key), f"{wrong}; leave it out")


def _resolve_unit_id(table: str, unit: Settings, node: Settings, problems: Problems) -> None:
    if unit["unit_id"].value is not None:
        return
    node_id = node["node_id"].value
    if node_id == UNCONFIGURED:
        right = f"give one from 1 to {HIGHEST_UNIT_ID}"
        problems.add(problems.place(table, "unit_id"), f"missing, as the node has no ID; {right}")
    else:
        unit["unit_id"] = unit["unit_id"]._replace(value=node_id)


def _check_unit_ids(units: Mapping[str, Settings], problems: Problems) -> None:
    owners: dict[int, str] = {}
    used = {unit["unit_id"].value for unit in units.values()}
    free = min(set(range(1, HIGHEST_UNIT_ID + 1)) - used, default=None)
    right = f"a server has room for {HIGHEST_UNIT_ID}" if free is None else f"{free} is free"
    for name, unit in units.items():
        unit_id = unit["unit_id"].value
        owner = owners.setdefault(unit_id, name)
        if owner != name and unit_id is not None:
            place = problems.place(f"modbus.units.{name}", "unit_id")
            problems.add(place, f"{unit_id} is taken by modbus.units.{owner}; {right}")


def _resolve_default_unit(
    server: Settings, units: Mapping[str, Settings], problems: Problems
) -> None:
    """Fill in the only unit where none is named, and note a name that is not a unit's."""
    setting = server["default_unit"]
    if setting.value is None:
        only = next(iter(units)) if len(units) == 1 else None
        server["default_unit"] = setting._replace(value=only)
    elif setting.value not in units and units:
        right = f"the nearest is {find_nearest(setting.value, units)}"
        place = problems.place("modbus", "default_unit")
        problems.add(place, f"there is no unit {describe(setting.value)}; {right}")


def _build_unit(
    name: str, unit: Settings, profile: str, problems: Problems
) -> ModbusUnitConfig | None:
    place = problems.place(f"modbus.units.{name}", "registers")
    try:
        register_map = load_register_map(
            Path(unit["registers"].value), word_order=unit["word_order"].value
        )
        if unit["inputs_also_at"].value is not None:
            place = problems.place(f"modbus.units.{name}", "inputs_also_at")
            register_map = copy_inputs(register_map, unit["inputs_also_at"].value)
    except ConfigError as error:
        problems.add(place, error)
        return None
    if register_map.profile != profile:
        wrong = f"{register_map.source} is for {register_map.profile}"
        problems.add(place, f"{wrong}; give a map for {profile}")
    return ModbusUnitConfig(name=name, register_map=register_map, **convert(unit, _RECORD_KEYS))
