"""A survey of a bus: its nodes, and those that LSS can give a node-ID."""

import struct
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import can

from hil_bench.abilities.commissioning import discovery
from hil_bench.abilities.commissioning.identity import NodeDescription, describe
from hil_drivers import Network

# Finds devices that have no node-ID yet, by the LSS fastscan (CiA 305).

_REQUEST, _ANSWER = 0x7E5, 0x7E4
_SWITCH_GLOBAL, _WAITING = 0x04, 0
_FASTSCAN, _IDENTIFIED = 0x51, 0x4F
_BEGIN = 0x80
_PARTS = 4
_MESSAGE = struct.Struct("<BIBBB")

PATIENCE = 0.05
"""Least time for the answer to one step, if more is not asked for [s]; CiA 305 leaves it to the
master."""

_MARGIN = 4
"""Times the slowest answer so far that the next steps wait: silence is an answer, too."""

SETTLING = 0.01
"""Time after the first answer for those of other devices [s], which must not pass for answers to
the next step."""

MOST_DEVICES = 127

_LONGER = "a longer --patience may find it"


class LssAddress(NamedTuple):
    """The LSS address of a device without node-ID: the four entries of 0x1018."""

    vendor_id: int
    product_code: int
    revision_number: int
    serial_number: int


class LssScan(NamedTuple):
    """Devices without node-ID.

    Attributes:
        devices: those whose address was found.
        problem: why others may be there; empty where all answers were understood.
    """

    devices: tuple[LssAddress, ...]
    problem: str = ""


class _Answers:
    def __init__(self, network: Network, patience: float) -> None:
        self.count = 0
        self.latest = 0
        self.slowest = 0.0
        self._network = network
        self._patience = patience
        network.subscribe(_ANSWER, self._take)

    def _take(self, data: bytes, _now: float) -> bool:
        if len(data) != 8 or data[0] != _IDENTIFIED:
            return False
        self.count += 1
        return True

    def come(self, number: int, bit: int, part: int, following: int, *, fully: bool) -> bool:
        """Ask, and return whether any device answers.

        Args:
            number: that the entry is compared with.
            bit: lowest one that is compared.
            part: of the address.
            following: part that comes next.
            fully: whether to wait as long as patience lasts, or as answers have taken so far.
        """
        before, asked = self.count, self._network.now()
        self._network.send(_REQUEST, _MESSAGE.pack(_FASTSCAN, number, bit, part, following))
        usual = min(self._patience, max(PATIENCE, _MARGIN * self.slowest))
        patience = self._patience if fully else usual
        has_come = self._network.wait_for(lambda: self.count > before, patience)
        if has_come:
            self.slowest = max(self.slowest, self._network.now() - asked)
            self._network.pump(SETTLING)
        self.latest = self.count - before
        return has_come

    def settle(self) -> None:
        """Let answers to earlier steps pass."""
        self._network.pump(self._patience)


def find_unconfigured(network: Network, patience: float = PATIENCE) -> LssScan:
    """Return the devices that wait for a node-ID; they wait on as before.

    A device that was found is in the LSS state CONFIGURATION, where it answers no further scan;
    at the end all are sent back to WAITING. One that answers all the same would be found for ever,
    so the scan ends where an address comes for the second time. To a whole address one device
    answers.

    Args:
        network: an open network.
        patience: longest time that a device has for its answer to one step [s].
    """
    answers = _Answers(network, patience)
    _return_to_waiting(network)
    found: list[LssAddress] = []
    problem = ""
    while len(found) < MOST_DEVICES and answers.come(0, _BEGIN, 0, 0, fully=True):
        address = _scan(answers)
        if address is None:
            problem = (
                "a device without node-ID answered, but not to all steps of the scan (slowest "
                f"answer {1000 * answers.slowest:.0f} ms, patience {1000 * patience:g} ms); "
                f"{_LONGER}"
            )
            break
        if address in found:
            problem = "a device without node-ID answers on after it was found, which hides others"
            if not any(address):
                found.remove(address)
                problem += "; it answers each step, so that its address is not known"
            break
        found.append(address)
        if answers.latest > 1:
            problem = (
                f"{answers.latest} devices without node-ID answer to serial number "
                f"0x{address.serial_number:08X} of one product: connect one at a time"
            )
    _return_to_waiting(network)
    if answers.count and not found and not problem:
        problem = (
            f"a device without node-ID answered later than the patience of {1000 * patience:g} ms; "
            f"{_LONGER}"
        )
    return LssScan(tuple(found), problem)


def _scan(answers: _Answers) -> LssAddress | None:
    """Return the address of a device that has answered, None where it is not found."""
    numbers = []
    for part in range(_PARTS):
        number = _scan_part(answers, part, fully=False)
        if number is None:  # perhaps for an answer that was late once
            answers.settle()
            number = _scan_part(answers, part, fully=True)
        if number is None:
            return None
        numbers.append(number)
    return LssAddress(*numbers)


def _scan_part(answers: _Answers, part: int, *, fully: bool) -> int | None:
    """Return one entry of the address, bit by bit; None if no device confirms it."""
    number = 0
    for bit in reversed(range(32)):
        # Whose entry agrees down to this bit, which is 0, answers; silence says that it is 1.
        if not answers.come(number, bit, part, part, fully=fully):
            number |= 1 << bit
    following = (part + 1) % _PARTS
    return number if answers.come(number, 0, part, following, fully=True) else None


def _return_to_waiting(network: Network) -> None:
    network.send(_REQUEST, bytes([_SWITCH_GLOBAL, _WAITING, 0, 0, 0, 0, 0, 0]))
    network.pump(PATIENCE)


