"""Frames in a stream, on TCP and on a serial line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.abilities.modbus.server.session import (
    Adu,
    FramingError,
    RtuFraming,
    TcpFraming,
    crc16,
)

READ = bytes.fromhex("03 006B 0003")
# MODBUS Messaging on TCP/IP V1.0b, 3.1.3: transaction, protocol 0, length with unit-ID, unit-ID.
TCP = bytes.fromhex("1501 0000 0006 FF") + READ
# The published example of an RTU request: unit 0x11 reads registers 0x6B to 0x6D, CRC 76 87.
RTU = bytes.fromhex("11 03 006B 0003 7687")


def take_all(framing, data):
    buffer, frames = bytearray(data), []
    while frame := framing.take(buffer):
        frames.append(frame)
    return frames, bytes(buffer)


def test_a_tcp_frame():
    assert take_all(TcpFraming(), TCP) == ([Adu(0xFF, READ, 0x1501)], b"")
    assert TcpFraming().wrap(Adu(0xFF, READ, 0x1501), b"\x83\x02") == bytes.fromhex(
        "1501 0000 0003 FF 83 02"
    )


def test_an_rtu_frame():
    assert take_all(RtuFraming(), RTU) == ([Adu(0x11, READ)], b"")
    assert RtuFraming().wrap(Adu(0x11, READ), READ) == RTU


def test_the_check_value_of_the_crc():
    # CRC-16/MODBUS in the catalogue of CRC algorithms: check 0x4B37 for "123456789".
    assert crc16(b"123456789") == bytes.fromhex("374B")


@pytest.mark.parametrize("framing", [TcpFraming(), RtuFraming()])
@pytest.mark.parametrize("cut", range(1, 8))
def test_a_frame_in_two_pieces(framing, cut):
    whole = TCP if isinstance(framing, TcpFraming) else RTU
    buffer = bytearray(whole[:cut])
    assert framing.take(buffer) is None
    buffer += whole[cut:]
    assert framing.take(buffer).pdu == READ


def test_pipelined_tcp_frames_come_in_their_order():
    frames, rest = take_all(TcpFraming(), TCP + TCP[:1] + b"\x02" + TCP[2:] + TCP[:9])
    assert [frame.transaction for frame in frames] == [0x1501, 0x1502]
    assert rest == TCP[:9]


@pytest.mark.parametrize(
    "header",
    [
        "0001 0001 0006 01",  # another protocol
        "0001 0000 0000 01",  # shorter than a unit-ID
        "0001 0000 0001 01",  # no function code
        "0001 0000 00FF 01",  # longer than 253 bytes of PDU and the unit-ID
        "0001 0000 FFFF 01",
    ],
)
def test_what_is_no_header_ends_the_stream(header):
    with pytest.raises(FramingError):
        TcpFraming().take(bytearray(bytes.fromhex(header)))


def test_the_longest_tcp_frame():
    pdu = bytes(253)
    (frame,), _ = take_all(TcpFraming(), bytes.fromhex("0001 0000 00FE 01") + pdu)
    assert frame.pdu == pdu


@pytest.mark.parametrize("noise", [b"\x00", b"\xff\xff\xff", b"\x11\x03\x00", bytes(40), RTU[:-1]])
def test_an_rtu_frame_is_found_behind_noise(noise):
    frames, rest = take_all(RtuFraming(), noise + RTU)
    assert (frames, rest) == ([Adu(0x11, READ)], b"")


@pytest.mark.parametrize("position", range(len(RTU)))
def test_a_bit_error_makes_an_rtu_frame_none(position):
    damaged = bytearray(RTU)
    damaged[position] ^= 0x10
    assert RtuFraming().take(damaged) is None


def test_a_long_rtu_write():
    body = bytes.fromhex("01 10 0000 007B F6") + bytes(246)
    whole = body + crc16(body)
    assert len(whole) == 255
    frames, _ = take_all(RtuFraming(), whole)
    assert frames == [Adu(1, whole[1:-2])]


@pytest.mark.parametrize(
    "body",
    [
        "01 16 0004 00F2 0025",
        "01 17 0003 0006 000E 0003 06 00FF 00FF 00FF",
        "01 17 0000 007D 0000 0079 F2" + 242 * "00",
        "01 2B 0E 01 00",
        "01 11",
    ],
)
def test_rtu_requests_of_every_length(body):
    body = bytes.fromhex(body)
    whole = body + crc16(body)
    assert len(whole) <= 256
    for cut in range(1, len(whole)):
        buffer = bytearray(whole[:cut])
        assert RtuFraming().take(buffer) is None
        buffer += whole[cut:]
        assert RtuFraming().take(buffer) == Adu(1, body[1:])


@given(st.binary(max_size=2000))
def test_noise_takes_no_more_room_than_a_frame(noise):
    buffer = bytearray(noise)
    while RtuFraming().take(buffer):
        pass
    assert len(buffer) <= 256


@given(st.lists(st.binary(min_size=1, max_size=300)))
def test_pieces_of_anything_give_frames_or_an_end(pieces):
    buffer = bytearray()
    for piece in pieces:
        buffer += piece
        try:
            while frame := TcpFraming().take(buffer):
                assert 1 <= len(frame.pdu) <= 253
        except FramingError:
            return
    assert len(buffer) < 260
