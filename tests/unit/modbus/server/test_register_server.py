"""Which response a request gets, and when."""

import pytest

from hil_bench.abilities.modbus.protocol.mailbox import SLOTS
from hil_bench.abilities.modbus.protocol.register_map import Assignment
from hil_bench.abilities.modbus.server.register_server import (
    ANSWER_TIMEOUT,
    MOST_WAITING,
    RegisterServer,
)
from hil_bench.abilities.modbus.server.session import Adu, RtuFraming, crc16, tcp_session

READ = bytes.fromhex("04 0000 0002")
WRITE = bytes.fromhex("06 0000 FFFE")


def ask(rig, unit_id, pdu):
    """The responses so far, in a list that later ones join."""
    responses = []
    rig.server.handle(unit_id, pdu, responses.append)
    return responses


def test_a_read_is_answered_at_once_from_the_newest_row(rig):
    assert ask(rig, 1, READ) == [bytes.fromhex("04 04 0001 0002")]
    assert ask(rig, 2, READ) == [bytes.fromhex("04 04 FFFF FFFF")]
    rig.tick(1.0, 0.0, 2.0, 0.0)
    assert ask(rig, 2, READ) == [bytes.fromhex("04 04 0000 0002")]


@pytest.mark.parametrize(
    ("unit_id", "pdu", "response"),
    [
        (1, "09 0000 0001", "89 01"),
        (1, "04 0000 0001", "84 02"),
        (1, "06 0001 0001", "86 02"),
        (1, "04 0000 0000", "84 03"),
        (3, "04 0000 0002", "84 0B"),
        (0, "04 0000 0002", "84 0B"),
        (1, "2B 0E 04 00", "2B 0E 04 82 00 00 01 00 05 6D616B6572"),
        (1, "2B 0F 04 00", "AB 01"),
        (1, "01 0000 0001", "81 02"),
    ],
)
def test_other_requests_are_answered_at_once_too(rig, unit_id, pdu, response):
    assert ask(rig, unit_id, bytes.fromhex(pdu)) == [bytes.fromhex(response)]


def test_a_write_is_answered_when_the_loop_has_taken_it(rig):
    responses = ask(rig, 2, WRITE)
    rig.server.poll()
    assert responses == []
    assert rig.server.is_waiting
    # Unit 2 has the second half of the row.
    assert rig.tick().assignments == [Assignment(3, -2.0)]
    rig.server.poll()
    assert responses == [WRITE]
    assert not rig.server.is_waiting


@pytest.mark.parametrize("code", [3, 4])
def test_what_the_device_refuses_is_refused(rig, code):
    responses = ask(rig, 1, WRITE)
    rig.tick(code=code)
    rig.server.poll()
    assert responses == [bytes([0x86, code])]


def test_writes_are_answered_in_their_order(rig):
    responses = []
    for value in range(3):
        rig.server.handle(1, bytes([6, 0, 0, 0, value]), responses.append)
    for answered in range(1, 4):
        rig.serve()
        assert [response[4] for response in responses] == list(range(answered))


def test_writes_that_find_no_room_in_the_mailbox_wait_in_their_order(rig):
    responses = []
    for value in range(3 * SLOTS):
        rig.server.handle(1, bytes([6, 0, 0, 0, value]), responses.append)
    taken = []
    while (order := rig.tick()) is not None:
        taken += [assignment.value for assignment in order.assignments]
        rig.server.poll()
    rig.server.poll()
    assert taken == [float(value) for value in range(3 * SLOTS)]
    assert [response[4] for response in responses] == list(range(3 * SLOTS))


def test_a_server_that_looks_seldom_misses_no_answer(rig):
    # Between two looks the loop answers more orders than the mailbox has slots, as room comes free
    # with each and new requests take it.
    responses = []
    for value in range(3 * SLOTS):
        rig.server.handle(1, bytes([6, 0, 0, 0, value]), responses.append)
        rig.serve()
    assert [response[4] for response in responses] == list(range(3 * SLOTS))


def test_more_writes_than_may_wait_are_told_busy(rig):
    waiting = [ask(rig, 1, WRITE) for _ in range(SLOTS + MOST_WAITING)]
    assert ask(rig, 1, WRITE) == [bytes.fromhex("86 06")]
    rig.serve()
    assert waiting[0] == [WRITE]
    assert ask(rig, 1, WRITE) == []


