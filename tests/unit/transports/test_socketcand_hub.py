"""The hub over real loopback sockets, in the test's own event loop.

What clients write and read is what python-can 4.6 and socketcand's doc/protocol.md have;
python-can's own client is the peer in test_hub_process.py.
"""

import asyncio
import contextlib
import re

import pytest

from hil_bench.abilities.common import socketcand_hub as protocol
from hil_bench.abilities.common.reception import ROOM
from hil_bench.abilities.common.socketcand_hub import MOST_BAD
from hil_bench.abilities.hub import server as socketcand_hub
from hil_bench.abilities.hub.server import MAX_CLIENTS, Hub, HubCounters
from hil_bench.errors import BusError
from hil_bench.outside.transports.socketcand_protocol import MAX_COMMAND

pytestmark = pytest.mark.anyio

TIME_STAMP = re.compile(rb"(< frame [0-9A-F]+ )\d+\.\d{6} ")


class Client:
    def __init__(self, reader, writer):
        self.reader = reader
        self.writer = writer

    async def say(self, text):
        self.writer.write(text)
        await self.writer.drain()

    async def hear(self):
        """Return the next message, the time stamp of a frame left out."""
        async with asyncio.timeout(10):
            message = await self.reader.readuntil(b">")
        return TIME_STAMP.sub(rb"\1", message)

    async def hear_end(self):
        """Wait until the hub has closed the connection."""
        async with asyncio.timeout(10):
            try:
                while await self.reader.read(65_536):
                    pass
            except ConnectionResetError:
                pass


class Place:
    """A hub and ways to join it."""

    def __init__(self, hub, port):
        self.hub = hub
        self.port = port
        self.clients = []

    async def connect(self):
        self.clients.append(Client(*await asyncio.open_connection("127.0.0.1", self.port)))
        return self.clients[-1]

    async def join(self, channel=b"can0"):
        client = await self.connect()
        assert await client.hear() == b"< hi >"
        await client.say(b"< open " + channel + b" >")
        assert await client.hear() == b"< ok >"
        await client.say(b"< rawmode >")
        assert await client.hear() == b"< ok >"
        return client


@contextlib.asynccontextmanager
async def a_hub(**options):
    hub = Hub(**options)
    server = await hub.start("127.0.0.1", 0)
    place = Place(hub, server.sockets[0].getsockname()[1])
    try:
        yield place
    finally:
        for client in place.clients:
            client.writer.close()
        server.close()


@pytest.fixture
def options():
    return {}


@pytest.fixture
async def place(options):
    async with a_hub(**options) as place:
        yield place


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
async def test_a_frame_reaches_the_others_and_not_its_sender(place, sent, heard):
    sender, first, second = [await place.join() for _ in range(3)]
    await sender.say(sent)
    assert await first.hear() == heard
    assert await second.hear() == heard
    await first.say(b"< send 001 0 >")
    assert await sender.hear() == b"< frame 001  >"  # the first thing it hears
    assert place.hub.counters == HubCounters(connections=3, frames=2)


async def test_a_frame_carries_the_time_in_seconds_and_microseconds(place, monkeypatch):
    monkeypatch.setattr(socketcand_hub.time, "time_ns", lambda: 1_700_000_000_000_042_999)
    sender, listener = await place.join(), await place.join()
    await sender.say(b"< send 123 1 1 >")
    async with asyncio.timeout(10):
        message = await listener.reader.readuntil(b">")
    assert message == b"< frame 123 1700000000.000042 01 >"


async def test_frames_keep_their_order_however_they_are_cut_up(place):
    sender, listener = await place.join(), await place.join()
    stream = b"".join(b"< send %03x 0  >" % n for n in range(200))
    for start in range(0, len(stream), 7):
        await sender.say(stream[start : start + 7])
    for n in range(200):
        assert await listener.hear() == b"< frame %03X  >" % n
    assert place.hub.counters.frames == 200


@pytest.mark.parametrize("options", [{"channels": ("can0", "can1")}])
async def test_channels_are_separate_buses(place):
    left, right = await place.join(b"can0"), await place.join(b"can1")
    listener = await place.join(b"can1")
    await left.say(b"< send 001 0 >")
    await right.say(b"< send 002 0 >")
    assert await listener.hear() == b"< frame 002  >"


