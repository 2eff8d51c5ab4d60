"""A device on its node, driven by frames in virtual time as `Bench.tick` drives it."""

import pytest

from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import ObjectDictionary

NODE_ID = 5
MILLISECOND = 1_000_000


class Rig:
    """One node and what the bus sees of it; a tick is 1 ms."""

    START, STOP, PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 1, 2, 128, 129, 130

    def __init__(self, eds, without=()):
        everything = load_eds(eds, NODE_ID)
        self.object_dictionary = ObjectDictionary(
            (variable for variable in everything if variable.index not in without),
            source=everything.source,
        )
        self.node = Node(self.object_dictionary, NODE_ID)
        self.now = 0
        self.frames = []
        self.work = lambda _now: None
        self.node.start(self.now)

    def receive(self, can_id, *data):
        handler = self.node.routes.get(can_id)
        assert handler is not None, f"nobody listens to 0x{can_id:03X}"
        handler(Frame(can_id, bytes(data)), self.now)

    def nmt(self, command):
        self.receive(0x000, command, NODE_ID)

    def tick(self, count=1):
        for _ in range(count):
            self.now += MILLISECOND
            self.node.expire(self.now)
            self.work(self.now)
            self.node.transmit_pdos(self.now, self.frames.append)
            self.node.serve(self.now, self.frames.append)

    def sent(self, can_id):
        """Take the data of the frames sent with this identifier so far."""
        taken = [frame.data for frame in self.frames if frame.can_id == can_id]
        self.frames = [frame for frame in self.frames if frame.can_id != can_id]
        return taken

    def emcy_codes(self):
        return [int.from_bytes(data[:2], "little") for data in self.sent(0x080 + NODE_ID)]

    def value(self, index, subindex=0):
        return self.object_dictionary.variable(index, subindex).value

    def write(self, index, subindex, value, size, *, signed=False):
        """Write by SDO (expedited download); return the abort code, None where it succeeded."""
        raw = value.to_bytes(size, "little", signed=signed)
        command = 0x23 | (4 - size) << 2
        request = bytes([command]) + index.to_bytes(2, "little") + bytes([subindex])
        self.receive(0x600 + NODE_ID, *request, *raw.ljust(4, b"\0"))
        self.tick()
        (answer,) = self.sent(0x580 + NODE_ID)
        return int.from_bytes(answer[4:], "little") if answer[0] == 0x80 else None


@pytest.fixture
def make_rig():
    return Rig
