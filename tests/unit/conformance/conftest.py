"""A device under test in virtual time: the node of the other tests, with the defect it is given."""

import contextlib

import pytest

from hil_bench.abilities.conformance.check import Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.suite import CHAPTERS, Outcome, run_suite
from hil_bench.abilities.conformance.wire import Wire
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.node import Node
from hil_bench.outside.transports.embedded import EmbeddedBus

NODE_ID = 5


class Laboratory:
    """A node on a bus, and what may be wrong with it.

    Attributes:
        hears: makes of a frame to the node the frames that it hears.
        says: makes of a frame of the node the frames that are on the bus.
        beside: makes of the frames of a round those that are on the bus with other nodes'.
    """

    def __init__(self, eds, node_id=NODE_ID):
        self.node = Node(load_eds(eds, node_id), node_id)
        self.node.start(0)
        self.hears = self.says = lambda frame: [frame]
        self.beside = lambda frames: frames
        self.bus = EmbeddedBus(self._tick)
        self.bus.advance(0.01)
        objects = load_eds(eds, node_id)
        self.dut = DeviceUnderTest(Wire(self.bus, self.bus.now), node_id, objects)

    def run(self, *titles, allowed=Impact.STORE):
        """The results of some chapters, or of all."""
        chapters = [each for each in CHAPTERS if each.title in titles or not titles]
        return list(run_suite(self.dut, allowed, chapters))

    def failed(self, *titles):
        """Clause and text of the checks that fail, of some chapters or of all."""
        return [
            (result.check.clause, result.check.text)
            for result in self.run(*titles)
            if result.outcome is Outcome.FAILED
        ]

    def failed_checks(self, *titles):
        """The names of the checks that fail, of some chapters or of all."""
        results = self.run(*titles)
        return [r.check.judge.__name__ for r in results if r.outcome is Outcome.FAILED]

    def result(self, title, text):
        """The outcome and the detail of the one check of a chapter whose text begins so."""
        (result,) = [r for r in self.run(title) if r.check.text.startswith(text)]
        return result.outcome, result.detail

    def _tick(self, frames, now):
        for frame in frames:
            for heard in self.hears(frame):
                self.node.receive(heard, now)
        self.node.expire(now)
        self.node.events.clear()
        sent = []
        self.node.transmit_pdos(now, sent.append)
        self.node.serve(now, sent.append)
        return self.beside([said for frame in sent for said in self.says(frame)])


@pytest.fixture
def eds_path(request):
    return request.config.rootpath / "tests" / "unit" / "canopen_device" / "device.eds"


@pytest.fixture
def make_laboratory():
    with contextlib.ExitStack() as stack:

        def make(eds):
            laboratory = Laboratory(eds)
            stack.callback(laboratory.bus.shutdown)
            return laboratory

        yield make


STARTUP = """
[1F80]
ParameterName=NMT startup
ObjectType=0x7
DataType=0x0007
AccessType=rw
DefaultValue={}
PDOMapping=0
"""


@pytest.fixture
def make_variant(make_laboratory, eds_path, tmp_path):
    """Put a variant of the device on the bus."""

    def make(*, claims_lss=False, startup=None, heartbeat=0):
        text = eds_path.read_text(encoding="utf-8")
        if claims_lss:
            text = text.replace("LSS_Supported=0", "LSS_Supported=1")
        head, section, rest = text.partition("[1017]\n")
        rest = rest.replace("DefaultValue=0", f"DefaultValue={heartbeat}", 1)
        text = head + section + rest
        if startup is not None:
            text += STARTUP.format(startup)
        path = tmp_path / "variant.eds"
        path.write_text(text, encoding="utf-8")
        return make_laboratory(path)

    return make


@pytest.fixture
def laboratory(make_laboratory, eds_path):
    return make_laboratory(eds_path)
