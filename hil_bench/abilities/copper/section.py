"""The tables ``[bus.wire]`` and ``[buses.NAME.wire]``: buses that behave as copper."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from hil_bench.abilities.copper.extension import Copper
from hil_bench.abilities.copper.wire.attempt import Chance
from hil_bench.abilities.copper.wire.station import (
    CONTROLLER,
    BufferConfig,
    Order,
    Station,
    WireConfig,
)
from hil_bench.abilities.copper.wire.wire import Wire
from hil_bench.abilities.copper.wiring import Bus, Device, Plug, Wiring
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
from hil_bench.devices.measurement.low_pass import random_stream
from hil_bench.outside.bits import USUAL_BITRATE
from hil_bench.units import MILLISECOND

if TYPE_CHECKING:
    from numpy.random import Generator


# Makes the buses of copper of a bench.

_BABBLER: Final = "babbling node"
_MOST_BABBLE: Final = 1000
_NS_PER_S: Final = 1_000_000_000


def build_wiring(config: BenchConfig, devices: Mapping[str, Device]) -> Wiring:
    """Return the buses of copper of a bench.

    Args:
        config: the bench.
        devices: its CANopen nodes and J1939 devices by name.
    """
    buses, plugs = list[Bus](), list[Plug]()
    for index, (name, bus) in enumerate(config.buses.items()):
        wire_config: object = bus.wire
        if not isinstance(wire_config, WireConfig):
            continue
        controller = make_station(CONTROLLER, wire_config)
        there = [node.name for node in config.nodes if node.bus == name]
        there += [ecu.name for ecu in config.ecus if ecu.bus == name]
        stations = {each: make_station(each, wire_config) for each in there}
        babbler = Station(_BABBLER, _MOST_BABBLE)
        chance = None
        if wire_config.bit_error_rate:
            stream = random_stream(config.seed, name, "bit errors")
            chance = _gaps(stream, wire_config.bit_error_rate)
        wire = Wire(
            bus.bitrate or USUAL_BITRATE,
            [controller, babbler, *stations.values()],
            chance=chance,
            recovery=round(wire_config.recovery * _NS_PER_S),
            data_bitrate=bus.data_bitrate,
        )
        buses.append(Bus(index, wire, controller, babbler))
        plugs += [
            Plug(devices[each], buses[-1], station, wire) for each, station in stations.items()
        ]
    return Wiring(buses, plugs)


def _gaps(stream: "Generator", rate: float) -> Chance:
    """Return a source of the number of good bits before an error, equally likely in each bit."""
    return lambda: int(stream.geometric(rate)) - 1


def make_station(name: str, config: WireConfig) -> Station:
    """Return the CAN controller of a node, or that of the outside."""
    buffer = config.buffer_of(name)
    return Station(name, buffer.depth, buffer.order)


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
