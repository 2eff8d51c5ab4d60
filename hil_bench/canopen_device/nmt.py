"""NMT slave (CiA 301, network management): states, and the commands that change them.

=================  =====================================  ==================================
state              services                               left by
=================  =====================================  ==================================
INITIALISING       none                                   boot-up message, to PRE_OPERATIONAL
PRE_OPERATIONAL    SDO, SYNC, EMCY, heartbeat             start, stop, resets
OPERATIONAL        SDO, SYNC, EMCY, heartbeat, PDO        stop, enter pre-operational, resets
STOPPED            heartbeat                              start, enter pre-operational, resets
=================  =====================================  ==================================

Reset node restores every object, reset communication those from 0x1000 to 0x1FFF.
"""

from enum import IntEnum
from typing import Final, NamedTuple

NMT_COB_ID: Final = 0x000
_ALL_NODES: Final = 0

UNCONFIGURED: Final = 255
"""Node-ID of a device that has none yet, and waits for LSS to give it one (CiA 305)."""


class NmtState(IntEnum):
    """NMT state; the value is that of the heartbeat, where INITIALISING is the boot-up message."""

    INITIALISING = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


COMMUNICATING: Final = frozenset({NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL})
"""The states that have SDO, SYNC, TIME and EMCY."""


class NmtCommand(IntEnum):
    """NMT command specifier."""

    START = 1
    STOP = 2
    ENTER_PRE_OPERATIONAL = 128
    RESET_NODE = 129
    RESET_COMMUNICATION = 130


class NmtRequest(NamedTuple):
    """An NMT message: a command, and whom it addresses (0 is all)."""

    command: NmtCommand
    node_id: int

    @classmethod
    def parse(cls, data: bytes) -> "NmtRequest | None":
        """Return the request, or None where `data` is none."""
        if len(data) != 2:
            return None
        try:
            return cls(NmtCommand(data[0]), data[1])
        except ValueError:
            return None

    def addresses(self, node_id: int) -> bool:
        """Return True if the command addresses the node."""
        return self.node_id in {_ALL_NODES, node_id}


RESTORED: Final = {
    NmtCommand.RESET_NODE: range(0x1000, 0x10000),
    NmtCommand.RESET_COMMUNICATION: range(0x1000, 0x2000),
}
"""The objects that a reset sets back to their defaults."""

ENTERED: Final = {
    NmtCommand.START: NmtState.OPERATIONAL,
    NmtCommand.STOP: NmtState.STOPPED,
    NmtCommand.ENTER_PRE_OPERATIONAL: NmtState.PRE_OPERATIONAL,
    NmtCommand.RESET_NODE: NmtState.INITIALISING,
    NmtCommand.RESET_COMMUNICATION: NmtState.INITIALISING,
}
"""The state that a command leads to."""
