"""Makes the buses of copper of a bench."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.wiring import Bus, Device, Plug, Wiring
from hil_bench.canopen_device.node import Node
from hil_bench.devices.j1939.ecu import Ecu
from hil_bench.devices.measurement.noise import random_stream
from hil_bench.outside.transports.bus_load import USUAL_BITRATE
from hil_bench.outside.wire.attempt import Chance
from hil_bench.outside.wire.config import CONTROLLER, WireConfig
from hil_bench.outside.wire.station import Station
from hil_bench.outside.wire.wire import Wire

if TYPE_CHECKING:
    from numpy.random import Generator

_BABBLER: Final = "babbling node"
_MOST_BABBLE: Final = 1000
_NS_PER_S: Final = 1_000_000_000


def build_wiring(
    config: BenchConfig, nodes: Mapping[str, Node], ecus: Mapping[str, Ecu]
) -> Wiring | None:
    """Return the buses of copper of a bench; None where it has none.

    Args:
        config: the bench.
        nodes: its CANopen nodes by name.
        ecus: its J1939 devices by name.
    """
    devices: Mapping[str, Device] = {**nodes, **ecus}
    buses, plugs = list[Bus](), list[Plug]()
    for number, (name, bus) in enumerate(config.buses.items()):
        if bus.wire is None:
            continue
        controller = make_station(CONTROLLER, bus.wire)
        there = [node.name for node in config.nodes if node.bus == name]
        there += [ecu.name for ecu in config.ecus if ecu.bus == name]
        stations = {each: make_station(each, bus.wire) for each in there}
        babbler = Station(_BABBLER, _MOST_BABBLE)
        chance = None
        if bus.wire.bit_error_rate:
            stream = random_stream(config.seed, name, "bit errors")
            chance = _gaps(stream, bus.wire.bit_error_rate)
        wire = Wire(
            bus.bitrate or USUAL_BITRATE,
            [controller, babbler, *stations.values()],
            chance=chance,
            recovery=round(bus.wire.recovery * _NS_PER_S),
        )
        buses.append(Bus(number, wire, controller, babbler))
        plugs += [
            Plug(devices[each], buses[-1], station, wire) for each, station in stations.items()
        ]
    return Wiring(buses, plugs) if buses else None


def _gaps(stream: "Generator", rate: float) -> Chance:
    """Return a source of the number of good bits before an error, equally likely in each bit."""
    return lambda: int(stream.geometric(rate)) - 1


def make_station(name: str, config: WireConfig) -> Station:
    """Return the CAN controller of a node, or that of the outside."""
    buffer = config.buffer_of(name)
    return Station(name, buffer.depth, buffer.order)
