"""Random, truncated, oversized and pipelined frames: a session lives, and what it keeps is bounded.

Good clients beside bad ones are in test_simulation.
"""

import random

from hypothesis import given
from hypothesis import strategies as st

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
    assert [int.from_bytes(response[:2], "big") for response in written] == [*range(len(pdus)), 999]
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
