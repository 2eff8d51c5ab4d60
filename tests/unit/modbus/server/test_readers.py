"""A peer that may only read: each writing function gets exception 1, and no other does."""

import pytest

from hil_bench.abilities.modbus.server.session import Adu, RtuFraming, crc16, tcp_session

WRITING = {  # MODBUS Application Protocol V1.1b3: 6.5, 6.6, 6.11, 6.12, 6.16, 6.17
    5: "05 0000 FF00",
    6: "06 0000 0001",
    15: "0F 0000 0001 01 01",
    16: "10 0000 0001 02 0001",
    22: "16 0000 00F2 0025",
    23: "17 0000 0001 0000 0001 02 0001",
}


def tcp(unit_id, pdu):
    pdu = bytes.fromhex(pdu)
    return bytes([0, 1, 0, 0, 0, len(pdu) + 1, unit_id]) + pdu


@pytest.mark.parametrize("function", WRITING)
def test_who_may_not_write_gets_exception_1(rig, function):
    written = []
    session = tcp_session(rig.server, written.append, is_writer=False)
    session.receive(tcp(1, WRITING[function]))
    assert written == [tcp(1, f"{function | 0x80:02X} 01")]
    rig.tick()
    rig.server.poll()
    assert len(written) == 1


@pytest.mark.parametrize("function", [6, 16, 22, 23])
def test_who_may_write_gets_no_exception_1(rig, function):
    written = []
    session = tcp_session(rig.server, written.append)
    session.receive(tcp(1, WRITING[function]))
    rig.tick()
    rig.server.poll()
    assert written[0][7:9] != bytes([function | 0x80, 1])


# The last byte of each is the number of a function that writes.
@pytest.mark.parametrize("pdu", ["04 0000 0002", "2B 0E 01 05", "2B 0E 01 06", "2B 0E 01 10"])
def test_who_may_not_write_reads_what_others_read(rig, pdu):
    answers = []
    for is_writer in (True, False):
        written = []
        tcp_session(rig.server, written.append, is_writer=is_writer).receive(tcp(1, pdu))
        answers.append(written)
    assert answers[0] == answers[1]
    assert answers[0][0][7] == int(pdu[:2], 16)


# 7, 8, 11, 12, 17: functions that a serial line has and this server has not.
@pytest.mark.parametrize("body", ["01 07", "01 08 0000 A537", "01 0B", "01 0C", "01 11"])
def test_a_function_of_serial_lines_is_a_frame_at_once(body):
    body = bytes.fromhex(body)
    buffer = bytearray(body + crc16(body))
    assert RtuFraming().take(buffer) == Adu(1, body[1:])
    assert buffer == b""
