"""NMT states of a machine's nodes, as its frames show them, for the twin's nodes to take over."""

from collections.abc import Iterator, Sequence

import can

from hil_bench.canopen_device.cob_id import DISABLED, can_id
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import (
    ENTERED,
    NMT_COB_ID,
    RESTORED,
    NmtCommand,
    NmtRequest,
    NmtState,
)
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.pdo_mapping import Direction
from hil_bench.canopen_device.pdo_parameters import COMMUNICATION_INDICES, SYNCHRONOUS

GRACE = 0.02
"""How long a machine may take to do what it is commanded, and to say so [s]."""

_ERROR_CONTROL = range(0x701, 0x780)
_CHANGING = (range(0x580, 0x680), range(0x7E4, 0x7E6))
"""Frames that may change which TPDOs there are: SDO and LSS."""
_STATE_BITS = 0x7F
_COMMANDS = {state: command for command, state in ENTERED.items()}


class NodeStates:
    """Tells by which NMT commands the twin's nodes get to the states of the machine's.

    A machine that is OPERATIONAL already hears no command any more. A TPDO shows OPERATIONAL, a
    heartbeat or a node guarding answer shows the state, a boot-up message shows a device that has
    restarted by itself. After an NMT command the machine has `GRACE` to follow it.

    Args:
        nodes: those of the twin.

    Attributes:
        reported: states by node-ID, of nodes that have said theirs.
    """

    def __init__(self, nodes: Sequence[Node]) -> None:
        self.reported: dict[int, NmtState] = {}
        self._nodes = nodes
        self._commanded: dict[int, float] = {}
        self._resetting: set[int] = set()
        self._tpdos: dict[int, tuple[Node, bool]] | None = None

    def hear(self, message: can.Message, time: float) -> list[Frame]:
        """Take a frame and return the NMT commands that the twin needs before it.

        Args:
            message: the frame.
            time: when it was on the bus [s].
        """
        if message.is_extended_id or message.is_remote_frame:
            return []
        identifier = message.arbitration_id
        if identifier == NMT_COB_ID:
            self._hear_command(bytes(message.data), time)
        elif identifier in _ERROR_CONTROL and message.dlc == 1:
            return self._hear_state(identifier - _ERROR_CONTROL.start + 1, message.data[0], time)
        elif any(identifier in some for some in _CHANGING):
            self._tpdos = None
        elif identifier in self._known_tpdos():
            sender, _ = self._known_tpdos()[identifier]
            self.reported[sender.node_id] = NmtState.OPERATIONAL
            return self._follow(sender, NmtState.OPERATIONAL, time)
        return []

    def is_synchronous(self, identifier: int) -> bool:
        """Return True if a TPDO follows SYNC, by the configuration and the SDO transfers heard."""
        _, is_synchronous = self._known_tpdos().get(identifier, (None, False))
        return is_synchronous

    def _hear_command(self, data: bytes, time: float) -> None:
        request = NmtRequest.parse(data)
        if request is None:
            return
        self._tpdos = None
        for node in self._nodes:
            if request.addresses(node.node_id):
                self._commanded[node.node_id] = time
                if request.command in RESTORED:
                    self._resetting.add(node.node_id)

    def _hear_state(self, node_id: int, told: int, time: float) -> list[Frame]:
        node = next((node for node in self._nodes if node.node_id == node_id), None)
        try:
            state = NmtState(told & _STATE_BITS)
        except ValueError:
            return []
        if node is None:
            return []
        if state is not NmtState.INITIALISING:
            self.reported[node_id] = state
            return self._follow(node, state, time)
        self.reported[node_id] = NmtState.PRE_OPERATIONAL  # after its boot-up message
        self._tpdos = None
        if node_id in self._resetting:  # the twin has heard the same command
            self._resetting.discard(node_id)
            return []
        return self._command(node, NmtCommand.RESET_NODE, time)

    def _follow(self, node: Node, state: NmtState, time: float) -> list[Frame]:
        if node.state is state or time - self._commanded.get(node.node_id, -GRACE) < GRACE:
            return []
        return self._command(node, _COMMANDS[state], time)

    def _command(self, node: Node, command: NmtCommand, time: float) -> list[Frame]:
        self._commanded[node.node_id] = time
        return [Frame(NMT_COB_ID, bytes([command, node.node_id]))]

    def _known_tpdos(self) -> dict[int, tuple[Node, bool]]:
        """Return the twin's TPDOs by identifier: whose they are, and whether they follow SYNC."""
        if self._tpdos is None:
            self._tpdos = {
                identifier: (node, is_synchronous)
                for node in self._nodes
                for identifier, is_synchronous in _tpdos(node)
            }
        return self._tpdos


def _tpdos(node: Node) -> Iterator[tuple[int, bool]]:
    objects = node.object_dictionary
    for index in objects.indices(COMMUNICATION_INDICES[Direction.TPDO]):
        identifier = can_id(objects.number(index, 1, absent=DISABLED))
        if identifier is not None:
            yield identifier, objects.number(index, 2, absent=255) in SYNCHRONOUS
