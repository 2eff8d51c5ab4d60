"""The tables ``[bus.wire]`` and ``[buses.NAME.wire]``: buses that behave as copper."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from hil_bench.bench.configuration.keys import BUFFER_KEYS, WIRE_KEYS
from hil_bench.config.document import give
from hil_bench.config.settings import Given, Problems, Settings, convert, read_table
from hil_bench.config.values import describe
from hil_bench.outside.wire.config import CONTROLLER, BufferConfig, WireConfig

WIRE_TABLE = "wire"
_STATIONS = "stations"


@dataclass(slots=True)
class WireSettings:
    """The settings of one wire.

    Attributes:
        table: its name, as in ``bus.wire``.
        settings: its own keys.
        stations: those of the stations, by their names.
    """

    table: str
    settings: Settings
    stations: dict[str, Settings] = field(default_factory=dict)


def read_wire(bus: str, given: Given | None, problems: Problems) -> WireSettings | None:
    """Return the settings of the wire of a bus; None where it has no such table."""
    if given is None:
        return None
    table = f"{bus}.{WIRE_TABLE}"
    values = _table(table, given, problems)
    stations = values.pop(_STATIONS, None)
    wire = WireSettings(table, read_table(table, values, WIRE_KEYS, problems))
    if stations is not None:
        for name, each in _table(f"{table}.{_STATIONS}", stations, problems).items():
            place = f"{table}.{_STATIONS}.{name}"
            wire.stations[name] = read_table(
                place, _table(place, each, problems), BUFFER_KEYS, problems
            )
    return wire


def check_wire(wire: WireSettings, nodes: Iterable[str], problems: Problems) -> None:
    """Note stations that are not on the bus."""
    known = [CONTROLLER, *nodes]
    for name in wire.stations:
        if name not in known:
            wrong = f"is no node of this bus; give one of {', '.join(known)}"
            problems.add(problems.place(f"{wire.table}.{_STATIONS}.{name}"), wrong)


def build_wire(wire: WireSettings | None) -> WireConfig | None:
    """Return the record of a checked wire."""
    if wire is None:
        return None
    own = [key for key in WIRE_KEYS if key not in BUFFER_KEYS]
    return WireConfig(
        BufferConfig(**convert(wire.settings, BUFFER_KEYS)),
        {
            name: BufferConfig(**convert(settings, BUFFER_KEYS))
            for name, settings in wire.stations.items()
        },
        **convert(wire.settings, own),
    )


def wire_settings(wires: Mapping[str, WireSettings | None]) -> list[Settings]:
    """Return the settings of all wires, table by table."""
    return [
        table
        for wire in wires.values()
        if wire is not None
        for table in (wire.settings, *wire.stations.values())
    ]


def _table(table: str, given: Given, problems: Problems) -> dict[str, Given]:
    if isinstance(given.value, dict):
        return give(table, given.value, given.origin, problems)
    wrong = f"{describe(given.value)} is not a table; write it as [{table}]"
    problems.add(given.place, wrong)
    return {}
