"""One device three times, without a bus: here, as `canopen.LocalNode` and as `durand.MinimalNode`.

What a library does not do by itself is done for it by the few lines that a user of it would write.
"""

import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

import canopen
from canopen.pdo.base import PdoMap

from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame, make_frame
from hil_bench.canopen_device.node import Node
from peers import CanopenNetwork, DurandNetwork

try:
    import durand
    from durand.datatypes import DatatypeEnum
    from durand.node import MinimalNode
    from durand.object_dictionary import ObjectDictionary, Variable
except ImportError:  # of the extra `benchmark`
    durand = None

EDS = Path(__file__).parents[1] / "tests" / "unit" / "canopen_device" / "device.eds"
NODE_ID = 5
TICK = 1_000_000  # [ns]
KILOBYTE = bytes(number % 251 for number in range(1000))
"""Value of the OCTET_STRING 0x2025."""
FILE = bytes(number % 251 for number in range(65536))
"""Value of the DOMAIN 0x2021."""

_FORMATS = {0x2000: "<H", 0x2001: "<h", 0x2010: "<H", 0x2011: "<h"}
"""The numbers that the PDOs carry: UNSIGNED16 and INTEGER16, two in RPDO1, two in TPDO1."""


class Responder(Protocol):
    """A CANopen device without a bus.

    Attributes:
        answers: the frames that it sent, identifier and data first.
    """

    answers: Sequence[Sequence[Any]]

    def feed(self, can_id: int, data: bytes) -> None:
        """Give it one frame."""

    def drain(self) -> None:
        """Let it send what it has still to send."""

    def forget(self) -> None:
        """Forget the answers."""

    def get(self, index: int) -> int:
        """Return the value of an object, as its application does."""

    def put(self, index: int, value: int) -> None:
        """Set the value of an object, as its application does."""


class Ours:
    """A node of this project, a round a frame."""

    def __init__(self) -> None:
        self.answers: list[Frame] = []
        self.node = Node(load_eds(EDS, NODE_ID), NODE_ID)
        self._emit = self.answers.append
        self.forget = self.answers.clear
        self._now = TICK
        self.node.object_dictionary.variable(0x2021).value = FILE
        self.node.object_dictionary.variable(0x2025).value = KILOBYTE
        self.node.start(self._now)
        self.drain()
        for request in (
            "2f00180201000000",  # TPDO1 with each SYNC,
            "23011801850200c0",  # and no other
            "23021801850300c0",
        ):
            self.feed(0x600 + NODE_ID, bytes.fromhex(request))
        self.feed(0x000, bytes([1, NODE_ID]))

    def feed(self, can_id: int, data: bytes) -> None:  # noqa: D102 - told by the protocol
        node, now, emit = self.node, self._now, self._emit
        node.receive(make_frame(Frame, (can_id, data, False, False, 0, 0)), now)
        node.transmit_pdos(now, emit)
        node.serve(now, emit)

    def drain(self) -> None:  # noqa: D102
        before = -1
        while before != len(self.answers):
            before = len(self.answers)
            self.node.serve(self._now, self._emit)

    def get(self, index: int) -> int:  # noqa: D102
        return int(self.node.object_dictionary.variable(index).value)

    def put(self, index: int, value: int) -> None:  # noqa: D102
        self.node.object_dictionary.variable(index).value = value


class LocalNode:
    """`canopen.LocalNode`, whose RPDOs and TPDOs its user has to carry."""

    def __init__(self) -> None:
        self._network = CanopenNetwork()
        self.answers = self._network.sent
        self.forget = self.answers.clear
        self._node = canopen.LocalNode(NODE_ID, str(EDS))
        self._node.associate_network(self._network)
        self._node.set_data(0x2021, 0, FILE)
        self._node.set_data(0x2025, 0, KILOBYTE)
        self._node.rpdo.read()
        self._node.tpdo.read()
        self._node.rpdo[1].add_callback(self._store)
        self._network.subscribe(0x080, lambda *_: self._node.tpdo[1].transmit())

    def feed(self, can_id: int, data: bytes) -> None:  # noqa: D102
        self._network.notify(can_id, bytearray(data), 0.0)

    def drain(self) -> None:
        """Nothing is left: it answers within `feed`."""

    def get(self, index: int) -> int:  # noqa: D102
        return int(struct.unpack(_FORMATS[index], self._node.get_data(index, 0))[0])

    def put(self, index: int, value: int) -> None:  # noqa: D102
        self._node.tpdo[1][index - 0x2010].raw = value

    def _store(self, mapping: PdoMap) -> None:
        for variable in mapping:
            self._node.set_data(variable.index, variable.subindex, bytes(variable.data))


class Durand:
    """`durand.MinimalNode`; its objects are made by hand, for it reads no EDS."""

    def __init__(self) -> None:
        self._network = DurandNetwork()
        self.answers = self._network.sent
        self.forget = self.answers.clear
        self.feed = self._network.notify
        objects = ObjectDictionary()
        for index, letter in _FORMATS.items():
            data_type = DatatypeEnum.UNSIGNED16 if letter == "<H" else DatatypeEnum.INTEGER16
            objects[index] = Variable(data_type, "rw", 0)
        objects[0x2021] = Variable(DatatypeEnum.DOMAIN, "rw", FILE)
        objects[0x2025] = Variable(DatatypeEnum.OCTET_STRING, "rw", KILOBYTE)
        self._node = MinimalNode(self._network, NODE_ID, objects)
        self._node.rpdo[0].mapping = [(0x2000, 0), (0x2001, 0)]
        self._node.tpdo[0].mapping = [(0x2010, 0), (0x2011, 0)]
        self._node.tpdo[0].transmission_type = 1
        self.feed(0x000, bytes([1, NODE_ID]))

    def drain(self) -> None:
        """Nothing is left: it answers within `feed`."""

    def get(self, index: int) -> int:  # noqa: D102
        return int(self._node.object_dictionary.read(index, 0))

    def put(self, index: int, value: int) -> None:  # noqa: D102
        self._node.object_dictionary.write(index, 0, value)


def responder_makers() -> dict[str, Callable[[], Responder]]:
    """Return the makers of the installed responders, by name; ours first."""
    makers: dict[str, Callable[[], Responder]] = {"here": Ours, "`canopen.LocalNode`": LocalNode}
    if durand is not None:
        makers["`durand`"] = Durand
    return makers
