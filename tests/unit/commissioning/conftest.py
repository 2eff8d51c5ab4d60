"""Networks in virtual time: in front of a whole bench, or of a device that a test plays itself."""

from contextlib import ExitStack

import pytest

from hil_bench import VirtualBench, load_config
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.transports.embedded import EmbeddedBus
from hil_drivers import Network


class Device:
    """What a test puts on the bus: answers by request, and the frames that came."""

    def __init__(self):
        self.answers = {}
        self.received = []
        self.refusing = None

    def answer(self, can_id, request, *answers):
        """Send `answers`, pairs of identifier and hexadecimal data, to one request."""
        self.answers[can_id, bytes.fromhex(request)] = [
            Frame(answer_id, bytes.fromhex(data)) for answer_id, data in answers
        ]

    def refuse_all(self, node_id):
        """Answer each other SDO request to a node with an abort, 0800 0000: general error."""
        self.refusing = node_id

    def tick(self, frames, _now):
        self.received += frames
        return [answer for frame in frames for answer in self._answers_to(frame)]

    def _answers_to(self, frame):
        known = self.answers.get((frame.can_id, frame.data))
        if known is None and self.refusing is not None and frame.can_id == 0x600 + self.refusing:
            return [Frame(0x580 + self.refusing, b"\x80" + frame.data[1:4] + b"\0\0\0\x08")]
        return known or []


@pytest.fixture
def device():
    return Device()


@pytest.fixture
def device_network(device):
    """A network on which the device of the test is alone."""
    with EmbeddedBus(device.tick) as bus, Network(bus, clock=bus.now) as network:
        yield network


@pytest.fixture
def make_network():
    """Return the network in front of a device with a `tick` of its own."""
    with ExitStack() as stack:
        yield lambda device: _network_of(device, stack)


def _network_of(device, stack):
    bus = stack.enter_context(EmbeddedBus(device.tick))
    return stack.enter_context(Network(bus, clock=bus.now))


@pytest.fixture
def open_bench(tmp_path):
    """Return a virtual bench from the text of a bench.toml, and the network in front of it."""
    benches = []

    def open_it(text=None):
        path = None
        if text is not None:
            path = tmp_path / f"bench{len(benches)}.toml"
            path.write_text(text, encoding="utf-8")
        bench = VirtualBench(load_config(path))
        benches.append(bench)
        network = Network(bench.bus, clock=bench.now)
        bench.pump = network.pump
        bench.run(0.01)  # all boot-up messages are over
        return bench, network

    yield open_it
    for bench in benches:
        bench.bus.shutdown()
