"""The points of a bench that may have faults, in groups."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Generic, NamedTuple, Protocol, TypeVar

from hil_bench.abilities.faults.effects import (
    Act,
    DefectPoint,
    SensorPoint,
    SpoolPoint,
    SupplyPoint,
)
from hil_bench.abilities.faults.line import Receiver, WirePoint
from hil_bench.canopen_device.frame import Emit
from hil_bench.devices.axis import Enabled

P = TypeVar("P")


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
        events: what began and ended, by the names of such things.
    """

    begins: list[Act]
    holds: list[Act]
    finishes: list[Act]
    events: dict[str, Any]

    @property
    def switchboard(self) -> Board:
        """The board of the nodes."""


@dataclass(frozen=True, slots=True)
class Group(Generic[P]):
    """A group of targets, of which a kind of fault may have one or more.

    Attributes:
        name: as a bench lists its targets.
        word: for one of them in messages.
        wider: the group of which it is a part, where a message says what a target of that lacks.
        lacks: that message, as in "the bus of {} takes no time".
    """

    name: str
    word: str
    wider: "Group[Any] | None" = None
    lacks: str = ""


class NodePoint(NamedTuple):
    """The point at which faults act on a node, or on another device, at its bus.

    Attributes:
        device: takes the frames of the bus.
        off: what happens in it when its power goes, at a time [ns].
        on: what happens when its power is back.
        bus: its number.
    """

    device: Receiver
    off: Act
    on: Act
    bus: int = 0


SENSORS: Final[Group[SensorPoint]] = Group("sensors", "sensor")
VALVES: Final[Group[SpoolPoint]] = Group("valves", "valve")
ENABLES: Final[Group[Enabled]] = Group("enables", "valve with an enable input")
SUPPLIES: Final[Group[SupplyPoint]] = Group("supplies", "axis")
"""Axes with a supply, and the supplies that axes share."""
PLANTS: Final[Group[DefectPoint]] = Group("plants", "axis")
"""Axes and shared supplies, with what may be worn or broken there."""
NODES: Final[Group[NodePoint]] = Group("nodes", "node")
WIRED: Final[Group[WirePoint]] = Group(
    "wired", "node", NODES, "the bus of {} takes no time; give it [bus.wire]"
)
"""Nodes on a bus on which frames take time."""


class FaultPoints:
    """The points of a bench at which faults act.

    Attributes:
        groups: the points by the names of their groups, and by the names of the targets.
    """

    def __init__(self) -> None:
        self.groups: dict[str, dict[str, Any]] = {}

    def of(self, group: Group[P]) -> dict[str, P]:
        """Return the points of a group by the names of the targets."""
        return self.groups.setdefault(group.name, {})
