"""NMT states of slaves that a master has started: seen, or not known; never taken for granted."""

from collections.abc import Callable
from typing import Final

from hil_drivers.errors import DriverError
from hil_drivers.network import Network
from hil_drivers.node import NmtState, Node

GUARD: Final = 0.5
"""Longest wait for the answer to node guarding [s]."""

_HEARTBEAT_TIME, _GUARD_TIME, _LIFE_FACTOR = 0x1017, 0x100C, 0x100D
_PERIODS: Final = 2.0
_MARGIN: Final = 0.1
"""Time beyond the periods in which a heartbeat still counts [s]: hosts are held up."""


def state_after_start(
    network: Network, node: Node, since: float, guard: Callable[[], NmtState | None]
) -> NmtState | None:
    """Return the NMT state that a node reports after it was started; None where it reports none.

    A node with a heartbeat has two periods of it to report OPERATIONAL. One without is asked by
    node guarding, unless that would begin life guarding (0x100C and 0x100D), which the master would
    have to keep up.

    Args:
        network: that the node is on.
        node: the node.
        since: when it was started, by the clock of the network [s].
        guard: asks for the state once, and waits for the answer.
    """
    period = _number(node, _HEARTBEAT_TIME) / 1000.0
    if period:
        network.wait_for(
            lambda: node.heard_at >= since and node.nmt_state is NmtState.OPERATIONAL,
            _PERIODS * period + _MARGIN,
        )
        return node.nmt_state if node.heard_at >= since else None
    if _number(node, _GUARD_TIME) and _number(node, _LIFE_FACTOR):
        return None
    return guard()


def _number(node: Node, index: int) -> int:
    """Return an unsigned number of a node; 0 where it has no such object or does not answer."""
    try:
        return int.from_bytes(node.upload(index), "little")
    except DriverError:
        return 0
