"""What a node tells its application."""

from enum import Enum, auto
from typing import NamedTuple


class NodeEventKind(Enum):
    """What happened; in brackets what `NodeEvent.detail` holds then."""

    STATE_CHANGED = auto()
    """The NMT state changed [the new `NmtState`]."""
    RESET_NODE = auto()
    """Every object is back to its default [0]."""
    RESET_COMMUNICATION = auto()
    """The communication objects, 0x1000 to 0x1FFF, are back to their defaults [0]."""
    RPDO_RECEIVED = auto()
    """The values of an RPDO are in the object dictionary [number of the RPDO]."""
    RPDO_TIMEOUT = auto()
    """An RPDO did not come within its event timer [number of the RPDO]."""
    HEARTBEAT_LOST = auto()
    """A watched node's heartbeat stopped, or the node booted anew [its node-ID]."""
    HEARTBEAT_RESUMED = auto()
    """A lost node's heartbeat is back [its node-ID]."""


class NodeEvent(NamedTuple):
    """One event; `detail` as `NodeEventKind` says."""

    kind: NodeEventKind
    detail: int
