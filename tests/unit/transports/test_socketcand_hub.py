"""The two servers of socketcand's protocol keep the same rules: the hub, and the hosted bus.

Clients are real loopback sockets in the same thread, and a server does nothing but in `serve`. What
clients write and read is what python-can 4.6 and socketcand's doc/protocol.md have; python-can's
own client is the peer in test_hub_process.py.
"""

import asyncio
import re
import socket

import pytest
from support import hub_client

from hil_bench.abilities.common import socketcand_protocol
from hil_bench.abilities.common.reception import ROOM
from hil_bench.abilities.common.socketcand_protocol import MAX_COMMAND, MOST_BAD
from hil_bench.abilities.controllers.process import hosted_bus
from hil_bench.abilities.hub import server as hub_server
from hil_bench.abilities.hub.server import Hub
from hil_bench.errors import BusError

TIME_STAMP = re.compile(rb"(< (?:fd)?frame [0-9A-F]+ )\d+\.\d{6} ")


class Client(hub_client.Client):
    """Leaves the time stamps of frames out."""

    def hear(self):
        message = super().hear()
        return message and TIME_STAMP.sub(rb"\1", message)


class HostedServer:
    """The bus that a transport hosts, whose bench hears all and says nothing."""

    delays, most_clients = hosted_bus, hosted_bus.MAX_CLIENTS

    def __init__(self, channels):
        self.bus = hosted_bus.HostedBus(channels=channels)
        self.port = self.bus.port

    def serve(self):
        self.bus.wait(0.0)
        self.bus.receive(1000)

    def open_another(self):
        hosted_bus.HostedBus(port=self.port)

    def close(self):
        self.bus.close()


class HubServer:
    """The hub, in an event loop that goes round once at a time."""

    delays, most_clients = socketcand_protocol, hub_server.MAX_CLIENTS
    now = 0

    def __init__(self, channels):
        self.runner = asyncio.Runner()
        self.hub = Hub(channels, clock=lambda: self.now)
        self.server = self.runner.run(self.hub.start(0))
        self.port = self.server.sockets[0].getsockname()[1]

    def serve(self):
        self.runner.run(asyncio.sleep(0))

    def open_another(self):
        self.runner.run(Hub().start(self.port))

    def close(self):
        self.server.close()
        for _ in range(30):  # until it has closed the connections whose clients have
            self.serve()
        self.runner.close()


@pytest.fixture
def channels():
    return ("can0",)


@pytest.fixture(params=[HostedServer, HubServer])
def server(request, channels):
    made = request.param(channels)
    yield made
    made.close()


@pytest.fixture
def hub():
    made = HubServer(("can0",))
    yield made
    made.close()


@pytest.fixture
def connect():
    clients = []

    def connect_one(server):
        clients.append(Client(server.port, server.serve))
        return clients[-1]

    yield connect_one
    for client in clients:
        client.close()


@pytest.fixture
def join(connect):
    return lambda server, channel=b"can0": connect(server).join(channel)


TWO_CHANNELS = pytest.mark.parametrize("channels", [("can0", "can1")])


@pytest.mark.parametrize(
    ("sent", "heard"),
    [
        (b"< send 123 2 de ad >", b"< frame 123 DEAD >"),
        (b"< send 123 2 1 f >", b"< frame 123 010F >"),
        (b"< send 080 0  >", b"< frame 080  >"),  # python-can's own words for no data
        (b"< send 080 0 >", b"< frame 080  >"),
        (b"< send 7ff 8 1 2 3 4 5 6 7 8 >", b"< frame 7FF 0102030405060708 >"),
        (b"< send 5 0 >", b"< frame 005  >"),
        (b"< send 00000123 1 ff >", b"< frame 00000123 FF >"),
        (b"< send 1FFFFFFF 0  >", b"< frame 1FFFFFFF  >"),
    ],
)
def test_a_frame_reaches_the_others_and_not_its_sender(server, join, sent, heard):
    sender, first, second = [join(server) for _ in range(3)]
    sender.say(sent)
    assert first.hear() == second.hear() == heard
    first.say(b"< send 001 0 >")
    assert sender.hear() == b"< frame 001  >"  # the first thing it hears


def test_a_frame_carries_the_time_in_seconds_and_microseconds(hub, join, monkeypatch):
    monkeypatch.setattr(hub_server.time, "time_ns", lambda: 1_700_000_000_000_042_999)
    sender, listener = join(hub), join(hub)
    sender.say(b"< send 123 1 1 >")
    assert listener.read() == b"< frame 123 1700000000.000042 01 >"


