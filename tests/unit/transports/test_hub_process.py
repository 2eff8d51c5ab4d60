"""The hub in its own process, with python-can's own client as the peer."""

import os
import signal
import socket
import subprocess
import sys

import can
import pytest
from support.patience import GUARD

from hil_bench.abilities.hub.process import HubProcess
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import BusError
from hil_bench.outside.transports.opening import open_transport


@pytest.fixture(scope="module")
def hub():
    with HubProcess(port=0, channels=("can0", "axis-2")) as hub:
        yield hub


@pytest.fixture
def join(hub):
    buses = []

    def join_bus(channel="can0", **options):
        buses.append(
            can.Bus(
                interface="socketcand",
                channel=channel,
                host=hub.host,
                port=hub.port,
                ignore_config=True,
                **options,
            )
        )
        return buses[-1]

    yield join_bus
    for bus in buses:
        bus.shutdown()


MESSAGES = [
    can.Message(arbitration_id=0x000, data=b"\x01\x00", is_extended_id=False),
    can.Message(arbitration_id=0x080, is_extended_id=False),
    can.Message(arbitration_id=0x7FF, data=bytes(range(248, 256)), is_extended_id=False),
    can.Message(arbitration_id=0x123, data=b"\x0a", is_extended_id=True),
    can.Message(arbitration_id=0x1FFFFFFF, data=bytes(8), is_extended_id=True),
]


@pytest.mark.parametrize("message", MESSAGES, ids=str)
def test_python_cans_client_sends_and_receives_every_kind_of_data_frame(join, message):
    sender, receiver = join(), join()
    sender.send(message)
    received = receiver.recv(GUARD)
    assert received.equals(
        message, timestamp_delta=None, check_channel=False, check_direction=False
    )
    assert received.timestamp > 1_700_000_000  # Unix time, as SocketCAN stamps frames


def test_python_cans_client_does_not_hear_itself(join):
    sender, receiver = join(), join()
    sender.send(MESSAGES[0])
    receiver.recv(GUARD)
    receiver.send(MESSAGES[1])
    assert sender.recv(GUARD).arbitration_id == 0x080


def test_a_burst_arrives_complete_and_in_order(join):
    sender, receiver = join(), join()
    for n in range(2_000):
        sender.send(can.Message(arbitration_id=0x123, data=n.to_bytes(8, "little")))
    received = [int.from_bytes(receiver.recv(GUARD).data, "little") for _ in range(2_000)]
    assert received == list(range(2_000))


def test_joining_a_busy_bus_works(hub, join):
    # A client that floods: what the hub sends must not touch the handshake of those that join.
    with socket.create_connection((hub.host, hub.port)) as flood:
        for words in (b"< open can0 >", b"< rawmode >"):
            flood.recv(256)
            flood.sendall(words)
        assert flood.recv(256) == b"< ok >"
        for _ in range(5):
            flood.sendall(b"< send 123 8 1 2 3 4 5 6 7 8 >" * 100)
            bus = join()
            flood.sendall(b"< send 124 0 >")
            while bus.recv(GUARD).arbitration_id != 0x124:
                pass


def test_an_unknown_channel_is_said_with_those_there_are(hub):
    with pytest.raises(BusError) as caught:
        open_transport("socketcand", "can7", None, {"host": hub.host, "port": hub.port})
    assert str(caught.value) == (
        "socketcand can7: error could not open bus; this hub has can0, axis-2"
    )


def test_two_transports_meet_on_the_hub(hub):
    address = {"host": hub.host, "port": hub.port}
    left = open_transport("socketcand", "axis-2", None, address)
    right = open_transport("socketcand", "axis-2", None, address)
    left.send([Frame(0x181, b"\x01\x02"), Frame(0x281)])
    received = []
    while len(received) < 2:  # pytest-timeout ends it where nothing comes
        received += right.receive(10)
    assert received == [Frame(0x181, b"\x01\x02"), Frame(0x281)]
    left.close()
    right.close()


def test_a_transport_to_a_hub_does_not_wait_for_acknowledgements(hub):
    transport = open_transport("socketcand", "can0", None, {"host": hub.host, "port": hub.port})
    its_socket = transport._bus._SocketCanDaemonBus__socket
    assert its_socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
    transport.close()


def send_for_ever(transport):
    while True:  # the first frames may still go into the kernel's buffer
        transport.send([Frame(0x181)])


def test_a_hub_that_has_gone_is_a_lost_bus():
    with HubProcess(port=0) as hub:
        address = {"host": hub.host, "port": hub.port}
        transport = open_transport("socketcand", "can0", None, address)
    with pytest.raises(BusError, match=r"^socketcand can0: bus lost: "):
        send_for_ever(transport)
    transport.close()


def test_the_hub_is_alive_within_the_block_only():
    with HubProcess(port=0) as hub:
        assert hub.alive
        assert hub.port > 0
    assert not hub.alive
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((hub.host, hub.port), timeout=GUARD)


def test_a_port_in_use_is_a_bus_error(hub):
    second = HubProcess(port=hub.port)
    with pytest.raises(BusError, match=f"^hub 127.0.0.1:{hub.port}: the port is in use"), second:
        pass
    assert not second.alive


def test_a_bad_channel_name_is_a_bus_error():
    with pytest.raises(BusError, match="1 to 15 letters"), HubProcess(port=0, channels=("a b",)):
        pass


def test_ctrl_c_is_left_to_the_parent():
    with HubProcess(port=0) as hub:
        os.kill(hub._child.pid, signal.SIGINT)
        with socket.create_connection((hub.host, hub.port), timeout=GUARD) as client:
            assert client.recv(256) == b"< hi >"


PARENT = """
import os, sys
from hil_bench.abilities.hub.process import HubProcess

if __name__ == "__main__":
    with HubProcess(port=0) as hub:
        print(hub.port, flush=True)
        sys.stdin.read()
"""


def test_the_hub_dies_with_a_parent_that_is_killed(make_file):
    program = make_file("parent.py", PARENT)
    parent = subprocess.Popen(  # noqa: S603 - the program just written
        [sys.executable, str(program)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    port = int(parent.stdout.readline())
    with socket.create_connection(("127.0.0.1", port), timeout=GUARD) as client:
        assert client.recv(256) == b"< hi >"
        parent.kill()
        assert client.recv(256) == b""  # the end of the connection is the end of the hub
    parent.communicate()
