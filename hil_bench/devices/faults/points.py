"""The points of a bench that may have faults."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from hil_bench.canopen_device.frame import Emit
from hil_bench.canopen_device.node import Node
from hil_bench.devices.faults.ecu_point import EcuPoint
from hil_bench.devices.faults.effects import Act, DefectPoint, SensorPoint, SpoolPoint, SupplyPoint
from hil_bench.devices.faults.wire_point import WirePoint


class Board(Protocol):
    """The board at which the bench's devices are connected; see `hil_bench.bench.switchboard`."""

    @property
    def emit(self) -> Emit:
        """Takes a frame that no node sends."""

    def lay(self, owner: object, ways: Mapping[Any, Any]) -> None:
        """Let the frames of these devices go by ways."""


class Places(Protocol):
    """The places of a tick at which faults act; see `hil_bench.bench.bench.Bench`.

    Attributes:
        begins: called before frames are received.
        holds: called before the plants move.
        finishes: called before the nodes send.
    """

    begins: list[Act]
    holds: list[Act]
    finishes: list[Act]

    @property
    def switchboard(self) -> Board:
        """The board of the nodes."""


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