def test_frames_keep_their_order_however_they_are_cut_up(server, join):
    sender, listener = join(server), join(server)
    stream = b"".join(b"< send %03x 0  >" % n for n in range(200))
    for start in range(0, len(stream), 7):
        sender.say(stream[start : start + 7])
    for n in range(200):
        assert listener.hear() == b"< frame %03X  >" % n


@TWO_CHANNELS
def test_channels_are_separate_buses(server, join):
    left, right, listener = (join(server, name) for name in (b"can0", b"can1", b"can1"))
    left.say(b"< send 001 0 >< bad >")
    assert left.hear() == b"< error unknown command >"  # so it has been heard
    right.say(b"< send 002 0 >")
    assert listener.hear() == b"< frame 002  >"


@TWO_CHANNELS
def test_a_channel_that_is_not_there_is_refused_with_those_that_are(server, connect):
    client = connect(server)
    client.hear()
    client.say(b"< open vcan7 >")
    assert client.hear() == b"< error could not open bus; this hub has can0, can1 >"
    client.say(b"< open can1 >")
    assert client.hear() == b"< ok >"


@pytest.mark.parametrize(
    "bad",
    [
        b"< send 123 9 1 2 3 4 5 6 7 8 9 >",
        b"< send 123 2 1 >",
        b"< send 123 0 1 >",
        b"< send 123 1 100 >",
        b"< send 123 1 -1 >",
        b"< send 123 1 0x1 >",
        b"< send 800 0 >",
        b"< send 20000000 0 >",
        b"< send 1234 0 >",
        b"< send >",
        b"< bcmmode >",
        b"< open can0 >",
        b"send 123 0 >",
        b"<>",
        b"\xff\x00>",
    ],
)
def test_a_bad_command_is_answered_and_the_client_stays(server, join, bad):
    client, listener = join(server), join(server)
    client.say(bad)
    assert client.hear() == b"< error unknown command >"
    client.say(b"< send 001 0 >")
    assert listener.hear() == b"< frame 001  >"


def test_a_remote_frame_of_python_can_is_dropped_without_an_error(server, join):
    """python-can 4.6 writes the length of what it asks for, and no bytes; an error ends its bus."""
    client, listener = join(server), join(server)
    client.say(b"< send 701 1  >< send 001 0 >")
    assert listener.hear() == b"< frame 001  >"
    listener.say(b"< send 002 0 >")
    assert client.hear() == b"< frame 002  >"


@pytest.mark.parametrize("early", [b"< rawmode >", b"< send 123 0 >", b"< open >", b"< open a b >"])
def test_commands_out_of_turn_are_refused(server, connect, early):
    client = connect(server)
    client.hear()
    client.say(early)
    assert client.hear() == b"< error unknown command >"


def test_a_command_without_an_end_cuts_the_client_off_and_nobody_else(server, join):
    client, other, listener = [join(server) for _ in range(3)]
    client.say(b"< send " + b"1" * MAX_COMMAND)
    assert client.hear() is None
    other.say(b"< send 001 0 >")
    assert listener.hear() == b"< frame 001  >"


@pytest.mark.long
def test_a_client_that_does_not_read_is_cut_off_and_others_lose_nothing(hub, join, monkeypatch):
    monkeypatch.setattr(hub_server, "MAX_BACKLOG", 10_000)
    frames = 2_000
    sender, _slow, listener = [join(hub) for _ in range(3)]
    for _ in range(1_000):
        sender.say(b"".join(b"< send 123 1 %x >" % (k % 256) for k in range(frames)))
        for k in range(frames):
            assert listener.hear() == b"< frame 123 %02X >" % (k % 256)
        if len(hub.hub.bus("can0")) == 2:
            break
    assert len(hub.hub.bus("can0")) == 2


def test_frames_wait_until_a_new_client_has_read_the_answer_to_rawmode(server, join, monkeypatch):
    """python-can takes all that there is, and compares it with "< ok >"."""
    monkeypatch.setattr(server.delays, "JOIN_DELAY", 3_600)
    sender, listener = join(server), join(server)
    # Twice there and back: what the first frames brought has then reached the listener's end.
    for command in (b"< send 001 0 >< bad >", b"< send 002 0 >< bad >"):
        sender.say(command)
        assert sender.hear() == b"< error unknown command >"
    with pytest.raises(BlockingIOError):
        listener.socket.recv(256)
    listener.say(b"< send 003 0 >")  # only now may frames follow
    assert listener.hear() == b"< frame 001  >"
    assert listener.hear() == b"< frame 002  >"
    assert sender.hear() == b"< frame 003  >"


