"""The bench's end of a hub: a hub that dies is a bus that is down, and the next one is joined."""

import os
import signal
import socket
import threading

import can
import pytest
from support.hub_client import receive
from support.patience import GUARD

from hil_bench.abilities.hub import process as hub_transport
from hil_bench.abilities.hub.process import HubProcess, HubTransport
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import BusError
from hil_bench.frame import frame_bits
from hil_bench.outside.transports.transport import TransportCounters

FRAMES = [
    Frame(0x000, b"\x01\x00"),
    Frame(0x080),
    Frame(0x7FF, bytes(range(248, 256))),
    Frame(0x1FFFFFFF, b"\x0a", is_extended=True),
]


@pytest.fixture(scope="module")
def hub():
    with HubProcess(port=0, channels=("can0", "can1")) as hub:
        yield hub


def wait_until_down(transport):
    while not transport.is_down:
        transport.wait(0.1)
        transport.receive(1)


def test_every_kind_of_data_frame_goes_both_ways_beside_python_can(hub):
    transport = hub.join("can0")
    assert transport.description == "socketcand can0"
    with can.Bus(interface="socketcand", channel="can0", host=hub.host, port=hub.port) as peer:
        peer.send(can.Message(arbitration_id=0x123, is_extended_id=False))
        assert receive(transport, 1) == [Frame(0x123)]
        transport.send(FRAMES)
        for frame in FRAMES:
            message = peer.recv(GUARD)
            assert (message.arbitration_id, bytes(message.data)) == (frame.can_id, frame.data)
            assert message.is_extended_id == frame.is_extended
            peer.send(message)
        assert receive(transport, 4) == FRAMES
    bits = sum(frame_bits(len(f.data), is_extended=f.is_extended) for f in FRAMES)
    counters = transport.counters()
    assert counters == TransportCounters(received=5, sent=4)
    assert counters.bits == 2 * bits + frame_bits(0)
    transport.close()
    transport.close()
    assert not transport.counters().is_down


def test_it_takes_a_share_at_a_time_and_no_remote_frame(hub):
    left, right = hub.join("can1"), hub.join("can1")
    left.send([Frame(0x100 + n) for n in range(10)] + [Frame(0x701, is_remote=True)])
    assert left.counters() == TransportCounters(sent=10, send_failures=1)
    right.wait(GUARD)
    shares = []
    while sum(map(len, shares)) < 10:
        shares.append(right.receive(3))
    assert max(map(len, shares)) == 3
    assert [frame.can_id for share in shares for frame in share] == list(range(0x100, 0x10A))
    assert not right.wait(0.0)
    left.close()
    right.close()


def test_the_bench_is_not_limited_and_its_clients_are():
    with HubProcess(port=0, bitrate=10.0) as hub:  # a frame each five seconds
        bench, peer = hub.join("can0"), hub.join("can0")
        bench.send([Frame(0x123)] * 50)
        assert receive(peer, 50) == [Frame(0x123)] * 50
        with socket.create_connection((hub.host, hub.port)) as client:
            for word in (b"< open can0 >", b"< rawmode >"):
                client.recv(100)
                client.sendall(word)
            client.recv(100)
            client.sendall(b"< send 1 0 >" * 50)
            assert receive(bench, 1) == [Frame(0x001)]
            bench.send([Frame(0x124)])  # which overtakes what waits
            assert receive(peer, 2) == [Frame(0x001), Frame(0x124)]
        bench.close()
        peer.close()


def test_a_hub_that_is_killed_is_a_bus_that_is_down_until_the_next_is_joined():
    with HubProcess(port=0) as hub:
        transport = hub.join("can0")
        os.kill(hub._child.pid, signal.SIGKILL)
        wait_until_down(transport)
        while hub.ending() is None:
            os.sched_yield()
        assert hub.ending().startswith("was killed (SIGKILL")
        assert not transport.wait(0.0)
        assert transport.receive(8) == []
        transport.send(FRAMES)
        assert transport.counters() == TransportCounters(send_failures=4, outages=1, is_down=True)
        with pytest.raises(BusError, match=rf"^socketcand can0: hub 127\.0\.0\.1:{hub.port}: "):
            transport.join()

        port = hub.port
        hub.restart()
        transport.join()
        assert hub.port == port
        assert hub.ending() is None
        peer = hub.join("can0")
        transport.send(FRAMES)
        assert receive(peer, 4) == FRAMES
        assert transport.counters() == TransportCounters(sent=4, send_failures=4, outages=1)
        transport.close()
        peer.close()


def test_a_hub_that_hangs_holds_nothing_up_and_is_said_once(monkeypatch, caplog):
    monkeypatch.setattr(hub_transport, "MAX_UNSENT", 1000)
    with HubProcess(port=0) as hub:
        transport = hub.join("can0")
        os.kill(hub._child.pid, signal.SIGSTOP)
        while not transport.counters().send_failures:  # the kernel's buffers take some MB first
            transport.send(FRAMES * 1000)
        transport.send(FRAMES)
        os.kill(hub._child.pid, signal.SIGCONT)
        transport.close()
    (said,) = caplog.messages
    assert said == (
        "socketcand can0: the hub takes no frames: it hangs, or this machine is too busy; frames "
        "are lost and counted"
    )


def test_an_unknown_channel_is_said_with_those_there_are(hub):
    with pytest.raises(BusError, match="could not open bus; this hub has can0, can1"):
        hub.join("can7")


@pytest.mark.parametrize("answer", [b"", b"220 mail.example ESMTP\r\n" * 20, b"< hi >< no >"])
def test_something_that_is_no_hub_is_refused(answer):
    def serve():
        connection, _ = server.accept()
        with connection:
            connection.sendall(answer)
            connection.shutdown(socket.SHUT_WR)
            while connection.recv(100):
                pass

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=serve)
        thread.start()
        address = "127.0.0.1", server.getsockname()[1]
        with pytest.raises(BusError, match=rf"hub 127\.0\.0\.1:{address[1]}: "):
            HubTransport(address, "can0")
        thread.join()


@pytest.fixture
def odd_hub():
    """A transport, and the connection by which the test plays its hub."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        opened = []
        address = "127.0.0.1", server.getsockname()[1]
        thread = threading.Thread(target=lambda: opened.append(HubTransport(address, "can0")))
        thread.start()
        connection, _ = server.accept()
        with connection:
            connection.sendall(b"< hi >< ok >< ok >< frame 181 1.0 2A >< frame 1")
            thread.join()
            yield opened[0], connection
            opened[0].close()


def test_frames_that_come_with_the_last_answer_are_not_lost(odd_hub):
    transport, connection = odd_hub
    assert receive(transport, 1) == [Frame(0x181, b"\x2a")]
    connection.sendall(b"82 1.5  >")
    assert receive(transport, 1) == [Frame(0x182)]


def test_words_that_are_no_frames_are_ignored_and_counted(odd_hub):
    transport, connection = odd_hub
    connection.sendall(b"8G 1.0 00 ><>< error unknown command >< frame 080 1.0  >")
    assert [frame.can_id for frame in receive(transport, 2)] == [0x181, 0x080]
    assert transport.counters().ignored == 3


def test_one_that_says_no_end_of_a_word_is_no_hub(odd_hub):
    transport, connection = odd_hub
    connection.sendall(b"<" * 1000)
    assert receive(transport, 1) == [Frame(0x181, b"\x2a")]
    wait_until_down(transport)
    assert transport.counters().outages == 1
