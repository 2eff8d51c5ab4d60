"""Connections over loopback, in one event loop; nothing waits for the time to pass."""

import asyncio
import re
import socket
import struct

import pytest

from hil_bench.abilities.modbus.server import connections
from hil_bench.abilities.modbus.server.connections import INTERVAL, Complaints, ConnectionPool

READ = bytes.fromhex("0001 0000 0006 01 04 0000 0002")
ANSWER = bytes.fromhex("0001 0000 0007 01 04 04 0001 0002")


def with_pool(rig, scenario, limit=4):
    """Run a scenario, given the pool and what opens a connection to it."""

    async def run():
        pool = ConnectionPool(rig.server, limit)
        loop = asyncio.get_running_loop()
        listener = await loop.create_server(pool.make_connection, "127.0.0.1", 0)
        port = listener.sockets[0].getsockname()[1]
        writers = []

        async def connect(receive_buffer=65536):
            client = socket.socket()
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
            client.setblocking(False)
            await loop.sock_connect(client, ("127.0.0.1", port))
            reader, writer = await asyncio.open_connection(sock=client)
            writers.append(writer)
            return reader, writer

        try:
            return await scenario(pool, connect)
        finally:
            pool.close()
            for writer in writers:
                writer.transport.abort()
            listener.close()
            await listener.wait_closed()

    return asyncio.run(run())


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


def test_requests_are_answered(rig):
    async def scenario(_pool, connect):
        first, second = await connect(), await connect()
        return [await ask(first), await ask(second), await ask(first)]

    assert with_pool(rig, scenario) == [ANSWER] * 3


def test_what_is_no_modbus_is_cut_off(rig):
    async def scenario(pool, connect):
        stream = await connect()
        stream[1].write(b"GET / HTTP/1.1\r\n\r\n")
        assert await is_closed(stream)
        assert await ask(await connect()) == ANSWER
        return len(pool)

    assert with_pool(rig, scenario) == 1


def test_who_never_asks_makes_room_for_who_does(rig):
    async def scenario(pool, connect):
        good = await connect()
        await ask(good)
        idle = [await connect() for _ in range(20)]
        late = await connect()
        assert await ask(late) == ANSWER
        assert await ask(good) == ANSWER
        assert all([await is_closed(stream) for stream in idle[:16]])
        return len(pool)

    assert with_pool(rig, scenario) <= 4


def test_busy_clients_are_not_put_out_for_another(rig):
    async def scenario(_pool, connect):
        good = [await connect() for _ in range(4)]
        for stream in good:
            await ask(stream)
        assert await is_closed(await connect())
        return [await ask(stream) for stream in good]

    assert with_pool(rig, scenario) == [ANSWER] * 4


def test_the_one_that_was_quiet_longest_goes_when_that_is_long(rig, monkeypatch):
    async def scenario(_pool, connect):
        good = [await connect() for _ in range(4)]
        for stream in [*good, good[0]]:
            await ask(stream)
        monkeypatch.setattr(connections, "QUIET_TIME", 0.0)
        assert await ask(await connect()) == ANSWER
        assert await is_closed(good[1])
        return await ask(good[0])

    assert with_pool(rig, scenario) == ANSWER


def test_who_does_not_read_is_asked_no_more_and_holds_nobody_up(rig):
    async def scenario(pool, connect):
        slow, good = await connect(4096), await connect()
        slow[1].transport.pause_reading()
        for _ in range(200):
            slow[1].write(READ * 500)
            await asyncio.sleep(0)
            assert await ask(good) == ANSWER
        (held, _) = pool._connections
        assert not held._is_reading
        # What it may leave unread, and one chunk of requests behind that.
        return held._transport.get_write_buffer_size()

    assert with_pool(rig, scenario) < 16 * 1024 + 2048


def test_who_does_not_read_for_long_is_cut_off(rig, monkeypatch):
    monkeypatch.setattr(connections, "PATIENCE", 0.0)

    async def scenario(pool, connect):
        slow = await connect(4096)
        slow[1].transport.pause_reading()
        while len(pool) or not slow[1].transport.is_closing():
            try:
                slow[1].write(READ * 5000)
                await slow[1].drain()
            except ConnectionError:
                break
        return len(pool)

    assert with_pool(rig, scenario) == 0


def test_who_reads_again_is_asked_again(rig):
    async def scenario(pool, connect):
        stream = await connect(4096)
        stream[1].transport.pause_reading()
        requests = 20_000
        stream[1].write(READ * requests)
        while not pool._connections or next(iter(pool._connections))._is_reading:
            await asyncio.sleep(0)
        stream[1].transport.resume_reading()
        for _ in range(requests):
            assert await stream[0].readexactly(len(ANSWER)) == ANSWER
        return True

    assert with_pool(rig, scenario)


