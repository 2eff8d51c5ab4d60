"""Random, truncated, oversized and pipelined frames, and a thousand connections left open.

Whatever comes, the server lives, its memory is bounded, and a good client is served.
"""

import asyncio
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.abilities.modbus.server.connections import ConnectionPool
from hil_bench.abilities.modbus.server.session import BACKLOG, crc16, serial_session, tcp_session

READ = bytes.fromhex("04 0000 0002")
ANSWER = bytes.fromhex("04 04 0001 0002")


def tcp(pdu, unit_id=1, transaction=7):
    return transaction.to_bytes(2, "big") + bytes([0, 0, 0, len(pdu) + 1, unit_id]) + pdu


def rtu(pdu, unit_id=1):
    body = bytes([unit_id]) + pdu
    return body + crc16(body)


PDUS = st.one_of(
    st.binary(min_size=1, max_size=253),
    # A function that there is, and anything behind it.
    st.builds(
        lambda function, rest: bytes([function]) + rest,
        st.sampled_from([1, 2, 3, 4, 5, 6, 15, 16, 43]),
        st.binary(max_size=252),
    ),
    # The form is right, the numbers are not.
    st.builds(
        lambda function, address, count: (
            bytes([function]) + address.to_bytes(2, "big") + count.to_bytes(2, "big")
        ),
        st.sampled_from([1, 2, 3, 4, 5, 6]),
        st.integers(0, 0xFFFF),
        st.integers(0, 0xFFFF),
    ),
)


@given(pdus=st.lists(PDUS, min_size=1, max_size=8), unit_id=st.integers(0, 255))
def test_every_request_gets_one_response_and_the_next_one_too(make_rig, pdus, unit_id):
    rig = make_rig()
    written = []
    session = tcp_session(rig.server, written.append)
    session.receive(b"".join(tcp(pdu, unit_id, number) for number, pdu in enumerate(pdus)))
    session.receive(tcp(READ, 1, 999))
    rig.serve(len(pdus) + 1)
    assert [int.from_bytes(response[:2], "big") for response in written] == [
        *range(len(pdus)),
        999,
    ]
    for pdu, response in zip(pdus, written, strict=False):
        assert response[6] == unit_id
        assert response[7] in {pdu[0], pdu[0] | 0x80}
        assert len(response) <= 260
    assert written[-1] == tcp(ANSWER, 1, 999)


@given(pieces=st.lists(st.binary(max_size=400), max_size=20))
def test_noise_on_tcp_ends_or_stays_small(make_rig, pieces):
    session = tcp_session(make_rig().server, lambda _: None)
    for piece in pieces:
        session.receive(piece)
        assert len(session._buffer) < BACKLOG + 400
        assert not (session.is_over and session._buffer)


@given(pieces=st.lists(st.binary(max_size=400), max_size=20))
def test_noise_on_a_line_is_over_with_the_next_silence(make_rig, pieces):
    rig = make_rig()
    written = []
    session = serial_session(rig.server, written.append)
    for piece in pieces:
        session.receive(piece)
        assert len(session._buffer) < BACKLOG + 400
    rig.serve(3)
    session.drop()
    written.clear()
    session.receive(rtu(READ))
    assert written == [rtu(ANSWER)]


@given(frames=st.integers(1, 12), lost=st.integers(0, 200), seed=st.integers(0, 1000))
def test_a_line_that_drops_bytes_answers_who_asks_again(make_rig, frames, lost, seed):
    rig = make_rig()
    written = []
    session = serial_session(rig.server, written.append)
    stream = bytearray(rtu(READ) * frames)
    dice = random.Random(seed)  # noqa: S311 - not for secrets
    for _ in range(min(lost, len(stream))):
        del stream[dice.randrange(len(stream))]
    session.receive(stream)
    session.drop()
    written.clear()
    session.receive(rtu(READ))
    assert written == [rtu(ANSWER)]


def bad_streams():
    """A few hundred things that no client should send, the same in every run."""
    dice = random.Random(4711)  # noqa: S311 - not for secrets
    good = tcp(READ)
    for size in (1, 7, 8, 12, 260, 1000, 5000):
        yield from (dice.randbytes(size) for _ in range(12))
    for cut in range(1, len(good)):
        yield good[:cut]
    for _ in range(100):
        damaged = bytearray(good * 3)
        for _ in range(dice.randrange(1, 6)):
            damaged[dice.randrange(len(damaged))] = dice.randrange(256)
        yield bytes(damaged)
    yield b"\0\1\0\0\xff\xff\1" + bytes(65000)  # says that it is long, and is
    yield b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"
    yield good * 2000


def serve(make_rig, scenario, limit):
    async def run():
        pool = ConnectionPool(make_rig().server, limit)
        loop = asyncio.get_running_loop()
        listener = await loop.create_server(pool.make_connection, "127.0.0.1", 0, backlog=128)
        try:
            await scenario(pool, listener.sockets[0].getsockname()[1])
        finally:
            pool.close()
            listener.close()
            await listener.wait_closed()

    asyncio.run(run())


async def ask(reader, writer):
    writer.write(tcp(READ))
    assert await reader.readexactly(len(tcp(ANSWER))) == tcp(ANSWER)


@pytest.mark.long
def test_a_good_client_is_served_beside_bad_ones(make_rig):
    async def scenario(pool, port):
        good = await asyncio.open_connection("127.0.0.1", port)
        await ask(*good)
        writers = [good[1]]
        for number, stream in enumerate(bad_streams()):
            writers.append((await asyncio.open_connection("127.0.0.1", port))[1])
            writers[-1].write(stream)
            await asyncio.sleep(0)
            if number % 3 == 0:
                writers[-1].transport.abort()  # the others stay, and read nothing
            await ask(*good)
            assert len(pool) <= 8
        for writer in writers:
            writer.transport.abort()

    serve(make_rig, scenario, limit=8)


@pytest.mark.long
def test_a_thousand_connections_left_open_keep_nobody_out(make_rig):
    async def scenario(pool, port):
        good = await asyncio.open_connection("127.0.0.1", port)
        await ask(*good)
        left = []
        for _ in range(20):
            left += await asyncio.gather(
                *(asyncio.open_connection("127.0.0.1", port) for _ in range(50))
            )
            await ask(*good)
            assert len(pool) <= 64
        late = await asyncio.open_connection("127.0.0.1", port)
        await ask(*late)
        await ask(*good)
        for _, writer in (*left, good, late):
            writer.transport.abort()

    serve(make_rig, scenario, limit=64)
