"""Finds the nodes of a bus."""

from collections import Counter
from collections.abc import Iterable
from enum import StrEnum
from typing import NamedTuple

from hil_bench.errors import ConfigError
from hil_drivers import Network, NmtState

NODE_IDS = range(1, 128)
"""All node-IDs there are (CiA 301)."""

ERROR_CONTROL = 0x700
"""Heartbeat, boot-up and node guarding of node n have this COB-ID + n."""

_NMT = 0x000
_SDO_REQUEST, _SDO_ANSWER = 0x600, 0x580
_RESET_COMMUNICATION = bytes([130, 0])
_READ_DEVICE_TYPE = bytes.fromhex("4000100000000000")
_TOGGLE = 0x80

_SPACING = 0.001
"""Time between two requests [s], so that 127 of them overflow no adapter's buffer."""


class Method(StrEnum):
    """The method by which a node is made to show itself."""

    SDO = "sdo"
    """By its answer, or its abort, to a read of 0x1000. Changes nothing."""
    GUARDING = "guarding"
    """By its answer to a remote frame (node guarding).

    Where 0x100C and 0x100D are set that begins life guarding: the device reports an error when no
    further request comes, and a valve goes into its fault state.
    """
    HEARTBEAT = "heartbeat"
    """By a heartbeat that it sends anyway. Nothing is sent."""
    BOOT_UP = "boot-up"
    """By its boot-up message after a reset of the communication of all nodes."""


class Sighting(NamedTuple):
    """The evidence that a node exists.

    Attributes:
        node_id: its node-ID.
        nmt_state: the last that it told, None where it told none.
        answers: messages that answered one request; more than one is more than one node.
    """

    node_id: int
    nmt_state: NmtState | None = None
    answers: int = 0


class _Lookout:
    """Takes the messages by which nodes show themselves."""

    def __init__(self) -> None:
        self.states: dict[int, NmtState] = {}
        self.answers: Counter[int] = Counter()
        self.asked_by_others: Counter[int] = Counter()

    def sightings(self) -> list[Sighting]:
        return [
            Sighting(node_id, self.states.get(node_id), self._answers(node_id))
            for node_id in sorted(self.states.keys() | self.answers.keys())
        ]

    def _answers(self, node_id: int) -> int:
        """Return the answers to one request of ours; others that ask the same have theirs."""
        answers = self.answers[node_id]
        return max(answers - self.asked_by_others[node_id], min(answers, 1))

    def take_request(self, node_id: int, data: bytes) -> bool:
        """Take a read of 0x1000 by another client."""
        if data[:4] != _READ_DEVICE_TYPE[:4]:
            return False
        self.asked_by_others[node_id] += 1
        return True

    def take_state(self, node_id: int, data: bytes) -> bool:
        """Take a heartbeat, a boot-up message or an answer to node guarding."""
        state = guarded_state(data)
        if state is not None:
            self.states[node_id] = state
        return state is not None

    def take_answer(self, node_id: int, data: bytes) -> bool:
        """Take an SDO answer to the read of 0x1000."""
        if len(data) != 8 or data[1:4] != _READ_DEVICE_TYPE[1:4]:
            return False
        self.answers[node_id] += 1
        return True


def guarded_state(data: bytes) -> NmtState | None:
    """Return the NMT state in a heartbeat or an answer to node guarding; None where it is none."""
    if len(data) != 1 or data[0] & ~_TOGGLE not in frozenset(NmtState):
        return None
    state = NmtState(data[0] & ~_TOGGLE)
    # A device that has booted up goes on without another message.
    return NmtState.PRE_OPERATIONAL if state is NmtState.INITIALISING else state


def discover(
    network: Network, method: Method, *, node_ids: Iterable[int] = NODE_IDS, patience: float = 1.0
) -> list[Sighting]:
    """Return the nodes that showed themselves, in the order of their node-IDs.

    Heartbeats and boot-up messages count whatever the method, and give the NMT states.

    Args:
        network: an open network.
        method: how the nodes are made to show themselves.
        node_ids: those to look for.
        patience: time to listen after the last request [s].

    Raises:
        ConfigError: a node-ID is none, or the patience is not positive.
    """
    wanted = sorted(set(node_ids))
    for node_id in wanted:
        if node_id not in NODE_IDS:
            raise ConfigError(f"node-ID {node_id}: 1 to 127 is right")
    if not 0.0 < patience < float("inf"):
        raise ConfigError(f"patience {patience:g} s: a positive time is right")
    lookout = _Lookout()
    for node_id in wanted:
        _watch(network, lookout, node_id)
    _ask(network, method, wanted)
    network.pump(patience)
    return lookout.sightings()


def _watch(network: Network, lookout: _Lookout, node_id: int) -> None:
    network.subscribe(ERROR_CONTROL + node_id, lambda data, _now: lookout.take_state(node_id, data))
    network.subscribe(_SDO_ANSWER + node_id, lambda data, _now: lookout.take_answer(node_id, data))
    network.subscribe(
        _SDO_REQUEST + node_id, lambda data, _now: lookout.take_request(node_id, data)
    )


def _ask(network: Network, method: Method, node_ids: list[int]) -> None:
    if method is Method.BOOT_UP:
        network.send(_NMT, _RESET_COMMUNICATION)
    for node_id in node_ids:
        if method is Method.SDO:
            network.send(_SDO_REQUEST + node_id, _READ_DEVICE_TYPE)
        elif method is Method.GUARDING:
            network.request(ERROR_CONTROL + node_id, 1)
        else:
            return
        network.pump(_SPACING)