def test_held_back_frames_follow_without_a_word_from_the_client(server, join, monkeypatch):
    monkeypatch.setattr(server.delays, "JOIN_DELAY", 0.001)
    sender, listener = join(server), join(server)
    sender.say(b"< send 001 0 >")
    assert listener.hear() == b"< frame 001  >"


def test_a_client_that_leaves_is_forgotten(server, join):
    stays = join(server)
    for _ in range(2 * server.most_clients):
        join(server).close()
    join(server).say(b"< send 002 0 >")
    assert stays.hear() == b"< frame 002  >"


def test_more_clients_than_there_is_room_for_are_turned_away(server, connect, join):
    for _ in range(server.most_clients):
        join(server)
    late = connect(server)
    assert late.hear() == b"< hi >"
    late.say(b"< open can0 >")
    assert late.hear() == b"< error too many clients >"
    assert late.hear() is None


@pytest.mark.parametrize("word", [b"", b"< open can0 >", b"garbage", b"\xff>"])
def test_clients_that_never_join_keep_nobody_out_and_the_oldest_go(server, connect, join, word):
    idlers = [connect(server) for _ in range(ROOM + 9)]
    for idler in idlers:
        idler.say(word)
    sender, listener = join(server), join(server)
    for idler in idlers[:9]:
        while idler.hear():
            pass
    sender.say(b"< send 001 0 >")
    assert listener.hear() == b"< frame 001  >"


def test_a_client_that_sends_nothing_but_nonsense_is_cut_off(server, join):
    client, listener = join(server), join(server)
    client.say((MOST_BAD - 1) * b"\xff>" + b"< send 001 0 >" + (MOST_BAD - 1) * b"< send 7 9 >")
    assert listener.hear() == b"< frame 001  >"
    client.say(b"< send 002 0 >" + MOST_BAD * b"x>")
    answers = [client.hear() for _ in range(3 * MOST_BAD - 1)]
    assert answers == (3 * MOST_BAD - 2) * [b"< error unknown command >"] + [None]
    assert listener.hear() == b"< frame 002  >"


def test_a_port_in_use_is_said_in_one_line(server):
    with pytest.raises(BusError) as caught:
        server.open_another()
    assert str(caught.value) == (
        f"hub 127.0.0.1:{server.port}: the port is in use, perhaps by another hub; "
        "port 0 takes a free one"
    )


def test_thousands_of_connections_that_say_nothing_do_no_harm(hub, join):
    for _ in range(3_000):
        socket.create_connection(("127.0.0.1", hub.port)).close()
        hub.serve()
    sender, listener = join(hub), join(hub)
    sender.say(b"< send 001 0 >")
    assert listener.hear() == b"< frame 001  >"


def test_who_does_not_join_in_time_goes_and_a_silent_listener_stays(hub, connect, join):
    """5 s are those of `reception.PATIENCE`; the listener says nothing for an hour."""
    listener, idler = join(hub), connect(hub)
    assert idler.hear() == b"< hi >"
    hub.now += 4_999_999_999
    hub.hub.waiting.look()
    sender = join(hub)
    with pytest.raises(BlockingIOError):  # it is still there
        idler.socket.recv(1)
    hub.now += 1
    hub.hub.waiting.look()
    assert idler.hear() is None
    hub.now += 3_600_000_000_000
    hub.hub.waiting.look()
    sender.say(b"< send 001 0 >")
    assert listener.hear() == b"< frame 001  >"


@pytest.mark.parametrize("name", ["", "can 0", "a" * 16, "can0>", "kän"])
def test_a_channel_without_a_proper_name_is_refused(name):
    with pytest.raises(ValueError, match="1 to 15 letters"):
        Hub((name,))


def test_an_address_that_cannot_be_had_is_said(monkeypatch):
    monkeypatch.setattr(hub_server, "HOST", "192.0.2.1")  # RFC 5737: nobody's
    with pytest.raises(BusError, match=r"^hub 192\.0\.2\.1:0: "):
        asyncio.run(Hub().start(0))
