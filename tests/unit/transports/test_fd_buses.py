"""CAN FD on the buses of our own: hubs, the clients of hubs, the opening of interfaces.

The words `fdsend` and `fdframe` are those of socketcand's `state_raw.c`.
"""

import socket
import struct
import time

import can
import pytest
from support.hub_client import receive
from support.patience import GUARD

from hil_bench.abilities.common.socketcand_bus import SocketcandFdBus
from hil_bench.abilities.common.socketcand_protocol import (
    MAX_COMMAND,
    format_frame,
    format_send,
    parse_frame,
    parse_send,
)
from hil_bench.abilities.controllers.process.hosted_bus import HostedBus
from hil_bench.abilities.hub.process import HubProcess
from hil_bench.canopen_device.frame import BRS, ESI, FDF, Frame
from hil_bench.errors import BusError
from hil_bench.frame import FD_LENGTHS, bits_of
from hil_bench.outside.transports import opening, socketcan
from hil_bench.outside.transports.opening import open_can_bus, open_transport

SPEEDUP = 4.0
FRAMES = [
    *(Frame(0x100 + length, bytes(range(length)), fd=FDF | BRS) for length in FD_LENGTHS),
    Frame(0x1FFFFFFF, b"\xff" * 64, is_extended=True, fd=FDF | ESI),
    Frame(0x7FF, b"\x01\x02"),
]


@pytest.fixture(scope="module")
def hub():
    with HubProcess(port=0, channels=("can0", "can1"), fd={"can0": SPEEDUP}) as hub:
        yield hub


@pytest.mark.parametrize(
    ("frame", "sent", "heard"),
    [
        (
            Frame(0x123, b"\xde\xad", fd=FDF | BRS),
            b"< fdsend 123 5 2 de ad >",
            b"< fdframe 123 05 1.000002 DEAD >",
        ),
        (Frame(0x080, fd=FDF), b"< fdsend 080 4 0  >", b"< fdframe 080 04 1.000002  >"),
        (
            Frame(0x1FFFFFFF, bytes(12), is_extended=True, fd=FDF | ESI),
            b"< fdsend 1FFFFFFF 6 12 " + b" ".join([b"00"] * 12) + b" >",
            b"< fdframe 1FFFFFFF 06 1.000002 000000000000000000000000 >",
        ),
    ],
)
def test_the_words_are_those_of_socketcand(frame, sent, heard):
    assert format_send(frame) == sent
    assert parse_send(sent[:-1]) == frame
    assert format_frame(frame, b"1.000002") == heard
    assert parse_frame(heard[:-1]) == frame


def test_the_longest_word_has_room():
    longest = Frame(0x1FFFFFFF, b"\xff" * 64, is_extended=True, fd=FDF | BRS | ESI)
    assert len(format_send(longest)) <= MAX_COMMAND


@pytest.mark.parametrize(
    "words",
    [
        b"< fdsend 123 5 9 0 0 0 0 0 0 0 0 0 ",  # a length that no DLC has
        b"< fdsend 123 5 2 de ",
        b"< fdsend 123 8 0 ",
        b"< fdsend 123 5 65 ",
        b"< fdsend 800 5 0 ",
        b"< fdsend 123 5 ",
    ],
)
def test_a_command_that_is_no_frame_is_none(words):
    assert parse_send(words) is None


@pytest.mark.parametrize("text", [b"< fdframe 123 05 1.2 000000000000000000 ", b"< fdframe 123 "])
def test_a_word_that_is_no_frame_is_none(text):
    assert parse_frame(text) is None


def test_a_hub_of_can_fd_carries_both_kinds_between_its_clients(hub):
    transport = hub.join("can0")
    address = {"host": hub.host, "port": hub.port, "fd": True}
    peer, _ = open_can_bus("socketcand", "can0", None, address)
    assert isinstance(peer, SocketcandFdBus)
    assert peer.protocol is can.CanProtocol.CAN_FD
    with peer:
        peer.send(can.Message(arbitration_id=1, is_extended_id=False))
        receive(transport, 1)
        transport.send(FRAMES)
        for frame in FRAMES:
            message = peer.recv(GUARD)
            assert (message.arbitration_id, bytes(message.data)) == (frame.can_id, frame.data)
            assert (message.is_fd, message.is_extended_id) == (frame.fd != 0, frame.is_extended)
            assert message.bitrate_switch == (frame.fd & BRS != 0)
            assert message.error_state_indicator == (frame.fd & ESI != 0)
            assert message.timestamp > 1.7e9  # the date
            peer.send(message)
        assert receive(transport, len(FRAMES)) == FRAMES
        with pytest.raises(can.CanOperationError, match="no frame of CAN FD"):
            peer.send(can.Message(arbitration_id=1, is_fd=True, data=bytes(9)))
    counters = transport.counters()
    assert counters.ignored == 0
    own = bits_of(Frame(1)) + 2 * sum(bits_of(frame, SPEEDUP) for frame in FRAMES)
    assert counters.bits == pytest.approx(own)
    transport.close()


