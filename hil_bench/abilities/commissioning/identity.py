"""Reads what a node says of itself, without an EDS."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from hil_bench.abilities.commissioning.discovery import ERROR_CONTROL, Sighting, guarded_state
from hil_bench.errors import printable
from hil_drivers import (
    DriverTimeoutError,
    Network,
    NmtState,
    Node,
    RemoteProtocolError,
    SdoAbortError,
)
from hil_drivers.node import object_name

PROFILES = {
    0: "no standard profile",
    401: "I/O module",
    402: "drive",
    404: "measuring device",
    405: "programmable device",
    406: "encoder",
    408: "proportional valve",
    410: "inclinometer",
}
"""What the number of a device profile stands for: the low word of 0x1000 (CiA 301)."""

_HISTORY_LIMIT = 254

_SDO_REQUEST, _SDO_ANSWER = 0x600, 0x580
_SDO_BYTES = 8
_INITIATED = 2
"""Command specifier of the first answer to an upload, which names the object (CiA 301)."""

MOST_BYTES = 1024
"""Bytes that one entry of an identity brings at most; names and versions are texts of a line."""

LONGEST_READING = 10.0
"""Time after which no more is read of a node that goes on answering slowly [s]."""


_TWICE = (
    "two devices answer, perhaps of two benches on one bus, and their words cannot be told apart: "
    "give each a node-ID of its own"
)

GUARDING_PATIENCE = 0.1
"""Longest wait for the answer to a guarding request [s]."""


@dataclass(frozen=True, slots=True)
class NodeDescription:
    """The description that a node gives of itself; None for missing or refused objects.

    Attributes:
        node_id: its node-ID.
        nmt_state: name of its NMT state.
        clash: whether more than one node answered under this node-ID.
        device_type: 0x1000.
        vendor_id: 0x1018.01.
        product_code: 0x1018.02.
        revision_number: 0x1018.03.
        serial_number: 0x1018.04.
        device_name: 0x1008.
        hardware_version: 0x1009.
        software_version: 0x100A.
        error_register: 0x1001.
        error_history: 0x1003, newest first; None if unknown.
        heartbeat_ms: 0x1017, period of its heartbeat; 0 for none [ms].
        problem: why it tells nothing, or no more than this; empty where it does.
    """

    node_id: int
    nmt_state: str | None
    clash: bool
    device_type: int | None = None
    vendor_id: int | None = None
    product_code: int | None = None
    revision_number: int | None = None
    serial_number: int | None = None
    device_name: str | None = None
    hardware_version: str | None = None
    software_version: str | None = None
    error_register: int | None = None
    error_history: tuple[int, ...] | None = None
    heartbeat_ms: int | None = None
    problem: str = ""

    @property
    def profile(self) -> str | None:
        """The device profile in words."""
        if self.device_type is None:
            return None
        number = self.device_type & 0xFFFF
        meaning = PROFILES.get(number)
        return f"CiA {number}, {meaning}" if number and meaning else meaning or f"CiA {number}"


def describe(network: Network, sighting: Sighting, *, timeout: float = 0.5) -> NodeDescription:
    """Return a node's description of itself; empty where two nodes answer.

    Args:
        network: the network that the node was seen on.
        sighting: of the node.
        timeout: longest wait for each answer [s]; the first that is missing ends the reading.
    """
    if sighting.answers > 1:
        state = sighting.nmt_state
        return NodeDescription(
            sighting.node_id, None if state is None else state.name, clash=True, problem=_TWICE
        )
    node = network.nodes.get(sighting.node_id)
    if node is None:
        node = network.add_node(sighting.node_id, sdo_timeout=timeout)
    facts: dict[str, object] = {}
    answers = _Answers(network, sighting.node_id)
    reading = _Reading(node, network)
    try:
        for name, read in _READERS.items():
            facts[name] = read(reading)
    except (DriverTimeoutError, RemoteProtocolError) as error:
        facts["problem"] = str(error)
    else:
        if all(fact in (None, ()) for fact in facts.values()):
            facts["problem"] = "every read is answered by an abort"
    state = node.nmt_state if node.nmt_state is not None else sighting.nmt_state
    if answers.are_of_two:
        return NodeDescription(
            sighting.node_id, None if state is None else state.name, clash=True, problem=_TWICE
        )
    if state is None and not facts.get("problem") and not facts["heartbeat_ms"]:
        state = _guarded_state(reading, sighting.node_id, network)
    return NodeDescription(
        node_id=sighting.node_id,
        nmt_state=None if state is None else state.name,
        clash=False,
        **facts,  # type: ignore[arg-type]  # each reader returns its field's type
    )


def _guarded_state(reading: "_Reading", node_id: int, network: Network) -> NmtState | None:
    """Ask a node without heartbeat for its NMT state by node guarding, where that begins nothing.

    A node with 0x100C and 0x100D set would wait for further requests, and is not asked.
    """
    try:
        guard_time, life_time_factor = reading.number(0x100C), reading.number(0x100D)
    except (DriverTimeoutError, RemoteProtocolError):
        return None
    if guard_time is None or (guard_time and life_time_factor):
        return None
    found: list[NmtState] = []

    def take(data: bytes, _now: float) -> bool:
        state = guarded_state(data)
        if state is not None:
            found.append(state)
        return state is not None

    network.subscribe(ERROR_CONTROL + node_id, take)
    network.request(ERROR_CONTROL + node_id, 1)
    network.wait_for(lambda: bool(found), GUARDING_PATIENCE)
    return found[-1] if found else None


class _Answers:
    """Counts the answers to each read of a node: each object is read once.

    Two devices of one type may have the same 0x1000; their frames are then one on the bus. Another
    object, such as the serial number, has two answers.
    """

    def __init__(self, network: Network, node_id: int) -> None:
        self._counts: Counter[bytes] = Counter()
        self._others = False
        network.subscribe(_SDO_ANSWER + node_id, self._take)
        network.subscribe(_SDO_REQUEST + node_id, self._take_request)

    @property
    def are_of_two(self) -> bool:
        """Return True if one read had two answers, and no other client read meanwhile."""
        return not self._others and any(count > 1 for count in self._counts.values())

    def _take(self, data: bytes, _now: float) -> bool:
        if len(data) == _SDO_BYTES and data[0] >> 5 == _INITIATED:
            self._counts[data[1:4]] += 1
        return True

    def _take_request(self, _data: bytes, _now: float) -> bool:
        self._others = True
        return True


class _Reading:
    """The reading of a node, within bounds that no honest node meets."""

    def __init__(self, node: Node, network: Network) -> None:
        self._node = node
        self._network = network
        self._deadline = network.now() + LONGEST_READING

    def number(self, index: int, subindex: int = 0) -> int | None:
        """Return an unsigned number; None if the node refuses it."""
        raw = self._read(index, subindex)
        return None if raw is None else int.from_bytes(raw[:8], "little")

    def text(self, index: int) -> str | None:
        """Return a VISIBLE_STRING with what is unprintable escaped; None if the node refuses it."""
        raw = self._read(index, 0)
        if raw is None:
            return None
        text = raw.split(b"\0", 1)[0].decode("latin-1").strip()
        return printable(text)

    def history(self) -> tuple[int, ...] | None:
        """Return 0x1003, newest first; None if the node refuses it."""
        count = self.number(0x1003)
        if count is None:
            return None
        codes = []
        for subindex in range(1, min(count, _HISTORY_LIMIT) + 1):
            code = self.number(0x1003, subindex)
            if code is None:
                break
            codes.append(code)
        return tuple(codes)

    def _read(self, index: int, subindex: int) -> bytes | None:
        """Return the bytes of an object; None if the node refuses it.

        Raises:
            DriverTimeoutError: the time for all is over.
        """
        sdo = self._node.sdo
        bounds = sdo.most_bytes, sdo.longest_transfer
        sdo.most_bytes = MOST_BYTES
        sdo.longest_transfer = max(self._deadline - self._network.now(), 0.0)
        try:
            return self._node.upload(index, subindex)
        except SdoAbortError:
            return None
        except DriverTimeoutError as error:
            if self._network.now() < self._deadline:
                raise
            told = (
                f"has not answered all in {LONGEST_READING:g} s; {object_name(index, subindex)} was"
            )
            raise DriverTimeoutError(f"{self._node}: {told} the last") from error
        finally:
            sdo.most_bytes, sdo.longest_transfer = bounds


def _number(index: int, subindex: int = 0) -> Callable[[_Reading], int | None]:
    return lambda reading: reading.number(index, subindex)


def _text(index: int) -> Callable[[_Reading], str | None]:
    return lambda reading: reading.text(index)


_READERS: dict[str, Callable[[_Reading], object]] = {
    "device_type": _number(0x1000),
    "vendor_id": _number(0x1018, 1),
    "product_code": _number(0x1018, 2),
    "revision_number": _number(0x1018, 3),
    "serial_number": _number(0x1018, 4),
    "device_name": _text(0x1008),
    "hardware_version": _text(0x1009),
    "software_version": _text(0x100A),
    "error_register": _number(0x1001),
    "error_history": _Reading.history,
    "heartbeat_ms": _number(0x1017),
}
