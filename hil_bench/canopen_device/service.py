"""The services of a node in common: their interface, their counters, the routing of frames."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from hil_bench.canopen_device.agenda import NEVER
from hil_bench.canopen_device.frame import Emit, Frame, Handler
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.object_dictionary import Variable

# The interface that a node expects of each of its services.


class Service:
    """One service of a node. What it does not override concerns it not, and has no effect."""

    def handlers(self) -> Iterable[tuple[int | None, Handler]]:
        """Return the handlers of received frames by identifier; None for one that is off."""
        return ()

    def enter(self, state: NmtState) -> None:
        """Follow the NMT state of the node."""

    def reset(self, node_id: int) -> None:
        """Begin anew, for the device `node_id`, after the objects got their power-on values."""

    def serve(self, now: int, emit: Emit) -> int:  # noqa: ARG002 - for those that send
        """Send what is due.

        Returns:
            The next time at which the service has something to do [ns]; it may be earlier than
            need be, never later. NEVER also where an agenda of the service's own has that time.
        """
        return NEVER


class AddedService(Service):
    """A service of some devices only, which a node gets from who makes it."""

    def expire(self, now: int) -> None:
        """Act on what did not come in time."""


# Counters of the frames and requests that a node ignored or refused.


@dataclass(slots=True)
class NodeCounters:
    """Frames and values that had no effect, or less than their sender may have meant.

    Attributes:
        ignored_frames: remote frames that nothing answers, and 29-bit frames on one of our
            identifiers.
        malformed_nmt: NMT commands of a wrong length or with an unknown command.
        malformed_heartbeats: heartbeats of a wrong length or with an unknown state.
        malformed_time: TIME messages of a wrong length.
        unexpected_sync_length: SYNC messages with a counter that 0x1019 does not ask for, or
            without one that it does.
        short_rpdos: RPDOs with fewer bytes than mapped, not processed.
        long_rpdos: RPDOs with more bytes than mapped, processed.
        late_synchronous_pdos: synchronous PDOs after the end of the window 0x1007, discarded.
        refused_values: RPDO values outside an object's limits or refused by a check.
        sdo_aborts: SDO transfers that this node aborted.
        short_sdo_requests: SDO requests of fewer than 8 bytes, not answered.
        dropped_sdo_requests: SDO requests beyond the queue's length.
        malformed_lss: LSS messages of a wrong length, and those that switch to a reserved mode.
        dropped_lss_requests: LSS requests beyond the queue's length.
        dropped_emcy: emergency messages beyond the queue's length; the oldest go.
        foreign_frames: frames from elsewhere with an identifier that this node sends with; a second
            device has its node-ID. Who runs the node counts them.
    """

    ignored_frames: int = 0
    malformed_nmt: int = 0
    malformed_heartbeats: int = 0
    malformed_time: int = 0
    unexpected_sync_length: int = 0
    short_rpdos: int = 0
    long_rpdos: int = 0
    late_synchronous_pdos: int = 0
    refused_values: int = 0
    sdo_aborts: int = 0
    short_sdo_requests: int = 0
    dropped_sdo_requests: int = 0
    malformed_lss: int = 0
    dropped_lss_requests: int = 0
    dropped_emcy: int = 0
    foreign_frames: int = 0

    def is_data(self, frame: Frame) -> bool:
        """Return True if it is a data frame with an 11-bit identifier; count it where not."""
        if frame.is_remote or frame.is_extended:
            self.ignored_frames += 1
            return False
        return True


# Routing of received frames to their handlers.

_IDENTIFIERS: Final = frozenset({0x1005, 0x1012})
_FIRST_IS_IDENTIFIER: Final = (range(0x1400, 0x1600), range(0x1800, 0x1A00))
_BEHIND_IDENTIFIERS: Final = 0x1A00
_ALL_ARE_IDENTIFIERS: Final = (range(0x1016, 0x1017), range(0x1201, 0x1280), range(0x1301, 0x1341))


def names_identifier(variable: Variable) -> bool:
    """Return True if a write to `variable` may change which identifiers the device receives."""
    index, subindex = variable.index, variable.subindex
    return index < _BEHIND_IDENTIFIERS and (
        index in _IDENTIFIERS
        or (subindex == 1 and any(index in indices for indices in _FIRST_IS_IDENTIFIER))
        or (subindex > 0 and any(index in indices for indices in _ALL_ARE_IDENTIFIERS))
    )


class RouteTable:
    """Handlers by identifier, while they are collected.

    Attributes:
        routes: what was added.
    """

    def __init__(self) -> None:
        self.routes: dict[int, Handler] = {}

    def add(self, can_id: int | None, handler: Handler) -> None:
        """Add a handler after the one that is there, for two services may share an identifier.

        An identifier of None, that of a service which is off, has no effect.
        """
        if can_id is None:
            return
        present = self.routes.get(can_id)
        self.routes[can_id] = handler if present is None else _both(present, handler)


def _both(first: Handler, second: Handler) -> Handler:
    def handle(frame: Frame, now: int) -> None:
        first(frame, now)
        second(frame, now)

    return handle
