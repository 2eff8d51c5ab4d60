"""Several buses as one, on buses of python-can inside this process."""

from types import SimpleNamespace

import can
import pytest

from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import BusError
from hil_bench.frame import address_of
from hil_bench.outside.transports.opening import JoinedTransport, PythonCanTransport
from hil_bench.outside.transports.transport import TransportCounters


class ScriptedTransport:
    """A transport with frames to receive, that keeps what it is told."""

    def __init__(self, name, frames=None):
        self.description = name
        self.has_exact_wait = False
        self.waiting = list(frames or [])
        self.sent: list[Frame] = []
        self.filters: list[int] = []
        self.is_closed = False
        self.waits: list[float] = []

    def receive(self, limit):
        taken, self.waiting = self.waiting[:limit], self.waiting[limit:]
        return taken

    def wait(self, timeout):
        self.waits.append(timeout)
        return bool(self.waiting)

    def send(self, frames):
        self.sent += frames

    def listen_to(self, can_ids):
        self.filters = sorted(can_ids)

    def counters(self):
        return TransportCounters(received=1, sent=len(self.sent), bits=10.0)

    def close(self):
        self.is_closed = True


@pytest.fixture
def ends():
    """Two of python-can's virtual buses: the bench's end of both as one, and others' ends."""
    buses = [can.Bus(interface="virtual", channel=f"joined{number}") for number in range(4)]
    others = [can.Bus(interface="virtual", channel=f"joined{number}") for number in range(2)]
    joined = JoinedTransport([PythonCanTransport(bus, "virtual") for bus in buses[:2]])
    yield SimpleNamespace(joined=joined, others=others)
    for bus in (*buses, *others):
        bus.shutdown()


def message(can_id):
    return can.Message(arbitration_id=can_id, is_extended_id=False)


def test_frames_come_and_go_with_the_number_of_their_bus(ends):
    assert not ends.joined.wait(0.0)
    ends.others[1].send(message(0x181))
    assert ends.joined.wait(0.0)
    assert ends.joined.receive(10) == [Frame(0x181, bus=1)]

    ends.joined.send([Frame(0x701, bus=1), Frame(0x702), Frame(0x703, bus=1)])
    first, second = ends.others
    assert first.recv(0).arbitration_id == 0x702
    assert [second.recv(0).arbitration_id for _ in range(2)] == [0x701, 0x703]
    assert first.recv(0) is second.recv(0) is None


def test_a_wait_finds_what_is_on_any_bus():
    first, second = ScriptedTransport("a"), ScriptedTransport("b", [Frame(1)])
    assert JoinedTransport([first, second]).wait(5.0)
    assert first.waits == second.waits == [0.0]


def test_a_flood_on_one_bus_leaves_room_for_the_other():
    flood = ScriptedTransport("a", [Frame(1)] * 1000)
    other = ScriptedTransport("b", [Frame(2)] * 3)
    joined = JoinedTransport([flood, other])
    frames = joined.receive(10)
    # The first bus may take half of ten, the second what is left and has three.
    assert [frame.bus for frame in frames] == [0] * 5 + [1] * 3
    assert [frame.bus for frame in joined.receive(10)] == [0] * 10
    assert len(joined.receive(1)) == 1


def test_each_bus_listens_to_its_own_identifiers():
    first, second = ScriptedTransport("a"), ScriptedTransport("b")
    JoinedTransport([first, second]).listen_to([0x601, address_of(0x601, 1), address_of(0x80, 1)])
    assert (first.filters, second.filters) == ([0x601], [0x80, 0x601])


def test_counters_are_sums_and_all_are_closed():
    parts = [ScriptedTransport("a"), ScriptedTransport("b")]
    joined = JoinedTransport(parts)
    joined.send([Frame(1), Frame(2, bus=1), Frame(3, bus=1)])
    counters = joined.counters()
    assert (counters.received, counters.sent, counters.is_down) == (2, 3, False)
    assert counters.bits == 20.0
    assert joined.description == "a, b"
    joined.close()
    assert [part.is_closed for part in parts] == [True, True]


def test_one_bus_that_is_lost_ends_it():
    lost = ScriptedTransport("b")

    def receive(limit):
        raise BusError(f"b: bus lost, {limit}")

    lost.receive = receive
    with pytest.raises(BusError, match="b: bus lost"):
        JoinedTransport([ScriptedTransport("a"), lost]).receive(10)
