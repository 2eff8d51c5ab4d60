"""Connections over loopback, in one event loop; nothing waits for the time to pass."""

import asyncio
import re
import socket
import struct

import pytest

from hil_bench.abilities.modbus.server import connections
from hil_bench.abilities.modbus.server.connections import INTERVAL, Complaints, ConnectionPool

pytestmark = pytest.mark.anyio

READ = bytes.fromhex("0001 0000 0006 01 04 0000 0002")
ANSWER = bytes.fromhex("0001 0000 0007 01 04 04 0001 0002")


@pytest.fixture
async def pool(rig):
    """The connections of a server that takes four."""
    pool = ConnectionPool(rig.server, 4)
    yield pool
    pool.close()


@pytest.fixture
async def connect(pool):
    """Opens a connection to it."""
    loop = asyncio.get_running_loop()
    listener = await loop.create_server(pool.make_connection, "127.0.0.1", 0)
    address = listener.sockets[0].getsockname()
    writers = []

    async def connect(receive_buffer=65536):
        client = socket.socket()
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        client.setblocking(False)
        await loop.sock_connect(client, address)
        reader, writer = await asyncio.open_connection(sock=client)
        writers.append(writer)
        return reader, writer

    yield connect
    pool.close()
    for writer in writers:
        writer.transport.abort()
    listener.close()
    await listener.wait_closed()


async def ask(stream):
    reader, writer = stream
    writer.write(READ)
    return await reader.readexactly(len(ANSWER))


async def is_closed(stream):
    try:
        return await stream[0].read(1) == b""
    except ConnectionError:
        return True


def reset(stream):
    """Cut a connection so that the other end sees an error, not an end."""
    connection = stream[1].get_extra_info("socket")
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    stream[1].transport.abort()


def messages(caplog):
    """The lines about bad clients, without their ports, which differ."""
    return [re.sub(r"127.0.0.1:\d+", "PEER", record.message) for record in caplog.records]


async def test_requests_are_answered(connect):
    first, second = await connect(), await connect()
    assert [await ask(first), await ask(second), await ask(first)] == [ANSWER] * 3


async def test_what_is_no_modbus_is_cut_off(pool, connect):
    stream = await connect()
    stream[1].write(b"GET / HTTP/1.1\r\n\r\n")
    assert await is_closed(stream)
    assert await ask(await connect()) == ANSWER
    assert len(pool) == 1


async def test_who_never_asks_makes_room_for_who_does(pool, connect):
    good = await connect()
    await ask(good)
    idle = [await connect() for _ in range(20)]
    late = await connect()
    assert await ask(late) == ANSWER
    assert await ask(good) == ANSWER
    assert all([await is_closed(stream) for stream in idle[:16]])
    assert len(pool) <= 4


async def test_busy_clients_are_not_put_out_for_another(connect):
    good = [await connect() for _ in range(4)]
    for stream in good:
        await ask(stream)
    assert await is_closed(await connect())
    assert [await ask(stream) for stream in good] == [ANSWER] * 4


async def test_the_one_that_was_quiet_longest_goes_when_that_is_long(monkeypatch, connect):
    good = [await connect() for _ in range(4)]
    for stream in [*good, good[0]]:
        await ask(stream)
    monkeypatch.setattr(connections, "QUIET_TIME", 0.0)
    assert await ask(await connect()) == ANSWER
    assert await is_closed(good[1])
    assert await ask(good[0]) == ANSWER


async def test_who_does_not_read_is_asked_no_more_and_holds_nobody_up(pool, connect):
    slow, good = await connect(4096), await connect()
    slow[1].transport.pause_reading()
    for _ in range(200):
        slow[1].write(READ * 500)
        await asyncio.sleep(0)
        assert await ask(good) == ANSWER
    (held, _) = pool._connections
    assert not held._is_reading
    # What it may leave unread, and one chunk of requests behind that.
    assert held._transport.get_write_buffer_size() < 16 * 1024 + 2048


async def test_who_does_not_read_for_long_is_cut_off(monkeypatch, pool, connect):
    monkeypatch.setattr(connections, "PATIENCE", 0.0)
    slow = await connect(4096)
    slow[1].transport.pause_reading()
    while len(pool) or not slow[1].transport.is_closing():
        try:
            slow[1].write(READ * 5000)
            await slow[1].drain()
        except ConnectionError:
            break
    assert len(pool) == 0


