"""The tables ``[bus.wire]`` and ``[buses.NAME.wire]``: buses that behave as copper."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from hil_bench.abilities.copper.build import build_wiring
from hil_bench.abilities.copper.extension import Copper
from hil_bench.abilities.copper.wire.station import CONTROLLER, BufferConfig, Order, WireConfig
from hil_bench.abilities.copper.wiring import Device
from hil_bench.bench.configuration import BenchConfig
from hil_bench.config.settings import (
    Given,
    Key,
    Problems,
    Settings,
    convert,
    open_table,
    read_table,
)
from hil_bench.config.values import choice, integer, number
from hil_bench.units import MILLISECOND

# The wire of a bus as a part of the bench's configuration.


@dataclass(frozen=True, slots=True)
class CopperWire(WireConfig):
    """The wire that the table ``[bus.wire]`` describes; `WireConfig` is its data."""

    def medium(self, config: BenchConfig, devices: Mapping[str, Device]) -> Copper:
        """Return the extension for all buses of copper of a bench.

        Args:
            config: the bench.
            devices: those on its buses, by their names.
        """
        return Copper(build_wiring(config, devices))


_STATIONS = "stations"

BUFFER_KEYS = (
    Key("buffer_frames", integer(1, 100_000), 256, field="depth"),
    Key("order", choice(Order), Order.PRIORITY),
)

WIRE_KEYS = (
    *BUFFER_KEYS,
    Key("bit_error_rate", number(low=0.0, high=0.01), 0.0),
    Key("recovery_ms", number(MILLISECOND, low=0.0, high=3.6e6), 0.0, MILLISECOND, "recovery"),
)


@dataclass(slots=True)
class WireTable:
    """The settings of one wire.

    Attributes:
        table: its name, as in ``bus.wire``.
        settings: its own keys.
        stations: those of the stations, by their names.
    """

    table: str
    settings: Settings
    stations: dict[str, Settings] = field(default_factory=dict)

    def check(self, nodes: Iterable[str], problems: Problems) -> None:
        """Note stations that are not on the bus."""
        known = [CONTROLLER, *nodes]
        for name in self.stations:
            if name not in known:
                wrong = f"is no node of this bus; give one of {', '.join(known)}"
                problems.add(problems.place(f"{self.table}.{_STATIONS}.{name}"), wrong)

    def build(self) -> CopperWire:
        """Return the record of a checked wire."""
        own = [key for key in WIRE_KEYS if key not in BUFFER_KEYS]
        return CopperWire(
            BufferConfig(**convert(self.settings, BUFFER_KEYS)),
            {
                name: BufferConfig(**convert(settings, BUFFER_KEYS))
                for name, settings in self.stations.items()
            },
            **convert(self.settings, own),
        )

    def tables(self) -> tuple[Settings, ...]:
        """Return its settings, then those of its stations."""
        return (self.settings, *self.stations.values())


def read_wire(table: str, given: Given, problems: Problems) -> WireTable:
    """Return the settings of the wire of a bus."""
    values = open_table(table, given, problems)
    stations = values.pop(_STATIONS, None)
    wire = WireTable(table, read_table(table, values, WIRE_KEYS, problems))
    if stations is not None:
        for name, each in open_table(f"{table}.{_STATIONS}", stations, problems).items():
            place = f"{table}.{_STATIONS}.{name}"
            values = open_table(place, each, problems)
            wire.stations[name] = read_table(place, values, BUFFER_KEYS, problems)
    return wire
