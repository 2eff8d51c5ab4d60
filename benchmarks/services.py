"""Cost per CANopen service, frames fed directly, beside canopen.LocalNode and durand in one run.

    pip install '.[benchmark]'
    python benchmarks/services.py [--repeats N]

Every responder has the same objects, gets the same frames and must give the same answers; the three
take turns. Ours is asked for PDOs and answers after each frame. What a round of it costs besides,
once for all frames of a tick, is the last line.
What a library does not do by itself is done for it by the few lines that a user of it would write,
and marked, or left out.
"""

import argparse
import logging
import platform
import statistics
import struct
import time
from binascii import crc_hqx
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

import canopen
from canopen.pdo.base import PdoMap

from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.node import Node

try:
    import durand
    from durand.datatypes import DatatypeEnum
    from durand.network import NetworkABC
    from durand.node import MinimalNode
    from durand.object_dictionary import ObjectDictionary, Variable
except ImportError:
    durand = None
    NetworkABC = object

EDS = Path(__file__).parents[1] / "tests" / "unit" / "canopen_device" / "device.eds"
NODE_ID = 5
TICK = 1_000_000  # [ns]
KILOBYTE = bytes(number % 251 for number in range(1000))
FILE = bytes(number % 251 for number in range(65536))
SEGMENTS = -(-len(FILE) // 7)
NUMBERS = {0x2000: 0x06, 0x2001: 0x03, 0x2010: 0x06, 0x2011: 0x03}  # UNSIGNED16 and INTEGER16

Answers = list[Sequence[Any]]
"""Identifier and data first."""


class Responder(Protocol):
    """A CANopen device without a bus."""

    answers: Answers

    def feed(self, can_id: int, data: bytes) -> None:
        """Give it one frame."""

    def drain(self) -> None:
        """Let it send what it has still to send."""

    def get(self, index: int) -> int:
        """Return the value of an object, as its application does."""

    def put(self, index: int, value: int) -> None:
        """Set the value of an object, as its application does."""


class Ours:
    """A node of this project, a round a frame."""

    def __init__(self) -> None:
        self.answers: Answers = []
        self._emit = self.answers.append
        self._now = TICK
        self.node = Node(load_eds(EDS, NODE_ID), NODE_ID)
        self.node.object_dictionary.variable(0x2021).value = FILE
        self.node.object_dictionary.variable(0x2025).value = KILOBYTE
        self.node.start(self._now)
        self.drain()
        for request in (
            "2f00180201000000",  # TPDO1 with each SYNC,
            "23011801850200c0",  # and no other
            "23021801850300c0",
        ):
            self.feed(0x605, bytes.fromhex(request))
        self.feed(0x000, b"\x01\x05")

    def feed(self, can_id: int, data: bytes) -> None:  # noqa: D102
        node, now, emit = self.node, self._now, self._emit
        node.receive(Frame(can_id, data), now)
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
        self.answers: Answers = []
        self._network = canopen.Network()
        self._network.send_message = self._send  # type: ignore[method-assign]
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
        size = "<H" if NUMBERS[index] == 0x06 else "<h"
        return int(struct.unpack(size, self._node.get_data(index, 0))[0])

    def put(self, index: int, value: int) -> None:  # noqa: D102
        self._node.tpdo[1][index - 0x2010].raw = value

    def _store(self, mapping: PdoMap) -> None:
        for variable in mapping:
            self._node.set_data(variable.index, variable.subindex, bytes(variable.data))

    def _send(self, can_id: int, data: bytes, remote: bool = False) -> None:  # noqa: ARG002
        self.answers.append((can_id, data))


class _Exchange(NetworkABC):
    """What durand sends and receives by."""

    def __init__(self, answers: Answers) -> None:
        self.callbacks: dict[int, Callable[[int, bytes], None]] = {}
        self._answers = answers

    def add_subscription(self, cob_id: int, callback: Callable[[int, bytes], None]) -> None:
        self.callbacks[cob_id] = callback

    def remove_subscription(self, cob_id: int, _callback: object = None) -> None:
        self.callbacks.pop(cob_id, None)

    def send(self, cob_id: int, msg: bytes) -> None:
        self._answers.append((cob_id, msg))


class Durand:
    """`durand.MinimalNode`; its objects are made by hand, for it reads no EDS."""

    def __init__(self) -> None:
        self.answers: Answers = []
        self._exchange = _Exchange(self.answers)
        objects = ObjectDictionary()
        for index, code in NUMBERS.items():
            objects[index] = Variable(DatatypeEnum(code), "rw", 0)
        objects[0x2021] = Variable(DatatypeEnum.DOMAIN, "rw", FILE)
        objects[0x2025] = Variable(DatatypeEnum.OCTET_STRING, "rw", KILOBYTE)
        self._node = MinimalNode(self._exchange, NODE_ID, objects)
        self._node.rpdo[0].mapping = [(0x2000, 0), (0x2001, 0)]
        self._node.tpdo[0].mapping = [(0x2010, 0), (0x2011, 0)]
        self._node.tpdo[0].transmission_type = 1
        self.feed(0x000, b"\x01\x05")

    def feed(self, can_id: int, data: bytes) -> None:  # noqa: D102
        callback = self._exchange.callbacks.get(can_id)
        if callback is not None:
            callback(can_id, data)

    def drain(self) -> None:
        """Nothing is left: it answers within `feed`."""

    def get(self, index: int) -> int:  # noqa: D102
        return int(self._node.object_dictionary.read(index, 0))

    def put(self, index: int, value: int) -> None:  # noqa: D102
        self._node.object_dictionary.write(index, 0, value)


def expedited_upload(responder: Responder) -> None:
    """Read 1000h."""
    responder.feed(0x605, b"\x40\x00\x10\x00\0\0\0\0")


def is_expedited_upload_right(responder: Responder) -> bool:
    """Judge the answers."""
    return responder.answers[-1][1][:4] == b"\x43\x00\x10\x00"


SEGMENTED_REQUESTS = [bytes.fromhex("4025200000000000")] + [
    bytes([0x60 | (number & 1) << 4, *bytes(7)]) for number in range(-(-len(KILOBYTE) // 7))
]


def segmented_upload(responder: Responder) -> None:
    """Read 1000 bytes in segments."""
    for request in SEGMENTED_REQUESTS:
        responder.feed(0x605, request)


def is_segmented_upload_right(responder: Responder) -> bool:
    """Judge the answers."""
    segments = [answer[1][1:] for answer in responder.answers[-len(SEGMENTED_REQUESTS) + 1 :]]
    return b"".join(segments)[: len(KILOBYTE)] == KILOBYTE


FULL_BLOCKS, LAST_BLOCK = divmod(SEGMENTS, 127)
BLOCK_UPLOAD_REQUESTS = [
    bytes.fromhex("a42120007f000000"),
    bytes([0xA3, *bytes(7)]),
    *[bytes([0xA2, 127, 127, *bytes(5)])] * FULL_BLOCKS,
    bytes([0xA2, LAST_BLOCK, 127, *bytes(5)]),
]
BLOCK_UPLOAD_END = bytes([0xA1, *bytes(7)])


def block_upload(responder: Responder) -> None:
    """Read 64 KiB in sub-blocks of 127 segments."""
    for request in BLOCK_UPLOAD_REQUESTS:
        responder.feed(0x605, request)
        responder.drain()
    responder.feed(0x605, BLOCK_UPLOAD_END)


def is_block_upload_right(responder: Responder) -> bool:
    """Judge the answers."""
    *rest, end = responder.answers
    data = b"".join(answer[1][1:] for answer in rest[-SEGMENTS:])[: len(FILE)]
    return data == FILE and end[1][1:3] == struct.pack("<H", crc_hqx(FILE, 0))


def _block_download_requests() -> list[bytes]:
    requests = [b"\xc6\x21\x20\x00" + struct.pack("<I", len(FILE))]
    for number in range(SEGMENTS):
        last = 0x80 if number == SEGMENTS - 1 else 0
        chunk = FILE[7 * number : 7 * number + 7].ljust(7, b"\0")
        requests.append(bytes([last | number % 127 + 1]) + chunk)
    unused = -len(FILE) % 7
    return [*requests, struct.pack("<BH5x", 0xC1 | unused << 2, crc_hqx(FILE, 0))]


BLOCK_DOWNLOAD_REQUESTS = _block_download_requests()


def block_download(responder: Responder) -> None:
    """Write 64 KiB in sub-blocks of 127 segments."""
    for request in BLOCK_DOWNLOAD_REQUESTS:
        responder.feed(0x605, request)


def is_block_download_right(responder: Responder) -> bool:
    """Judge the answers."""
    return responder.answers[-1][1][0] == 0xA1


def rpdo(responder: Responder) -> None:
    """Bring two values to their objects."""
    responder.feed(0x205, b"\x07\x00\x0c\xfe")


def is_rpdo_right(responder: Responder) -> bool:
    """Judge the answers."""
    return (responder.get(0x2000), responder.get(0x2001)) == (7, -500)


def sync(responder: Responder) -> None:
    """Set two objects, and have the TPDO that carries them sent by SYNC."""
    responder.put(0x2010, 7)
    responder.put(0x2011, -500)
    responder.feed(0x080, b"")


def is_sync_right(responder: Responder) -> bool:
    """Judge the PDO."""
    (answer,) = responder.answers
    return answer[0] == 0x185 and answer[1] == b"\x07\x00\x0c\xfe"


Service = tuple[str, Callable[[Responder], None], Callable[[Responder], bool], int]

SERVICES: list[Service] = [
    ("SDO expedited upload", expedited_upload, is_expedited_upload_right, 5000),
    ("SDO segmented upload, 1000 bytes", segmented_upload, is_segmented_upload_right, 50),
    ("SDO block upload, 64 KiB", block_upload, is_block_upload_right, 1),
    ("SDO block download, 64 KiB", block_download, is_block_download_right, 1),
    ("RPDO, two objects", rpdo, is_rpdo_right, 5000),
    ("two objects set, SYNC, TPDO", sync, is_sync_right, 5000),
]


def does(responder: Responder, service: Service) -> bool:
    """Return whether a responder does a service at all, and rightly."""
    _, run, is_right, _ = service
    responder.answers.clear()
    run(responder)
    try:
        return is_right(responder)
    except (IndexError, ValueError, struct.error):
        return False


def cost(responder: Responder, service: Service) -> float:
    """Return the time for one service [us]."""
    _, run, is_right, count = service
    begin = time.perf_counter_ns()
    for _ in range(count):
        responder.answers.clear()
        run(responder)
    elapsed = time.perf_counter_ns() - begin
    assert is_right(responder)  # noqa: S101 - a benchmark of something else is worth nothing
    return elapsed / count / 1e3


def idle_round() -> float:
    """Return the time for a round of ours in which nothing is due [us]."""
    node = Ours().node
    emit = [].append
    count = 20_000
    begin = time.perf_counter_ns()
    for _ in range(count):
        node.expire(TICK)
        node.transmit_pdos(TICK, emit)
        node.serve(TICK, emit)
    return (time.perf_counter_ns() - begin) / count / 1e3


def main() -> None:
    """Print the figures as a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=15)
    args = parser.parse_args()
    logging.disable(logging.CRITICAL)
    makers: dict[str, Callable[[], Responder]] = {"here": Ours, "`canopen.LocalNode`": LocalNode}
    if durand is not None:
        makers["`durand`"] = Durand
    responders = {name: maker() for name, maker in makers.items()}
    able = {
        (name, service[0])
        for name, maker in makers.items()
        for service in SERVICES
        if does(maker(), service)
    }
    times: dict[tuple[str, str], list[float]] = {key: [] for key in able}
    for _ in range(args.repeats):
        for service in SERVICES:
            for name, responder in responders.items():
                if (name, service[0]) in able:
                    times[name, service[0]].append(cost(responder, service))
    print(f"{platform.machine()}, Python {platform.python_version()}, medians of {args.repeats}\n")
    print(f"| service [us] | {' | '.join(makers)} | here / fastest other |")
    print(f"|---|{'---|' * len(makers)}---|")
    for title, *_ in SERVICES:
        medians = {n: statistics.median(times[n, title]) for n in makers if (n, title) in able}
        cells = [f"{medians[name]:.2f}" if name in medians else "does not" for name in makers]
        others = [median for name, median in medians.items() if name != "here"]
        ratio = f"{medians['here'] / min(others):.2f}" if others else "–"
        print(f"| {title} | {' | '.join(cells)} | {ratio} |")
    print(f"\nA round of a node in which nothing is due: {idle_round():.2f} us.")


if __name__ == "__main__":
    main()
