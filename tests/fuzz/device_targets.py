"""Frames for the devices: whatever comes, nothing is raised and every answer is a legal frame."""

import math
from pathlib import Path

from fuzz.script import Script
from support.bus_side import BusSide

from hil_bench.abilities.j1939.ecus import EcuTable
from hil_bench.abilities.j1939.protocol.signals import GLOBAL, join
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import load_config
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.node import Node

NODE_ID = 5
EDS = Path(__file__).parents[1] / "unit/canopen_device/device.eds"
MOST_STEPS = 60

# What a script may send without spelling the identifier: NMT, SYNC, TIME, SDO, LSS, PDOs,
# heartbeats and remote requests; 0xFF takes the identifier from the script.
_COB_IDS = (0x000, 0x080, 0x100, 0x605, 0x605, 0x605, 0x7E5, 0x205, 0x305, 0x185, 0x285, 0x705)
_OTHERS = (0x701, 0x77F, 0x405, 0x505, 0x085, 0x7E4, 0x6E0)


def _frame(script: Script, kind: int) -> Frame:
    places = _COB_IDS + _OTHERS
    can_id = places[kind % 0x20] if kind % 0x20 < len(places) else script.number(2) & 0x7FF
    is_remote = bool(kind & 0x40)
    data = b"" if is_remote else script.take(script.number() % 9)
    return Frame(can_id, data, is_remote=is_remote)


def _node(data: bytes, node_id: int) -> None:
    script, sent = Script(data), list[Frame]()
    node = Node(load_eds(EDS, node_id), node_id)
    now = 0
    node.start(now)
    for kind in script.steps(MOST_STEPS):
        node.receive(_frame(script, kind), now)
        if kind & 0x80:
            now += script.number() * 10_000_000
        node.expire(now)
        node.transmit_pdos(now, sent.append)
        node.serve(now, sent.append)
        assert len(sent) < 300, "more than a node may send in a round"
        for frame in sent:
            assert 0 <= frame.can_id <= 0x7FF
            assert len(frame.data) <= 8
        sent.clear()


def node(data: bytes) -> None:
    """A node with every service: SDO, PDO, NMT, SYNC, EMCY, LSS, heartbeat, guarding, TIME."""
    _node(data, NODE_ID)


def unconfigured_node(data: bytes) -> None:
    """A node that waits for its node-ID by LSS."""
    _node(data, 255)


def bench(data: bytes) -> None:
    """The built-in bench: valve, transducers and encoder in front of the plant."""
    script, side = Script(data), BusSide(_CONFIG)
    for kind in script.steps(MOST_STEPS):
        frame = _frame(script, kind)
        if frame.can_id > 0x80:  # for one of the nodes 1 to 4
            frame = frame._replace(can_id=frame.can_id & ~0x7F | kind % 4 + 1)
        side.tick(frame, count=1 + script.number() % 4 if kind & 0x80 else 1)
    seen = side.plant.output
    assert all(map(math.isfinite, seen)), seen
    assert len(side.log) <= 20 * side.now // 1_000_000


# Requests, acknowledgements, transport, claims, commanded address, diagnostics, valve commands.
_GROUPS = (0xEA00, 0xE800, 0xEC00, 0xEC00, 0xEB00, 0xEB00, 0xEE00, 0xFED8, 0xFECA, 0xFECC, 0xFE30)
_ADDRESSES = (128, 19, 140, GLOBAL)


def ecus(data: bytes) -> None:
    """J1939 devices: a valve driver, a joystick and sensors by table, without the plant."""
    script, sent = Script(data), list[Frame]()
    stations = build_bench(_J1939).part(EcuTable).segments[0].stations
    now = 0
    for station in stations:
        station.ecu.start(now)
    for kind in script.steps(MOST_STEPS):
        place, source = kind & 0xF, script.number()
        group = _GROUPS[place] if place < len(_GROUPS) else script.number(3) & 0x3FFFF
        can_id = join(6, group, source, _ADDRESSES[kind >> 4 & 3])
        frame = Frame(can_id, script.take(8), is_extended=True)
        if kind & 0x80:
            now += script.number() * 10_000_000
        for station in stations:
            station.ecu.receive(frame, now)
            station.ecu.serve(now, sent.append)
        assert len(sent) < 300, "more than three devices may send in a round"
        for answer in sent:
            assert answer.is_extended
            assert 0 <= answer.can_id < 1 << 29
            assert len(answer.data) <= 8
        sent.clear()


_CONFIG = load_config()
_J1939 = load_config(Path(__file__).parents[2] / "examples" / "j1939.toml")
