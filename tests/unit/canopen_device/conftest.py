from pathlib import Path

import pytest

from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.node import Node

EDS = Path(__file__).with_name("device.eds")
NODE_ID = 5


@pytest.fixture
def eds_path():
    return EDS


@pytest.fixture
def object_dictionary():
    return load_eds(EDS, NODE_ID)


class Rig:
    """A node that has booted, and what it sent since."""

    def __init__(self, object_dictionary):
        self.node = Node(object_dictionary, NODE_ID)
        self.now = 0
        self.sent = []
        self.node.start(0)
        self.run(0)
        self.sent.clear()

    def receive(self, can_id, data, **flags):
        self.node.receive(Frame(can_id, data, **flags), self.now)

    def run(self, milliseconds=1):
        """Advance and do one round; return the frames of that round."""
        self.now += milliseconds * 1_000_000
        before = len(self.sent)
        self.node.expire(self.now)
        self.node.transmit_pdos(self.now, self.sent.append)
        self.node.serve(self.now, self.sent.append)
        return self.sent[before:]

    def request(self, data):
        """Send one SDO request; return the answers' data."""
        self.receive(0x600 + NODE_ID, data)
        return [frame.data for frame in self.run() if frame.can_id == 0x580 + NODE_ID]


@pytest.fixture(scope="session")
def make_rig():
    """Build a rig; a factory, so that a Hypothesis test gets a fresh one for each example."""
    return lambda: Rig(load_eds(EDS, NODE_ID))


@pytest.fixture
def rig(object_dictionary):
    return Rig(object_dictionary)


@pytest.fixture
def rig_of():
    """Build a rig of another EDS file than that of the other tests."""
    return lambda path: Rig(load_eds(path, NODE_ID))
