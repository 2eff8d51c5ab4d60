"""The tables ``[bus]`` and ``[buses.NAME]``: the buses that the nodes are on."""

from collections.abc import Iterable, Mapping
from typing import Any, Protocol

from hil_bench.ability import bus_tables
from hil_bench.bench.configuration.loop import BUS_KEYS
from hil_bench.bench.configuration.records import FIRST_BUS, BusConfig, Carrier
from hil_bench.config.document import Document, read_named_sections, read_section
from hil_bench.config.settings import Given, Key, Origin, Problems, Settings, read_table
from hil_bench.config.values import close_names, describe
from hil_bench.errors import ConfigError
from hil_bench.outside.bits import USUAL_BITRATE

MOST_BUSES = 8
"""More than any machine has; a recording has room for 32."""

_KNOWN = tuple(key.name for key in BUS_KEYS)


_PACE = frozenset({"bitrate", "fd", "data_bitrate"})
"""Keys that say how a bus works, not which one it is."""


def bus_option(value: object) -> str | int | float | bool:
    """Return a value that a bus class of python-can takes as a keyword argument.

    Raises:
        ConfigError: the value is an array, a table or a date.
    """
    if not isinstance(value, str | int | float):
        raise ConfigError(
            f"{describe(value)} cannot be a bus option; give text, a number or a truth value"
        )
    return value


WIRE_TABLE = "wire"
"""The table of a bus by which frames take time there; an ability reads it."""


class BusTable(Protocol):
    """A table of a bus that an ability has read."""

    def check(self, nodes: Iterable[str], problems: Problems) -> None:
        """Note what does not fit the nodes of the bus."""

    def build(self) -> Carrier:
        """Return the record of the checked table."""

    def tables(self) -> Iterable[Settings]:
        """Return it, and those in it, as a person would write them."""


_Wires = dict[str, BusTable | None]
"""The table ``wire`` of each bus, by the name of the bus."""