async def test_who_reads_again_is_asked_again(pool, connect):
    stream = await connect(4096)
    stream[1].transport.pause_reading()
    requests = 20_000
    stream[1].write(READ * requests)
    while not pool._connections or next(iter(pool._connections))._is_reading:
        await asyncio.sleep(0)
    stream[1].transport.resume_reading()
    for _ in range(requests):
        assert await stream[0].readexactly(len(ANSWER)) == ANSWER


async def test_a_client_that_goes_away_is_forgotten(pool, connect):
    stream = await connect()
    await ask(stream)
    stream[1].close()
    while len(pool):
        await asyncio.sleep(0)


@pytest.mark.parametrize("gone", [False, True])
async def test_an_answer_that_comes_late_finds_its_client_or_nobody(rig, gone, pool, connect):
    write = bytes.fromhex("0001 0000 0006 01 06 0000 0005")
    stream = await connect()
    stream[1].write(write)
    while not rig.server.is_waiting:
        await asyncio.sleep(0)
    if gone:
        reset(stream)
        while len(pool):
            await asyncio.sleep(0)
    rig.serve()
    if not gone:
        assert await stream[0].readexactly(12) == write


async def test_who_sends_on_while_a_write_waits_is_read_no_further_until_it_is_answered(
    rig, pool, connect
):
    write = bytes.fromhex("0001 0000 0006 01 06 0000 0005")
    reads = 1000
    reader, writer = await connect()
    writer.write(write + READ * reads)
    while not rig.server.is_waiting or next(iter(pool._connections))._is_reading:
        await asyncio.sleep(0)
    (held,) = pool._connections
    assert len(held._session._buffer) < 2048 + 1024
    rig.serve()
    assert await reader.readexactly(12) == write
    for _ in range(reads):
        assert await reader.readexactly(len(ANSWER)) == ANSWER
    assert held._is_reading


WRITE = bytes.fromhex("0001 0000 0006 01 06 0000 0005")


async def test_garbage_behind_a_write_closes_its_own_connection_and_says_whose(
    rig, connect, caplog
):
    good, bad = await connect(), await connect()
    bad[1].write(WRITE + b"GARBAGE")
    while not rig.server.is_waiting:
        await asyncio.sleep(0)
    rig.serve()
    assert await bad[0].readexactly(len(WRITE)) == WRITE
    assert await is_closed(bad)
    assert await ask(good) == ANSWER
    assert messages(caplog) == [
        "modbus client PEER: closed: 47 41 52 42 41 47 45 is not the header of a Modbus TCP frame"
    ]


async def test_a_connection_that_is_reset_is_named(pool, connect, caplog):
    stream = await connect()
    await ask(stream)
    reset(stream)
    while len(pool):
        await asyncio.sleep(0)
    assert await ask(await connect()) == ANSWER
    assert messages(caplog) == ["modbus client PEER: lost: Connection reset by peer"]


async def test_many_bad_clients_get_few_lines(connect, caplog):
    for _ in range(50):
        stream = await connect()
        stream[1].write(b"GET / HTTP/1.1\r\n\r\n")
        assert await is_closed(stream)
    assert 1 <= len(caplog.records) < 50


async def test_who_has_closed_for_requests_gets_the_responses_that_are_due(rig, pool, connect):
    reader, writer = await connect()
    writer.write(WRITE + READ + READ)
    writer.write_eof()
    while not rig.server.is_waiting:
        await asyncio.sleep(0)
    rig.serve()
    received = await reader.read()
    while len(pool):
        await asyncio.sleep(0)
    assert received == WRITE + ANSWER + ANSWER


def test_errors_that_got_no_line_are_counted_in_the_next(caplog):
    times = [share * INTERVAL for share in (0.0, 0.1, 0.9, 1.0, 1.5, 2.0, 3.0)]
    now = iter(times)
    complaints = Complaints(lambda: next(now))
    for _ in times:
        complaints.add("peer", "why")
    assert [record.getMessage() for record in caplog.records] == [
        "modbus client peer: why",
        "modbus client peer: why (2 more errors since the last line)",
        "modbus client peer: why (1 more errors since the last line)",
        "modbus client peer: why",
    ]