# Heartbeats that do not fit what a node says of its own: those of another one, perhaps.


class _Heartbeats:
    """Takes the heartbeats of all nodes, with their times.

    A node that a master guards has no heartbeat, though its answers look like one.

    Args:
        clock: of the network [s].
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._times: dict[int, list[float]] = defaultdict(list)
        self._guarded: set[int] = set()

    def take(self, message: can.Message) -> None:
        """Take one frame."""
        node_id = message.arbitration_id - discovery.ERROR_CONTROL
        if message.is_extended_id or message.is_error_frame or node_id not in discovery.NODE_IDS:
            return
        if message.is_remote_frame:
            self._guarded.add(node_id)
        elif bytes(message.data) == b"\0":  # a boot-up: its period begins anew
            self._times[node_id].clear()
        else:
            self._times[node_id].append(self._clock())

    def misfit(self, node: NodeDescription) -> str:
        """Say why the heartbeats heard do not fit 0x1017 of a node; empty where they do."""
        times = self._times[node.node_id]
        if node.heartbeat_ms is None or node.node_id in self._guarded or not times:
            return ""
        if node.heartbeat_ms == 0:
            return f"a heartbeat came, though 0x1017 is 0: {_PERHAPS_TWICE}"
        if len(times) < _FEWEST_BEATS:
            return ""
        period = 1000.0 * (times[-1] - times[0]) / (len(times) - 1)
        if period + 1000.0 * _LATENESS / (len(times) - 1) > _SHORTEST * node.heartbeat_ms:
            return ""
        said = f"0x1017 is {node.heartbeat_ms} ms"
        return f"a heartbeat came every {period:.0f} ms, though {said}: {_PERHAPS_TWICE}"


_PERHAPS_TWICE = "another device may have this node-ID, too"
_FEWEST_BEATS = 3
_SHORTEST = 0.7
"""Share of its period that is too short for the mean distance of some heartbeats of one node."""
_LATENESS = 0.3
"""By how much the first of them may come late, so that the others seem to come faster [s]."""


# All that a scan of a bus finds.


@dataclass(frozen=True, slots=True)
class Survey:
    """The findings of a scan.

    Attributes:
        nodes: in the order of their node-IDs.
        unconfigured: devices that wait for a node-ID; None where nobody asked.
        traffic: on the bus while the nodes were looked for, the scan's own frames included.
        operation: signs that the bus is in operation, for which nothing was sent; empty where the
            nodes were asked.
        doubtful: node-IDs whose heartbeats do not fit 0x1017, as where two devices have them.
    """

    nodes: tuple[NodeDescription, ...]
    unconfigured: LssScan | None
    traffic: discovery.BusTraffic
    operation: tuple[str, ...] = ()
    doubtful: tuple[int, ...] = ()


def survey(
    network: Network,
    method: discovery.Method,
    *,
    node_ids: Iterable[int] = discovery.NODE_IDS,
    patience: float = 1.0,
    lss: bool = False,
    insists: bool = False,
) -> Survey:
    """Listen to a bus, then ask its nodes; one that is in operation is listened to only.

    Args:
        network: an open network.
        method: how the nodes are made to show themselves.
        node_ids: those to look for.
        patience: time to listen before the first request and after the last, and for each answer
            of LSS [s].
        lss: whether to look for devices without node-ID, too.
        insists: whether to ask a bus in operation, too.
    """
    wanted = list(node_ids)
    heartbeats = _Heartbeats(network.now)
    heard, traffic = _observed(network, discovery.Method.HEARTBEAT, wanted, patience, heartbeats)
    if method is not discovery.Method.HEARTBEAT or lss:
        operation = () if insists else discovery.signs_of_operation(traffic)
        if operation:
            return Survey(tuple(map(_only_heard, heard)), None, traffic, operation)
    sightings = heard
    if method is not discovery.Method.HEARTBEAT:
        sightings, traffic = _observed(network, method, wanted, patience, heartbeats)
        states = {seen.node_id: seen.nmt_state for seen in heard}
        found = {seen.node_id for seen in sightings}
        sightings = sorted(
            [s._replace(nmt_state=s.nmt_state or states.get(s.node_id)) for s in sightings]
            + [seen for seen in heard if seen.node_id not in found]
        )
    nodes = [describe(network, sighting) for sighting in sightings]
    misfits = {node.node_id: misfit for node in nodes if (misfit := heartbeats.misfit(node))}
    if method is discovery.Method.GUARDING:  # the answers are no heartbeats
        misfits.clear()
    described = tuple(
        replace(node, problem=node.problem or misfits.get(node.node_id, "")) for node in nodes
    )
    unconfigured = find_unconfigured(network, patience) if lss else None
    return Survey(described, unconfigured, traffic, doubtful=tuple(misfits))


def _observed(
    network: Network,
    method: discovery.Method,
    node_ids: list[int],
    patience: float,
    heartbeats: _Heartbeats,
) -> tuple[list[discovery.Sighting], discovery.BusTraffic]:
    """Look for nodes, and return them with the traffic meanwhile."""
    traffic = discovery.BusTraffic()

    def take(message: can.Message) -> None:
        traffic.take(message)
        heartbeats.take(message)

    network.observe = take
    begin = network.now()
    try:
        sightings = discovery.discover(network, method, node_ids=node_ids, patience=patience)
    finally:
        network.observe = None
    traffic.duration = network.now() - begin
    return sightings, traffic


def _only_heard(sighting: discovery.Sighting) -> NodeDescription:
    """Describe a node by its heartbeat alone."""
    state = sighting.nmt_state
    name = None if state is None else state.name
    return NodeDescription(sighting.node_id, name, clash=False, problem="not asked, only heard")