class BusesSection:
    """The first bus and the further ones.

    Args:
        document: the file.
        overrides: keys of ``[bus]`` on the command line; None for what it does not say.
        problems: where problems are noted.
    """

    def __init__(
        self, document: Document, overrides: Mapping[str, object], problems: Problems
    ) -> None:
        self._wires: _Wires = {}
        self._first = _read_bus(document, overrides, self._wires, problems)
        self._further = _read_further_buses(document, self._wires, problems)
        self._problems = problems

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all buses, the first one first."""
        return (FIRST_BUS, *self._further)

    def check_nodes(self, nodes: Mapping[str, Settings], others: Mapping[str, str]) -> None:
        """Note devices on a bus that is not there, buses without any, and two that are one.

        Args:
            nodes: the CANopen nodes.
            others: the bus of each other device by its place, as ``j1939.joystick``.
        """
        on = {f"nodes.{name}": node["bus"].value for name, node in nodes.items()}
        on |= others
        _check_buses(self._first, self._further, on, self._problems)
        for bus, wire in self._wires.items():
            if wire is not None:
                there = [name for name, node in nodes.items() if node["bus"].value == bus]
                there += [place.partition(".")[2] for place, its in others.items() if its == bus]
                wire.check(there, self._problems)

    @property
    def wired(self) -> list[str]:
        """Names of the buses that are of copper."""
        return [name for name, wire in self._wires.items() if wire is not None]

    def resolve(self) -> None:
        """Leave all as it is: the nodes, which come later, decide."""

    def build(self) -> dict[str, Any]:
        """Return the records of the buses."""
        wires = self._wires
        further = {name: _build_bus(table, wires[name]) for name, table in self._further.items()}
        return {"bus": _build_bus(self._first, wires[FIRST_BUS]), "further_buses": further}

    def tables(self) -> Iterable[Settings]:
        """Return the table of each bus."""
        wires = (wire for wire in self._wires.values() if wire is not None)
        return (
            self._first,
            *self._further.values(),
            *(table for wire in wires for table in wire.tables()),
        )


def _read_bus(
    document: Document, overrides: Mapping[str, object], wires: _Wires, problems: Problems
) -> Settings:
    """Return the settings of ``[bus]``, which the command line may override."""
    given = read_section(document, FIRST_BUS, problems)
    wires[FIRST_BUS] = _read_wire(FIRST_BUS, given, problems)
    if overrides["interface"] is not None:
        # The further keys are for the bus class of the file's interface; another would refuse them.
        given = {key: value for key, value in given.items() if key in _KNOWN}
    for key, value in overrides.items():
        if value is not None:
            place = f"--{key.replace('_', '-')}" if key in _KNOWN else f"--bus-kwargs {key}"
            given[key] = Given(value, Origin.COMMAND_LINE, place)
    return _read(FIRST_BUS, given, problems)


def _read_wire(bus: str, given: dict[str, Given], problems: Problems) -> BusTable | None:
    """Return the table of a bus by which frames take time; None where it has none."""
    read = bus_tables().get(WIRE_TABLE) if WIRE_TABLE in given else None
    if read is None:
        return None
    table: BusTable = read(f"{bus}.{WIRE_TABLE}", given.pop(WIRE_TABLE), problems)
    return table


def _read_further_buses(
    document: Document, wires: _Wires, problems: Problems
) -> dict[str, Settings]:
    """Return the settings of each ``[buses.NAME]`` by its name."""
    if "buses" not in document:
        return {}
    buses = {}
    for name, given in read_named_sections(document, "buses", problems).items():
        if name == FIRST_BUS:
            wrong = f"[{FIRST_BUS}] is the first bus; give a further one another name"
            problems.add(problems.place(f"buses.{name}"), wrong)
            continue
        wires[name] = _read_wire(f"buses.{name}", given, problems)
        buses[name] = _read(f"buses.{name}", given, problems)
    return buses


def _check_buses(
    bus: Settings,
    further: Mapping[str, Settings],
    devices: Mapping[str, str],
    problems: Problems,
) -> None:
    """Note devices on a bus that is not there, buses without any, and two that are one."""
    known = {FIRST_BUS: bus, **further}
    for name, each in known.items():
        _check_data_bitrate(name if name == FIRST_BUS else f"buses.{name}", each, problems)
    used = set()
    for table, wanted in devices.items():
        used.add(wanted)
        if wanted not in known:
            wrong = f"there is no bus {describe(wanted)}; give one of {', '.join(known)}"
            problems.add(problems.place(table, "bus"), wrong)
    for name in further:
        if name not in used:
            wrong = f'no node is on it; give one bus = "{name}", or leave the table out'
            problems.add(problems.place(f"buses.{name}"), wrong)
    if len(known) > MOST_BUSES:
        wrong = f"{len(known)} buses with [{FIRST_BUS}]; give at most {MOST_BUSES}"
        problems.add(problems.place("buses"), wrong)
    _check_channels(known, problems)


def _check_data_bitrate(table: str, bus: Settings, problems: Problems) -> None:
    """Note a data bit rate that no frame can have."""
    rate, bitrate = bus["data_bitrate"].value, bus["bitrate"].value or USUAL_BITRATE
    if rate is None:
        return
    is_typed = bus["data_bitrate"].origin is Origin.COMMAND_LINE
    wrong, right = "", "--fd" if is_typed else "fd = true"
    if not bus["fd"].value:
        wrong = f"the bus is classical, and has one bit rate; give {right}, or leave it out"
    elif rate < bitrate:
        wrong = f"{describe(rate)} is less than the bit rate; give {bitrate} or more"
    if wrong:
        place = "--data-bitrate" if is_typed else problems.place(table, "data_bitrate")
        problems.add(place, wrong)


def _build_bus(bus: Settings, wire: BusTable | None) -> BusConfig:
    """Return the record of a checked bus."""
    known = {name: bus[name].value for name in _KNOWN}
    options = {name: setting.value for name, setting in bus.items() if name not in known}
    return BusConfig(**known, options=options, wire=wire.build() if wire else None)


def _read(table: str, given: Mapping[str, Given], problems: Problems) -> Settings:
    # Bus classes swallow keywords that they do not know, so a slip of the pen would go unseen.
    options = [
        Key(name, bus_option)
        for name in given
        if name.isascii()
        and name.isidentifier()
        and name not in _KNOWN
        and not close_names(name, _KNOWN, cutoff=0.85)
    ]
    return read_table(table, given, (*BUS_KEYS, *options), problems)


def _check_channels(buses: Mapping[str, Settings], problems: Problems) -> None:
    """Note two tables that name one and the same bus."""
    owners: dict[tuple[object, ...], str] = {}
    for name, bus in buses.items():
        if bus["channel"].value is None:
            continue
        settings = tuple(
            sorted((key, str(setting.value)) for key, setting in bus.items() if key not in _PACE)
        )
        owner = owners.setdefault(settings, name)
        if owner != name:
            other = owner if owner == FIRST_BUS else f"buses.{owner}"
            place = problems.place(f"buses.{name}", "channel")
            wrong = f"{describe(bus['channel'].value)} is that of [{other}] too"
            problems.add(place, f"{wrong}; give each bus a channel of its own")
