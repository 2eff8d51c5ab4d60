"""The points of a bench that may have faults."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from hil_bench.canopen_device.node import Node
from hil_bench.devices.faults.ecu_point import EcuPoint
from hil_bench.devices.faults.effects import DefectPoint, SensorPoint, SpoolPoint, SupplyPoint
from hil_bench.devices.faults.wire_point import WirePoint


@dataclass(frozen=True, slots=True)
class FaultPoints:
    """The points of a bench that may have faults, by name.

    Attributes:
        sensors: nodes that measure.
        valves: nodes that command a spool.
        supplies: axes with a supply, and the supplies that axes share.
        plants: axes and shared supplies, with what may be worn or broken there.
        nodes: nodes on the bus.
        buses: the number of the bus of each node; without it all are on bus 0.
        wires: nodes whose bus is of copper.
        ecus: J1939 devices.
    """

    sensors: Mapping[str, SensorPoint] = field(default_factory=dict)
    valves: Mapping[str, SpoolPoint] = field(default_factory=dict)
    supplies: Mapping[str, SupplyPoint] = field(default_factory=dict)
    plants: Mapping[str, DefectPoint] = field(default_factory=dict)
    nodes: Mapping[str, Node] = field(default_factory=dict)
    buses: Mapping[str, int] = field(default_factory=dict)
    wires: Mapping[str, WirePoint] = field(default_factory=dict)
    ecus: Mapping[str, EcuPoint] = field(default_factory=dict)