def test_without_who_carries_it_can_fd_over_socketcand_is_refused(hub, monkeypatch):
    monkeypatch.setattr(opening, "given_to", lambda _taker: [])
    address = {"host": "127.0.0.1", "port": hub.port}
    refused = "socketcand can0: nothing here carries CAN FD over socketcand"
    with pytest.raises(BusError, match=f"^{refused}$"):
        open_can_bus("socketcand", "can0", None, {**address, "fd": True})
    bus, _ = open_can_bus("socketcand", "can0", None, address)
    bus.shutdown()


def test_a_remote_frame_is_not_sent_as_a_data_frame(hub, monkeypatch):
    """A real socketcand would put it on its bus as a heartbeat without a state."""
    said = []
    with SocketcandFdBus(channel="can0", host=hub.host, port=hub.port) as peer:
        monkeypatch.setattr(peer, "_tcp_send", said.append)
        peer.send(can.Message(arbitration_id=0x701, is_remote_frame=True, is_extended_id=False))
    assert not said


def test_python_cans_own_client_stays_on_a_bus_of_can_fd(hub):
    """It has no word for CAN FD, and passes it over."""
    transport = hub.join("can0")
    with can.Bus(interface="socketcand", channel="can0", host=hub.host, port=hub.port) as peer:
        peer.send(can.Message(arbitration_id=1, is_extended_id=False))
        receive(transport, 1)
        transport.send([FRAMES[10], Frame(0x123)])
        assert peer.recv(GUARD).arbitration_id == 0x123
    transport.close()


def talk(bus, words):
    """Say words to a hub, and return what it has said by the next end of a word."""
    bus._tcp_send(words)
    own = bus._SocketCanDaemonBus__socket
    own.settimeout(GUARD)
    return own.recv(4096)


def test_a_classical_bus_of_a_hub_refuses_can_fd_in_a_line(hub):
    with SocketcandFdBus(channel="can1", host=hub.host, port=hub.port) as peer:
        assert talk(peer, "< fdsend 123 5 1 aa >") == (
            b"< error this bus is classical CAN; fd = true in [bus] of bench.toml makes it CAN FD >"
        )


@pytest.mark.parametrize(("fd", "is_taken"), [(("can0",), True), ((), False)])
def test_a_hosted_bus_takes_can_fd_where_it_is_one(fd, is_taken):
    hosted = HostedBus(fd=fd, clock=lambda: 1_000_002_000)
    peer = socket.create_connection((hosted.host, hosted.port))
    peer.setblocking(False)
    said, words = b"", [b"< open can0 >", b"< rawmode >", b"< fdsend 123 5 2 de ad >"]
    deadline = time.monotonic() + GUARD
    while said.count(b">") < (3 if is_taken else 4) or not is_taken + hosted.clients:
        assert time.monotonic() < deadline
        hosted.wait(0.0)
        try:
            said += peer.recv(4096)
        except BlockingIOError:
            continue
        if words:
            peer.sendall(words.pop(0))
    frames = receive(hosted, 1) if is_taken else hosted.receive(1)
    assert frames == ([Frame(0x123, b"\xde\xad", fd=FDF | BRS)] if is_taken else [])
    assert (b"< error this bus is classical CAN; fd = true" in said) is not is_taken
    peer.close()
    hosted.close()


def test_an_interface_of_classical_can_is_refused_as_a_bus_of_can_fd(monkeypatch):
    """linux/can.h: CAN_MTU 16, CANFD_MTU 72; linux/sockios.h: SIOCGIFMTU 0x8921."""
    mtu = {b"can0": 16, b"vcan0": 16, b"can1": 72}
    asked = []

    def ioctl(_socket, request, argument):
        asked.append(request)
        name = argument[:16].rstrip(b"\0")
        return struct.pack("16si20x", name, mtu.get(name, 0))

    monkeypatch.setattr("fcntl.ioctl", ioctl)
    assert [socketcan.has_fd(name) for name in ("can0", "can1", "can2")] == [False, True, None]
    assert set(asked) == {0x8921}
    with pytest.raises(
        BusError, match=r"can0: the interface is set to classical CAN.*'ip link set"
    ):
        open_transport("socketcan", "can0", None, {"fd": True})
    with pytest.raises(BusError, match="'ip link set vcan0 mtu 72'"):
        open_can_bus("socketcan", "vcan0", None, {"fd": True})


def test_the_transport_of_another_interface_is_one_of_can_fd_where_the_bench_says_so(monkeypatch):
    monkeypatch.setattr(opening, "_open", lambda _settings, _what: can.Bus("fd", "virtual"))
    options = {"fd": True, "data_bitrate": 4_000_000}
    with can.Bus("fd", "virtual") as peer:
        transport = open_transport("virtual", "fd", 500_000, options)
        peer.send(can.Message(arbitration_id=1, is_fd=True, bitrate_switch=True, data=bytes(64)))
        frame = Frame(1, bytes(64), is_extended=True, fd=FDF | BRS)
        assert receive(transport, 1) == [frame]
        assert transport.counters().bits == pytest.approx(bits_of(frame, 8.0))
        transport.close()
