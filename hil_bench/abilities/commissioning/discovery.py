"""Nodes on a bus, found by asking and by listening, and signs that a bus is in operation."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

import can

from hil_bench.abilities.common.identifiers import function_of
from hil_bench.abilities.eyes.frame_words import meaning_of
from hil_bench.abilities.eyes.j1939 import describe
from hil_bench.errors import ConfigError
from hil_bench.frame import bits_of
from hil_bench.outside.messages import frame_of
from hil_drivers import Network, NmtState

# Finds the nodes of a bus.

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


# Listens to a bus without sending anything.


@dataclass(slots=True)
class Traffic:
    """The frames of one identifier.

    Attributes:
        can_id: the identifier.
        is_extended: whether it has 29 bits.
        frames: how many came.
        data: of the last.
        is_remote: whether the last was a remote frame.
    """

    can_id: int
    is_extended: bool
    frames: int = 0
    data: bytes = b""
    is_remote: bool = False

    @property
    def function(self) -> str:
        """The function of the identifier in the predefined connection set."""
        return "not CANopen" if self.is_extended else function_of(self.can_id).name

    @property
    def node_id(self) -> int | None:
        """The node that it belongs to by default."""
        return None if self.is_extended else function_of(self.can_id).node_id

    @property
    def meaning(self) -> str:
        """The meaning of the last frame."""
        if self.is_remote:
            return "remote frame"
        if self.is_extended:
            return f"as J1939: {describe(self.can_id, self.data)}"
        return meaning_of(self.can_id, self.data)


@dataclass(slots=True)
class BusTraffic:
    """The traffic of a bus during a time of listening.

    Attributes:
        duration: how long that was [s].
        bits: on the bus, with the expected number of stuff bits.
        error_frames: reported by the adapter.
        fd_frames: of CAN FD, which are not among the identifiers: no node of CANopen sends them.
        identifiers: their traffic, by identifier and whether it has 29 bits.
    """

    duration: float = 0.0
    bits: float = 0.0
    error_frames: int = 0
    fd_frames: int = 0
    identifiers: dict[tuple[int, bool], Traffic] = field(default_factory=dict)

    @property
    def frames(self) -> int:
        """All frames but error frames."""
        return self.fd_frames + sum(traffic.frames for traffic in self.identifiers.values())

    @property
    def extended(self) -> int:
        """Data frames with 29-bit identifiers."""
        return sum(row.frames for row in self.identifiers.values() if row.is_extended)

    def load(self, bitrate: int) -> float:
        """Return the share of the bus's time that was taken, at a bit rate [bit/s]."""
        return self.bits / (bitrate * self.duration) if self.duration > 0.0 else 0.0

    def take(self, message: can.Message) -> None:
        """Count one frame."""
        if message.is_error_frame:
            self.error_frames += 1
            return
        frame = frame_of(message)
        self.bits += 0.0 if frame is None else bits_of(frame)
        if message.is_fd:
            self.fd_frames += 1
            return
        key = (message.arbitration_id, message.is_extended_id)
        traffic = self.identifiers.setdefault(key, Traffic(*key))
        traffic.frames += 1
        traffic.data, traffic.is_remote = bytes(message.data), message.is_remote_frame


def listen(network: Network, duration: float) -> BusTraffic:
    """Return the traffic received within a time [s]; nothing is sent."""
    traffic = BusTraffic()
    network.observe = traffic.take
    begin = network.now()
    try:
        network.pump(duration)
    finally:
        network.observe = None
    traffic.duration = network.now() - begin
    return traffic


# Signs that a bus is in operation, so that nobody sends to it unasked.

_MOST_SIGNS = 6


def signs_of_operation(traffic: BusTraffic) -> tuple[str, ...]:
    """Return the frames heard that show a bus in operation, in a few words; empty for a quiet one.

    These are a node in OPERATIONAL, PDOs, SYNC, NMT commands, CAN FD, and SDO requests of another
    client, whose transfers a second client of the same channel would break.
    """
    rows = sorted(traffic.identifiers.items())
    signs = [sign for _, row in rows if not row.is_extended and (sign := _sign(row))]
    signs += ["CAN FD"] if traffic.fd_frames else []
    if len(signs) > _MOST_SIGNS:
        return (*signs[:_MOST_SIGNS], f"{len(signs) - _MOST_SIGNS} more")
    return tuple(signs)


def _sign(row: Traffic) -> str:
    name, node = row.function, row.node_id
    if row.is_remote:
        return ""
    if name == "heartbeat":
        is_operational = guarded_state(row.data) is NmtState.OPERATIONAL
        return f"node {node} is OPERATIONAL" if is_operational else ""
    if name in {"NMT", "SYNC"}:
        return name
    if name.startswith(("TPDO", "RPDO")):
        return f"{name} of node {node}"
    return f"another client reads or writes node {node}" if name == "SDO request" else ""