@pytest.mark.parametrize("options", [{"channels": ("can0", "can1")}])
async def test_a_channel_that_is_not_there_is_refused_with_those_that_are(place):
    client = await place.connect()
    await client.hear()
    await client.say(b"< open vcan7 >")
    assert await client.hear() == b"< error could not open bus; this hub has can0, can1 >"
    await client.say(b"< open can1 >")
    assert await client.hear() == b"< ok >"
    assert place.hub.counters.bad_commands == 1


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
async def test_a_bad_command_is_answered_and_the_client_stays(place, bad):
    client, listener = await place.join(), await place.join()
    await client.say(bad)
    assert await client.hear() == b"< error unknown command >"
    await client.say(b"< send 001 0 >")
    assert await listener.hear() == b"< frame 001  >"
    assert place.hub.counters == HubCounters(connections=2, frames=1, bad_commands=1)


async def test_a_remote_frame_of_python_can_is_dropped_without_an_error(place):
    # python-can writes the length of what is asked for, and no bytes; an error would end its bus.
    client, listener = await place.join(), await place.join()
    await client.say(b"< send 701 1  >")
    await client.say(b"< send 001 0 >")
    assert await listener.hear() == b"< frame 001  >"
    await listener.say(b"< send 002 0 >")
    assert await client.hear() == b"< frame 002  >"
    assert place.hub.counters == HubCounters(connections=2, frames=2, bad_commands=1)


@pytest.mark.parametrize("early", [b"< rawmode >", b"< send 123 0 >", b"< open >", b"< open a b >"])
async def test_commands_out_of_turn_are_refused(place, early):
    client = await place.connect()
    await client.hear()
    await client.say(early)
    assert await client.hear() == b"< error unknown command >"


async def test_a_command_without_an_end_cuts_the_client_off_and_nobody_else(place):
    client, other, listener = [await place.join() for _ in range(3)]
    await client.say(b"< send " + b"1" * MAX_COMMAND)
    await client.hear_end()
    await other.say(b"< send 001 0 >")
    assert await listener.hear() == b"< frame 001  >"
    counters = place.hub.counters
    assert (counters.bad_commands, counters.dropped_clients) == (1, 1)


@pytest.mark.long
async def test_a_client_that_does_not_read_is_cut_off_and_others_lose_nothing(place, monkeypatch):
    monkeypatch.setattr(socketcand_hub, "MAX_BACKLOG", 10_000)
    frames = 2_000
    sender, slow, listener = [await place.join() for _ in range(3)]
    slow.writer.transport.pause_reading()
    n = 0
    while not place.hub.counters.dropped_clients:
        await sender.say(b"".join(b"< send 123 1 %x >" % (k % 256) for k in range(frames)))
        for k in range(frames):
            assert await listener.hear() == b"< frame 123 %02X >" % (k % 256)
        n += 1
        assert n < 1_000, "the kernel's buffers cannot hold 100 MB"
    assert place.hub.counters.dropped_clients == 1


async def test_frames_wait_until_a_new_client_has_read_the_answer_to_rawmode(place, monkeypatch):
    monkeypatch.setattr(protocol, "JOIN_DELAY", 3_600)
    sender, listener = await place.join(), await place.connect()
    for words in (b"< open can0 >", b"< rawmode >"):
        await listener.hear()
        await listener.say(words)
    while len(place.hub.bus("can0")) < 2:
        await asyncio.sleep(0)
    # Twice there and back: what the first frames brought has then reached the listener's end.
    for command in (b"< send 001 0 >< bad >", b"< send 002 0 >< bad >"):
        await sender.say(command)
        assert await sender.hear() == b"< error unknown command >"
    # python-can takes all that there is, and compares it with this.
    assert await listener.reader.read(256) == b"< ok >"
    await listener.say(b"< send 003 0 >")  # only now may frames follow
    assert await listener.hear() == b"< frame 001  >"
    assert await listener.hear() == b"< frame 002  >"
    assert await sender.hear() == b"< frame 003  >"


