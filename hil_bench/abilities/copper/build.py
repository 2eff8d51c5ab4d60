"""Makes the buses of copper of a bench."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from hil_bench.abilities.copper.wire.attempt import Chance
from hil_bench.abilities.copper.wire.station import CONTROLLER, Station, WireConfig
from hil_bench.abilities.copper.wire.wire import Wire
from hil_bench.abilities.copper.wiring import Bus, Device, Plug, Wiring
from hil_bench.bench.configuration import BenchConfig
from hil_bench.devices.measurement.low_pass import random_stream
from hil_bench.outside.bits import USUAL_BITRATE

if TYPE_CHECKING:
    from numpy.random import Generator

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
    for number, (name, bus) in enumerate(config.buses.items()):
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
        buses.append(Bus(number, wire, controller, babbler))
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
