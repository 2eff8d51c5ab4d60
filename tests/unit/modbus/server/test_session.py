"""Bytes in, bytes out."""

import pytest

from hil_bench.abilities.modbus.server.session import BACKLOG, crc16, serial_session, tcp_session


def tcp(transaction, unit_id, pdu):
    pdu = bytes.fromhex(pdu)
    return bytes([0, transaction, 0, 0, 0, len(pdu) + 1, unit_id]) + pdu


def rtu(unit_id, pdu):
    body = bytes([unit_id]) + bytes.fromhex(pdu)
    return body + crc16(body)


@pytest.fixture
def written():
    return []


@pytest.fixture
def session(rig, written):
    return tcp_session(rig.server, written.append)


@pytest.fixture
def line(rig, written):
    return serial_session(rig.server, written.append)


def test_pipelined_requests_are_answered_one_by_one(session, written):
    session.receive(tcp(1, 1, "04 0000 0002") + tcp(2, 2, "03 0000 0001") + tcp(3, 9, "07"))
    assert written == [tcp(1, 1, "04 04 00010002"), tcp(2, 2, "03 02 0008"), tcp(3, 9, "87 0B")]


def test_a_request_byte_by_byte(session, written):
    for byte in tcp(1, 1, "04 0000 0002"):
        assert written == []
        session.receive(bytes([byte]))
    assert written == [tcp(1, 1, "04 04 00010002")]


def test_what_follows_a_write_waits_for_it(rig, session, written):
    session.receive(tcp(1, 1, "06 0000 0005") + tcp(2, 1, "04 0000 0002"))
    session.receive(tcp(3, 1, "06 0000 0006"))
    assert written == []
    rig.serve()
    assert written == [tcp(1, 1, "06 0000 0005"), tcp(2, 1, "04 04 00010002")]
    rig.serve()
    assert written[2:] == [tcp(3, 1, "06 0000 0006")]


def test_who_sends_on_while_a_write_waits_is_held_back(session):
    session.receive(tcp(1, 1, "06 0000 0005"))
    while not session.is_full:
        session.receive(tcp(2, 1, "04 0000 0002") * 10)
    assert len(session._buffer) < BACKLOG + 120


def test_a_stream_without_frames_ends_the_session_once(rig, written):
    reasons = []
    session = tcp_session(rig.server, written.append, on_failure=reasons.append)
    session.receive(b"GET / HTTP/1.1\r\n\r\n")
    session.receive(tcp(1, 1, "04 0000 0002"))
    assert reasons == ["47 45 54 20 2f 20 48 is not the header of a Modbus TCP frame"]
    assert session.is_over
    assert written == []


def test_garbage_behind_a_write_ends_its_own_session_only(rig, session, written):
    # One segment: a write that waits for the loop, and bytes that are no header behind it.
    reasons, others = [], []
    bad = tcp_session(rig.server, others.append, on_failure=reasons.append)
    bad.receive(tcp(1, 1, "06 0000 0005") + b"GARBAGE")
    session.receive(tcp(2, 1, "06 0000 0006"))
    assert reasons == []
    rig.serve(2)
    # The write was whole, so it is answered; then the session ends, and the other one goes on.
    assert others == [tcp(1, 1, "06 0000 0005")]
    assert reasons == ["47 41 52 42 41 47 45 is not the header of a Modbus TCP frame"]
    assert written == [tcp(2, 1, "06 0000 0006")]


def test_a_response_that_cannot_be_sent_ends_its_own_session_only(rig, session, written):
    def refuse(_response):
        raise OSError("the connection is gone")

    reasons = []
    bad = tcp_session(rig.server, refuse, on_failure=reasons.append)
    bad.receive(tcp(1, 1, "06 0000 0005"))
    session.receive(tcp(2, 1, "06 0000 0006"))
    rig.serve(2)
    assert reasons == ["internal error: OSError('the connection is gone')"]
    assert written == [tcp(2, 1, "06 0000 0006")]


def test_a_defect_of_ours_costs_one_session(rig, session, written, monkeypatch):
    reasons = []
    bad = tcp_session(rig.server, written.append, on_failure=reasons.append)
    monkeypatch.setattr(rig.server, "_answer", lambda *_: 1 / 0)
    bad.receive(tcp(1, 1, "04 0000 0002"))
    monkeypatch.undo()
    session.receive(tcp(2, 1, "04 0000 0002"))
    assert reasons == ["internal error: ZeroDivisionError('division by zero')"]
    assert written == [tcp(2, 1, "04 04 00010002")]