def test_a_client_that_goes_away_is_forgotten(rig):
    async def scenario(pool, connect):
        stream = await connect()
        await ask(stream)
        stream[1].close()
        while len(pool):
            await asyncio.sleep(0)
        return True

    assert with_pool(rig, scenario)


@pytest.mark.parametrize("gone", [False, True])
def test_an_answer_that_comes_late_finds_its_client_or_nobody(rig, gone):
    write = bytes.fromhex("0001 0000 0006 01 06 0000 0005")

    async def scenario(pool, connect):
        stream = await connect()
        stream[1].write(write)
        while not rig.server.is_waiting:
            await asyncio.sleep(0)
        if gone:
            reset(stream)
            while len(pool):
                await asyncio.sleep(0)
        rig.tick()
        rig.server.poll()
        return None if gone else await stream[0].readexactly(12)

    assert with_pool(rig, scenario) == (None if gone else write)


def test_who_sends_on_while_a_write_waits_is_read_no_further_until_it_is_answered(rig):
    write = bytes.fromhex("0001 0000 0006 01 06 0000 0005")
    reads = 1000

    async def scenario(pool, connect):
        reader, writer = await connect()
        writer.write(write + READ * reads)
        while not rig.server.is_waiting or next(iter(pool._connections))._is_reading:
            await asyncio.sleep(0)
        (held,) = pool._connections
        assert len(held._session._buffer) < 2048 + 1024
        rig.tick()
        rig.server.poll()
        assert await reader.readexactly(12) == write
        for _ in range(reads):
            assert await reader.readexactly(len(ANSWER)) == ANSWER
        return held._is_reading

    assert with_pool(rig, scenario)


WRITE = bytes.fromhex("0001 0000 0006 01 06 0000 0005")


def test_garbage_behind_a_write_closes_its_own_connection_and_says_whose(rig, caplog):
    async def scenario(_pool, connect):
        good, bad = await connect(), await connect()
        bad[1].write(WRITE + b"GARBAGE")
        while not rig.server.is_waiting:
            await asyncio.sleep(0)
        rig.tick()
        rig.server.poll()
        assert await bad[0].readexactly(len(WRITE)) == WRITE
        assert await is_closed(bad)
        return await ask(good)

    assert with_pool(rig, scenario) == ANSWER
    assert messages(caplog) == [
        "modbus client PEER: closed: 47 41 52 42 41 47 45 is not the header of a Modbus TCP frame"
    ]


def test_a_connection_that_is_reset_is_named(rig, caplog):
    async def scenario(pool, connect):
        stream = await connect()
        await ask(stream)
        reset(stream)
        while len(pool):
            await asyncio.sleep(0)
        return await ask(await connect())

    assert with_pool(rig, scenario) == ANSWER
    assert messages(caplog) == ["modbus client PEER: lost: Connection reset by peer"]


def test_many_bad_clients_get_few_lines(rig, caplog):
    async def scenario(pool, connect):
        for _ in range(50):
            stream = await connect()
            stream[1].write(b"GET / HTTP/1.1\r\n\r\n")
            assert await is_closed(stream)
        return pool.complaints.count

    assert with_pool(rig, scenario) == 50
    assert 1 <= len(caplog.records) < 50


def test_who_has_closed_for_requests_gets_the_responses_that_are_due(rig):
    async def scenario(pool, connect):
        reader, writer = await connect()
        writer.write(WRITE + READ + READ)
        writer.write_eof()
        while not rig.server.is_waiting:
            await asyncio.sleep(0)
        rig.tick()
        rig.server.poll()
        received = await reader.read()
        while len(pool):
            await asyncio.sleep(0)
        return received

    assert with_pool(rig, scenario) == WRITE + ANSWER + ANSWER


def test_errors_that_got_no_line_are_counted_in_the_next(caplog):
    times = [share * INTERVAL for share in (0.0, 0.1, 0.9, 1.0, 1.5, 2.0, 3.0)]
    now = iter(times)
    complaints = Complaints(lambda: next(now))
    for _ in times:
        complaints.add("peer", "why")
    assert complaints.count == 7
    assert [record.getMessage() for record in caplog.records] == [
        "modbus client peer: why",
        "modbus client peer: why (2 more errors since the last line)",
        "modbus client peer: why (1 more errors since the last line)",
        "modbus client peer: why",
    ]
