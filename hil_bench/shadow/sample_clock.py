"""When a value that comes in a PDO was measured."""

from collections.abc import Sequence

import can

from hil_bench.canopen_device.cob_id import DISABLED, can_id
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.pdo_mapping import Direction
from hil_bench.canopen_device.pdo_parameters import COMMUNICATION_INDICES, SYNCHRONOUS

_NMT = 0x000
_SYNC = 0x080
_SDO = range(0x580, 0x680)


class SampleClock:
    """Times of frames, of synchronous ones the SYNC's.

    A device measures at SYNC, and its PDO waits for the bus among those of all the others (CiA
    301, 7.5.2.16).

    Args:
        nodes: those of the twin, which hear how a controller sets the machine's.
    """

    def __init__(self, nodes: Sequence[Node]) -> None:
        self._nodes = nodes
        self._synced_at: float | None = None
        self._synchronous: frozenset[int] | None = None

    def sample_time(self, message: can.Message, time: float) -> float:
        """Return when the values of a frame were measured [s].

        Args:
            message: the frame.
            time: when it was on the bus [s].
        """
        identifier = message.arbitration_id
        if message.is_extended_id or message.is_remote_frame:
            return time
        if identifier == _SYNC:
            self._synced_at = time
        elif identifier in _SDO or identifier == _NMT:
            self._synchronous = None  # it may have changed a PDO
        elif self._synced_at is not None and identifier in self._identifiers():
            return self._synced_at
        return time

    def _identifiers(self) -> frozenset[int]:
        """Return the identifiers of all synchronous TPDOs."""
        if self._synchronous is None:
            self._synchronous = frozenset(
                identifier for node in self._nodes for identifier in _synchronous(node)
            )
        return self._synchronous


def _synchronous(node: Node) -> list[int]:
    objects = node.object_dictionary
    found = []
    for index in COMMUNICATION_INDICES[Direction.TPDO]:
        if objects.find(index, 2) is None or objects.number(index, 2) not in SYNCHRONOUS:
            continue
        identifier = can_id(objects.number(index, 1, absent=DISABLED))
        if identifier is not None:
            found.append(identifier)
    return found