def test_a_reply_that_fails_keeps_no_other_from_its_own(rig, caplog):
    def refuse(_response):
        raise RuntimeError("nobody is there")

    responses = []
    rig.server.handle(1, bytes.fromhex("06 0000 0005"), refuse)
    rig.server.handle(1, bytes.fromhex("06 0000 0006"), responses.append)
    rig.serve(2)
    assert responses == [bytes.fromhex("06 0000 0006")]
    assert [record.message for record in caplog.records] == ["modbus: a write got no response"]


def test_an_answer_that_comes_after_the_end_goes_nowhere(rig, session, written):
    session.receive(tcp(1, 1, "06 0000 0005") + tcp(2, 1, "06 0000 0006"))
    session.end()
    assert rig.tick().assignments[0].value == 5.0
    rig.server.poll()
    assert written == []
    assert rig.tick() is None  # what waited behind the write is not obeyed any more


def test_a_line_goes_on_after_an_error(rig, written, monkeypatch):
    reasons = []
    line = serial_session(rig.server, written.append, on_failure=reasons.append)
    monkeypatch.setattr(rig.server, "_answer", lambda *_: 1 / 0)
    line.receive(rtu(1, "04 0000 0002"))
    monkeypatch.undo()
    line.receive(rtu(1, "04 0000 0002"))
    assert reasons == ["internal error: ZeroDivisionError('division by zero')"]
    assert written == [rtu(1, "04 04 00010002")]


def test_garbage_behind_a_write_costs_a_line_nothing(rig, line, written):
    line.receive(rtu(1, "06 0000 0005") + b"GARBAGE")
    rig.serve(2)
    assert written == [rtu(1, "06 0000 0005")]
    line.receive(rtu(1, "04 0000 0002"))
    assert written[1:] == [rtu(1, "04 04 00010002")]


def test_a_line_answers_for_its_own_units_only(line, written):
    line.receive(rtu(9, "04 0000 0002"))
    assert written == []
    line.receive(rtu(2, "04 0000 0002"))
    assert written == [rtu(2, "04 04 FFFFFFFF")]


REQUESTS = """01 0000 0001, 02 0000 0001, 03 0000 0001, 04 0000 0001, 05 0000 FF00, 06 0000 0005,
    07, 08 0000 0000, 0B, 0C, 0F 0000 0009 02 FF01, 10 0000 0001 02 0005, 11, 16 0000 FFFF 0000,
    17 0000 0001 0000 0001 02 0005, 2B 0E 01 00"""


@pytest.mark.parametrize("pdu", REQUESTS.split(","))
def test_a_line_finds_the_end_of_each_request(rig, line, written, pdu):
    """By the application protocol V1.1b3, chapter 6: it and the one behind it are answered."""
    line.receive(rtu(1, pdu) + rtu(1, "03 0000 0001"))
    rig.serve()
    assert len(written) == 2
    assert written[1][:3] == bytes.fromhex("010302")


def test_silence_ends_a_frame_that_lost_bytes(line, written):
    # A write of many registers of which the end is lost would swallow the requests behind it.
    line.receive(rtu(1, "10 0000 0002 04 00010002")[:-1])
    line.drop()
    line.receive(rtu(1, "04 0000 0002"))
    assert written == [rtu(1, "04 04 00010002")]


def test_a_broadcast_is_obeyed_by_all_and_answered_by_none(rig, line, written):
    line.receive(rtu(0, "06 0000 0005"))
    assert [rig.tick().assignments[0].value, rig.tick().assignments[0].value] == [5.0, 5.0]
    rig.server.poll()
    assert written == []


def test_other_devices_answers_are_no_requests(line, written):
    line.receive(rtu(9, "03 04 0001 0002"))
    line.receive(rtu(1, "04 0000 0002"))
    assert written == [rtu(1, "04 04 00010002")]


def test_silence_while_a_write_waits_drops_nothing(rig, line, written):
    line.receive(rtu(1, "06 0000 0005") + rtu(1, "04 0000 0002"))
    line.drop()
    rig.serve()
    assert written == [rtu(1, "06 0000 0005"), rtu(1, "04 04 00010002")]