def test_a_write_that_waits_too_long_for_room_is_refused_and_not_obeyed_later(rig):
    first = [ask(rig, 1, WRITE) for _ in range(SLOTS)]
    late = ask(rig, 1, bytes.fromhex("06 0000 0007"))
    rig.now += ANSWER_TIMEOUT
    rig.server.poll()
    assert [*first, late] == [[bytes.fromhex("86 04")]] * (SLOTS + 1)
    for _ in range(SLOTS + 1):
        order = rig.tick()
        assert order is None or order.assignments == []
        rig.server.poll()


def test_a_write_that_the_loop_leaves_is_refused_and_not_obeyed_later(rig):
    responses = ask(rig, 1, WRITE)
    rig.now += ANSWER_TIMEOUT - 0.01
    rig.server.poll()
    assert responses == []
    rig.now += 0.02
    rig.server.poll()
    assert responses == [bytes.fromhex("86 04")]
    assert rig.tick().assignments == []
    rig.server.poll()
    assert responses == [bytes.fromhex("86 04")]


def test_without_a_row_there_is_no_value(rig):
    rig.row = None
    assert ask(rig, 1, READ) == [bytes.fromhex("84 04")]
    assert ask(rig, 1, WRITE) == [bytes.fromhex("86 04")]


def test_a_loop_that_stands_still_gives_no_values_until_it_moves(rig):
    rig.server.poll()
    rig.now += 0.49
    assert ask(rig, 1, READ)[0][0] == 4
    rig.now += 0.02
    assert ask(rig, 1, READ) == [bytes.fromhex("84 04")]
    rig.tick()
    assert ask(rig, 1, READ)[0][0] == 4


def test_a_loop_that_stood_still_while_nobody_asked_is_found_out_too(rig):
    rig.now += 0.4
    rig.tick()
    rig.server.poll()  # the process looks from time to time
    rig.now += 0.6
    assert ask(rig, 1, READ) == [bytes.fromhex("84 04")]


MASK = bytes.fromhex("16 0000 00F2 0025")
BOTH = bytes.fromhex("17 0000 0001 0000 0001 02 0009")  # writes register 0, then reads it


def test_a_mask_write_is_the_loops_to_carry_out(rig):
    responses = ask(rig, 1, MASK)
    assert rig.tick().assignments == [Assignment(1, 0xF2 << 16 | 0x25, is_mask=True)]
    rig.server.poll()
    assert responses == [MASK]


def test_function_23_reads_what_its_write_has_made(rig):
    responses = ask(rig, 1, BOTH)
    assert rig.tick(0.0, 9.0, 0.0, 0.0).assignments == [Assignment(1, 9.0)]
    rig.server.poll()
    assert responses == [bytes.fromhex("17 02 0009")]


@pytest.mark.parametrize(
    ("pdu", "response"),
    [
        ("17 0001 0001 0000 0001 02 0009", "97 02"),  # nothing to read there
        ("17 0000 0001 0001 0001 02 0009", "97 02"),  # nothing to write there
        ("16 0001 0000 0000", "96 02"),
    ],
)
def test_what_is_refused_is_refused_before_anything_is_written(rig, pdu, response):
    assert ask(rig, 1, bytes.fromhex(pdu)) == [bytes.fromhex(response)]
    assert rig.tick() is None


def test_a_loop_that_stops_between_the_write_and_the_read_gives_an_exception(rig):
    responses = ask(rig, 1, BOTH)
    rig.tick()
    rig.now += 0.6
    rig.row = None
    rig.server.poll()
    assert responses == [bytes.fromhex("97 04")]


@pytest.mark.parametrize("unit_id", [0, 255])
def test_the_default_unit_is_the_one_that_a_direct_connection_means(rig, unit_id):
    assert ask(rig, unit_id, READ) == [bytes.fromhex("84 0B")]
    server = RegisterServer(rig.server._units, rig, rig.mailbox, lambda: rig.now, default_unit=2)
    responses = []
    server.handle(unit_id, READ, responses.append)
    assert responses == [bytes.fromhex("04 04 FFFF FFFF")]
    assert server.unit_ids == {1, 2}


# A peer that may only read: each writing function gets exception 1, and no other does.


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
    rig.serve()
    assert len(written) == 1


@pytest.mark.parametrize("function", [6, 16, 22, 23])
def test_who_may_write_gets_no_exception_1(rig, function):
    written = []
    session = tcp_session(rig.server, written.append)
    session.receive(tcp(1, WRITING[function]))
    rig.serve()
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
