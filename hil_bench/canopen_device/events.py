"""Events that a node reports to its application."""

from collections import deque
from enum import Enum, auto
from typing import NamedTuple


class NodeEventKind(Enum):
    """The kind of an event; in brackets the content of `NodeEvent.detail`."""

    STATE_CHANGED = auto()
    """The NMT state changed [the new `NmtState`]."""
    RESET_NODE = auto()
    """Every object is back to its default [0]."""
    RESET_COMMUNICATION = auto()
    """The communication objects, 0x1000 to 0x1FFF, are back to their defaults [0]."""
    RPDO_TIMEOUT = auto()
    """An RPDO did not come within its event timer [number of the RPDO]."""
    SRDO_FAILED = auto()
    """A received SRDO stayed out, came late or disagreed with itself [number of the SRDO]."""
    HEARTBEAT_LOST = auto()
    """A watched node's heartbeat stopped, or the node booted anew [its node-ID]."""
    HEARTBEAT_RESUMED = auto()
    """A lost node's heartbeat is back, or no longer watched [its node-ID]."""
    GUARDING_LOST = auto()
    """The NMT master stopped guarding this node: a life guarding event [0]."""
    GUARDING_RESUMED = auto()
    """The NMT master guards again, or guarding is switched off [0]."""


class NodeEvent(NamedTuple):
    """One event; `detail` as `NodeEventKind` says."""

    kind: NodeEventKind
    detail: int


class NodeEvents(deque[NodeEvent]):
    """The events not yet read by the application, oldest first, each at most once.

    An event that comes again before it was heard moves to the end. So the last event of each kind
    keeps its place in time, no flood of frames pushes another event out, and the queue is never
    longer than the number of different events.
    """

    __slots__ = ()

    def tell(self, event: NodeEvent) -> None:
        """Add `event` at the end, and drop an earlier one that is the same."""
        if event in self:
            self.remove(event)
        self.append(event)
