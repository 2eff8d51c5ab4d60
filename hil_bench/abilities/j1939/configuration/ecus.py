"""The tables ``[j1939.NAME]``: devices on SAE J1939, with the signals of those by table."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Final, NamedTuple

from hil_bench.abilities.j1939.configuration.signals import (
    SIGNALS_TABLE,
    GivenSignal,
    build_signals,
    check_groups,
    read_signals,
)
from hil_bench.abilities.j1939.ecus import EcuTable, build_ecus
from hil_bench.abilities.j1939.kinds.auxiliary_valve import AUXILIARY_VALVE, FLOW
from hil_bench.abilities.j1939.kinds.ecu import EcuConfig, EcuKind, EcuMessage
from hil_bench.abilities.j1939.kinds.signal_table import DBC_KEY, SIGNAL_TABLE
from hil_bench.abilities.j1939.protocol.signals import NULL, Name
from hil_bench.bench.configuration.axes import AxesSection
from hil_bench.bench.configuration.nodes import OtherDrive
from hil_bench.bench.configuration.records import FIRST_BUS, BenchConfig, Part, ShownDevice
from hil_bench.config.document import Document, read_named_sections
from hil_bench.config.objects import named_serial_number
from hil_bench.config.settings import Given, Key, Problems, Settings, convert, read_table
from hil_bench.config.values import boolean, choice, describe, integer, text
from hil_bench.devices.kinds.bindings import Surroundings
from hil_bench.units import ONE, si_unit

# The J1939 devices of a bench as a part of it.


@dataclass(frozen=True, slots=True)
class J1939Part(Part):
    """The part that the tables ``[j1939.NAME]`` describe.

    Attributes:
        ecus: the devices, in the order of the file.
    """

    ecus: tuple[EcuConfig, ...]

    def peers(self, config: BenchConfig, surroundings: Surroundings) -> EcuTable:
        """Return the devices, built."""
        return build_ecus(self.ecus, config.buses, surroundings)

    def shown_devices(self, config: BenchConfig) -> Iterator[ShownDevice]:
        """Yield the devices, bus by bus in the order of addresses, with what they send and take."""
        order = list(config.buses)
        for ecu in sorted(self.ecus, key=lambda ecu: (order.index(ecu.bus), ecu.address)):
            messages = [_Group.of(message) for message in ecu.kind.messages(ecu)]
            content = {
                "name": ecu.name,
                "address": ecu.address,
                "kind": ecu.kind.name,
                "axis": ecu.kind.axis_of(ecu),
                "messages": [message._asdict() for message in messages],
                "bus": ecu.bus,
            }
            lines = [str(message) for message in messages]
            yield ShownDevice(f"J1939 {ecu.address}", content, lines)

    def seen_from(self, bus: str) -> "J1939Part":
        """Return the devices of one bus, which is then the first."""
        ecus = (replace(ecu, bus=FIRST_BUS) for ecu in self.ecus if ecu.bus == bus)
        return J1939Part(tuple(ecus))


class _Group(NamedTuple):
    """A parameter group of a device, as `hil-bench devices` shows it."""

    pgn: int
    role: str
    rate_ms: int  # 0 on request only
    signals: tuple[str, ...]

    @classmethod
    def of(cls, message: EcuMessage) -> "_Group":
        role = "sends" if message.is_sent else "takes"
        return cls(message.group, role, message.period // 1_000_000, message.signals)

    def __str__(self) -> str:
        rate = f"every {self.rate_ms} ms" if self.rate_ms else "on request"
        how = rate if self.role == "sends" else ""
        head = f"  {self.role}  PGN {self.pgn} (0x{self.pgn:04X})  {how}"
        return f"{head:48}  {', '.join(self.signals)}"


TABLE: Final = "j1939"

ECU_KINDS: Final[Mapping[str, EcuKind[Any]]] = {
    kind.name: kind for kind in (SIGNAL_TABLE, AUXILIARY_VALVE)
}

_KIND_KEY: Final = Key("kind", choice(ECU_KINDS), SIGNAL_TABLE.name)
_IDENTITY_BITS: Final = 0x1FFFFF

_NAME_KEYS: Final = (
    Key("identity", integer(0, _IDENTITY_BITS)),
    Key("manufacturer", integer(0, 2047), 0),
    Key("ecu_instance", integer(0, 7), 0),
    Key("function_instance", integer(0, 31), 0),
    Key("function", integer(0, 255), 0),
    Key("vehicle_system", integer(0, 127), 0),
    Key("vehicle_system_instance", integer(0, 15), 0),
    Key("industry_group", integer(0, 7), 0),
    Key("arbitrary_address", boolean, default=True),
)
_COMMON_KEYS: Final = (
    _KIND_KEY,
    Key("address", integer(0, NULL - 1), example="128"),
    Key("bus", text, FIRST_BUS),
    Key("component", text),
    *_NAME_KEYS,
)


def _keys_of(kind: EcuKind[Any]) -> tuple[Key, ...]:
    axis = (Key("axis", text),) if kind.has_axis else ()
    return (*_COMMON_KEYS, *axis, *kind.keys)


class EcusSection:
    """The J1939 devices of a bench.

    Args:
        document: the file.
        axes: that they belong to.
        base: the folder that files are named from.
        problems: where problems are noted.

    Attributes:
        devices: the table of each by its name.
        signals: the signals of each.
        is_given: whether the file has such devices, right or wrong.
        before_nodes: True: it is made before the nodes.
    """

    before_nodes: ClassVar[bool] = True

    def __init__(
        self, document: Document, axes: AxesSection, base: Path, problems: Problems
    ) -> None:
        self._base = base
        self.devices: dict[str, Settings] = {}
        self.signals: dict[str, list[GivenSignal]] = {}
        self.is_given = bool(document.get(TABLE))
        self._axes, self._problems = axes.axes, problems
        sections = read_named_sections(document, TABLE, problems) if TABLE in document else {}
        for name, given in sections.items():
            self._read(name, given)

    @property
    def buses(self) -> Mapping[str, str]:
        """The bus of each device by its name."""
        return {name: device["bus"].value for name, device in self.devices.items()}

    @staticmethod
    def needs_axis(document: Document) -> bool:
        """Return True if a J1939 device of a file is connected to a plant."""
        devices = document[TABLE]
        return not isinstance(devices, dict) or any(map(_is_at_axis, devices.values()))

    def drives(self) -> Iterator[OtherDrive]:
        """Yield what commands axes."""
        for name, device in self.devices.items():
            table = f"{TABLE}.{name}"
            if _kind_of(device).has_axis:
                place = self._problems.place(table, "axis")
                yield OtherDrive(f"the valve {table}", place, device["axis"].value)
            for signal in self.signals[name]:
                if signal.is_sink:
                    place = self._problems.place(signal.table, "sink")
                    yield OtherDrive(f"the sink {signal.table}", place, signal.axis)

    def fault_targets(self) -> dict[str, dict[str, Any]]:
        """Return the targets of faults by group, sensors with the units of their amounts."""
        from hil_bench.abilities.j1939.fault_kinds import name_targets  # noqa: PLC0415 - of faults

        sent, valves, sensors = list[str](), list[str](), dict[str, str]()
        for device, given in self.signals.items():
            for signal in given:
                name = f"{device}.{signal.name}"
                (valves if signal.is_sink else sent).append(name)
                if not signal.is_sink and signal.word != "follow":
                    own = si_unit(signal.settings["unit"].value or ONE.symbol)[0]
                    sensors[name] = signal.quantity.unit if signal.quantity is not None else own
        for name, table in self.devices.items():
            if _kind_of(table).has_axis:
                valves.append(name)
                sensors[f"{name}.{FLOW.name}"] = FLOW.unit
        return name_targets(self.devices, sensors, valves, sent)

    def resolve(self) -> None:
        """Find the axes, and note addresses that clash."""
        owners: dict[tuple[str, int], str] = {}
        for name, device in self.devices.items():
            kind, table = _kind_of(device), f"{TABLE}.{name}"
            if kind.has_axis:
                self._resolve_axis(table, device)
                if (axis := self._axes.get(device["axis"].value)) is not None:
                    kind.check(table, device, axis, self._problems)
                    kind.resolve(device, axis)
            key = device["bus"].value, device["address"].value
            owner = owners.setdefault(key, name)
            if owner != name:
                wrong = f"{key[1]} is that of {TABLE}.{owner} too; give each device its own"
                self._problems.add(self._problems.place(table, "address"), wrong)
            check_groups(self.signals[name], self._problems)

    def build(self) -> dict[str, Any]:
        """Return the records of the devices."""
        return {TABLE: J1939Part(tuple(self._build(name) for name in self.devices))}

    def tables(self) -> Iterable[Settings]:
        """Return the table of each device, then those of its signals."""
        return (
            table
            for name, device in self.devices.items()
            for table in (device, *(signal.settings for signal in self.signals[name]))
        )

    def _read(self, name: str, given: dict[str, Given]) -> None:
        table = f"{TABLE}.{name}"
        signals = given.pop(SIGNALS_TABLE, None)
        told = given.get(_KIND_KEY.name)
        value = told.value if told else SIGNAL_TABLE.name
        kind = ECU_KINDS.get(value) if isinstance(value, str) else None
        if kind is None:
            read_table(table, {_KIND_KEY.name: told} if told else {}, (_KIND_KEY,), self._problems)
            return
        device = read_table(table, given, _keys_of(kind), self._problems)
        if len(device) < len(_keys_of(kind)):
            return
        self.devices[name], self.signals[name] = device, []
        if kind is SIGNAL_TABLE:
            file = device[DBC_KEY.name].value
            dbc = None if file is None else self._base / file
            self.signals[name] = read_signals(table, signals, self._axes, self._problems, dbc)
        elif signals is not None:
            wrong = f'kind = "{kind.name}" has its own signals; leave them out'
            self._problems.add(signals.place, wrong)

    def _resolve_axis(self, table: str, device: Settings) -> None:
        axis, axes = device["axis"], self._axes
        if axis.value is None and len(axes) == 1:
            device["axis"] = axis._replace(value=next(iter(axes)))
        elif axis.value not in axes:
            wrong = "missing" if axis.value is None else f"there is no axis {describe(axis.value)}"
            right = f"give one of {', '.join(axes)}" if axes else "give the bench a plant"
            self._problems.add(self._problems.place(table, "axis"), f"{wrong}; {right}")

    def _build(self, name: str) -> EcuConfig:
        device = self.devices[name]
        kind = _kind_of(device)
        values = convert(device, [key for key in _keys_of(kind) if key is not _KIND_KEY])
        parts = {key.name: values.pop(key.name) for key in _NAME_KEYS}
        if parts["identity"] is None:
            parts["identity"] = named_serial_number(name) & _IDENTITY_BITS
        values["component"] = values["component"] or ""
        if kind is SIGNAL_TABLE:
            sent, taken = build_signals(self.signals[name], self._axes)
            values |= {"sent": sent, "taken": taken}
        place = self._problems.place(f"{TABLE}.{name}")
        record: EcuConfig = kind.record(
            name=name, kind=kind, identity=Name(**parts), place=place, **values
        )
        return record


def _kind_of(device: Settings) -> EcuKind[Any]:
    return ECU_KINDS[device[_KIND_KEY.name].value]


def _is_at_axis(device: object) -> bool:
    if not isinstance(device, dict):
        return False
    kind = ECU_KINDS.get(str(device.get(_KIND_KEY.name, SIGNAL_TABLE.name)))
    signals = device.get(SIGNALS_TABLE)
    values = signals.values() if isinstance(signals, dict) else ()
    is_bound = any(isinstance(each, dict) and each.keys() & {"source", "sink"} for each in values)
    return is_bound or (kind is not None and kind.has_axis)