async def test_held_back_frames_follow_without_a_word_from_the_client(place, monkeypatch):
    monkeypatch.setattr(protocol, "JOIN_DELAY", 0.001)
    sender, listener = await place.join(), await place.join()
    await sender.say(b"< send 001 0 >")
    assert await listener.hear() == b"< frame 001  >"


async def test_a_client_that_leaves_is_forgotten(place):
    stays = await place.join()
    for _ in range(3 * MAX_CLIENTS):
        client = await place.join()
        client.writer.close()
        await client.writer.wait_closed()
    await stays.say(b"< send 001 0 >")
    await (await place.join()).say(b"< send 002 0 >")
    assert await stays.hear() == b"< frame 002  >"
    assert place.hub.counters.connections == 3 * MAX_CLIENTS + 2


async def test_thousands_of_connections_that_say_nothing_do_no_harm(place):
    for _ in range(3_000):
        _, writer = await asyncio.open_connection("127.0.0.1", place.port)
        writer.transport.abort()
    sender, listener = await place.join(), await place.join()
    await sender.say(b"< send 001 0 >")
    assert await listener.hear() == b"< frame 001  >"


@pytest.mark.parametrize("word", [b"", b"< open can0 >", b"garbage", b"\xff>"])
async def test_clients_that_never_join_keep_nobody_out_and_the_oldest_go(place, word):
    idlers = [await place.connect() for _ in range(ROOM + 9)]
    for idler in idlers:
        await idler.say(word)
    sender, listener = await place.join(), await place.join()
    for idler in idlers[:9]:
        await idler.hear_end()
    await sender.say(b"< send 001 0 >")
    assert await listener.hear() == b"< frame 001  >"
    assert place.hub.counters.dropped_clients >= 9


async def test_who_does_not_join_in_time_goes_and_a_silent_listener_stays():
    """5 s are those of `reception.PATIENCE`; the listener says nothing for an hour."""
    now = 0
    async with a_hub(clock=lambda: now) as place:
        listener, idler = await place.join(), await place.connect()
        assert await idler.hear() == b"< hi >"
        now += 4_999_999_999
        place.hub.waiting.look()
        sender = await place.join()
        assert place.hub.counters.dropped_clients == 0
        now += 1
        place.hub.waiting.look()
        await idler.hear_end()
        now += 3_600_000_000_000
        place.hub.waiting.look()
        await sender.say(b"< send 001 0 >")
        assert await listener.hear() == b"< frame 001  >"
    assert place.hub.counters.dropped_clients == 1


async def test_a_client_that_sends_nothing_but_nonsense_is_cut_off(place):
    client, listener = await place.join(), await place.join()
    await client.say((MOST_BAD - 1) * b"\xff>" + b"< send 001 0 >")
    assert await listener.hear() == b"< frame 001  >"
    await client.say(MOST_BAD * b"< send 7 9 >" + b"< send 002 0 >")
    await client.hear_end()
    await (await place.join()).say(b"< send 003 0 >")
    assert await listener.hear() == b"< frame 003  >"
    assert place.hub.counters.dropped_clients == 1


async def test_more_clients_than_there_is_room_for_are_turned_away(place):
    for _ in range(MAX_CLIENTS):
        await place.join()
    late = await place.connect()
    assert await late.hear() == b"< hi >"
    await late.say(b"< open can0 >")
    assert await late.hear() == b"< error too many clients >"
    await late.hear_end()
    place.clients[0].writer.close()
    await place.clients[0].writer.wait_closed()


@pytest.mark.parametrize("name", ["", "can 0", "a" * 16, "can0>", "kän"])
def test_a_channel_without_a_proper_name_is_refused(name):
    with pytest.raises(ValueError, match="1 to 15 letters"):
        Hub((name,))


async def test_a_port_in_use_is_said_in_one_line(place):
    with pytest.raises(BusError) as caught:
        await Hub().start("127.0.0.1", place.port)
    assert str(caught.value) == (
        f"hub 127.0.0.1:{place.port}: the port is in use, perhaps by another hub; "
        "port 0 takes a free one"
    )


async def test_an_address_that_is_not_this_machines_is_said():
    with pytest.raises(BusError, match=r"^hub 192\.0\.2\.1:0: "):  # RFC 5737: nobody's
        await Hub().start("192.0.2.1", 0)
