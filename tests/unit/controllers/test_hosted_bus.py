"""What the bench hears and says on the bus that it hosts, with clients on real loopback sockets.

The rules that it keeps with its clients are tested in tests/unit/transports/test_socketcand_hub.py.

The bus does nothing but inside its own calls, so a client's `hear` lets it work until the words are
there. What clients say is what python-can 4.6 and socketcand's doc/protocol.md have.
"""

import threading
import time

import can
import pytest
from support.hub_client import Client
from support.patience import GUARD

from hil_bench.abilities.controllers.process import hosted_bus
from hil_bench.abilities.controllers.process.hosted_bus import HostedBus
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.transports.transport import TransportCounters


@pytest.fixture
def bus():
    hosted = HostedBus(clock=lambda: 12_345_678_999)
    yield hosted
    hosted.close()


@pytest.fixture
def connect(bus):
    clients = []

    def connect_one():
        clients.append(Client(bus.port, lambda: bus.wait(0.0)))
        return clients[-1]

    yield connect_one
    for client in clients:
        client.close()


@pytest.fixture
def join(connect):
    return lambda: connect().join()


def receive(bus, count):
    """Return the next frames that reach the bench."""
    frames = []
    deadline = time.monotonic() + GUARD
    while len(frames) < count:
        assert time.monotonic() < deadline
        bus.wait(0.1)
        frames += bus.receive(count - len(frames))
    return frames


def test_what_a_client_sends_reaches_the_bench_and_the_other_clients(bus, join):
    sender, listener = join(), join()
    sender.say(b"< send 123 2 de 1 >< send 1FFFFFFF 0  >")
    assert receive(bus, 2) == [Frame(0x123, b"\xde\x01"), Frame(0x1FFFFFFF, is_extended=True)]
    assert listener.hear() == b"< frame 123 12.345678 DE01 >"
    assert listener.hear() == b"< frame 1FFFFFFF 12.345678  >"
    listener.say(b"< send 001 0 >")
    assert sender.hear() == b"< frame 001 12.345678  >"  # the first thing it hears
    assert bus.clients == 2


def test_what_the_bench_sends_reaches_every_client_in_its_order(bus, join):
    clients = [join(), join()]
    for client in clients:
        client.say(b"< send 7FF 0 >")  # it has read the answer to "rawmode"
    receive(bus, 2)
    assert [clients[0].hear(), clients[1].hear()] == [b"< frame 7FF 12.345678  >"] * 2
    bus.send([Frame(0x181, b"\x07\x00"), Frame(0x080), Frame(0x701, is_remote=True)])
    for client in clients:
        assert client.hear() == b"< frame 181 12.345678 0700 >"
        assert client.hear() == b"< frame 080 12.345678  >"
    # The protocol has no remote frames.
    assert bus.counters() == TransportCounters(received=2, sent=2, send_failures=1)


def test_frames_are_taken_a_bounded_share_at_a_time_however_they_are_cut_up(bus, join):
    sender = join()
    stream = b"".join(b"< send %03x 0  >" % n for n in range(100))
    for start in range(0, len(stream), 7):
        sender.say(stream[start : start + 7])
    deadline = time.monotonic() + GUARD
    frames, shares = [], []
    while len(frames) < 100:
        assert time.monotonic() < deadline
        shares.append(bus.receive(30))
        frames += shares[-1]
    assert [frame.can_id for frame in frames] == list(range(100))
    assert max(map(len, shares)) <= 30


def test_a_wait_without_a_frame_ends(bus, join):
    assert not bus.wait(0.0)
    join()
    assert not bus.wait(0.0)
    assert bus.receive(8) == []


def test_who_comes_is_seen_to_while_the_only_client_speaks_or_is_silent(bus, join, connect):
    """The bus waits for a single client alone, but not for ever."""
    talker = join()
    for speaks in (True, False):
        newcomer = connect()
        for _ in range(20 if speaks else 3):
            if speaks:
                talker.say(b"< send 080 0 >")
            assert bus.wait(GUARD if speaks else 0.001) is speaks
            if speaks:
                bus.receive(1)
        newcomer.socket.settimeout(GUARD)
        assert newcomer.socket.recv(100) == b"< hi >"
        newcomer.close()
        bus.wait(GUARD)


def test_a_client_that_does_not_read_is_cut_off_and_the_others_lose_nothing(bus, join, monkeypatch):
    monkeypatch.setattr(hosted_bus, "MAX_BACKLOG", 10_000)
    join()  # and never reads again
    listener = join()
    listener.say(b"< send 7FF 0 >")
    receive(bus, 1)
    for _ in range(1_000):
        bus.send([Frame(0x123, bytes([n % 256])) for n in range(200)])
        for n in range(200):
            assert listener.hear() == b"< frame 123 12.345678 %02X >" % (n % 256)
        if bus.clients == 1:
            return
    pytest.fail("still there after 200,000 frames")


def test_python_can_joins_it(bus):
    opened = []  # in a second thread, since python-can waits for answers as it opens
    opening = threading.Thread(
        target=lambda: opened.append(
            can.Bus(interface="socketcand", channel="can0", host=bus.host, port=bus.port)
        )
    )
    opening.start()
    deadline = time.monotonic() + GUARD
    while not bus.clients:
        assert time.monotonic() < deadline
        bus.wait(0.1)
    opening.join()
    with opened[0] as peer:
        peer.send(can.Message(arbitration_id=0x601, data=b"\x40", is_extended_id=False))
        assert receive(bus, 1) == [Frame(0x601, b"\x40")]
        bus.send([Frame(0x581, b"\x43")])
        message = peer.recv(GUARD)
        assert (message.arbitration_id, bytes(message.data)) == (0x581, b"\x43")


def test_a_closed_bus_is_closed_again_without_harm(bus, join):
    client = join()
    bus.close()
    bus.close()
    assert client.socket.recv(1) == b""


@pytest.fixture
def two_buses():
    hosted = HostedBus(channels=("can0", "can1"), clock=lambda: 1_000_000_000)
    clients = [Client(hosted.port, lambda: hosted.wait(0.0)) for _ in range(3)]
    yield hosted, clients
    for client in clients:
        client.close()
    hosted.close()


def test_each_channel_is_a_bus_of_its_own(two_buses):
    bus, (first, second, third) = two_buses
    first.join()
    second.join(b"can1")
    third.join(b"can1")
    second.say(b"< send 181 1 2a >")
    assert receive(bus, 1) == [Frame(0x181, b"\x2a", bus=1)]
    assert third.hear() == b"< frame 181 1.000000 2A >"

    bus.send([Frame(0x701, b"\x00"), Frame(0x702, b"\x00", bus=1)])
    assert first.hear() == b"< frame 701 1.000000 00 >"  # and so nothing of 0x181 before it
    assert second.hear() == third.hear() == b"< frame 702 1.000000 00 >"
    assert bus.description == f"hub 127.0.0.1:{bus.port} can0 can1"
