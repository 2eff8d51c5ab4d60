"""A node's connection to the bus."""

import pytest

from hil_bench.abilities.faults.checks import FaultDirection
from hil_bench.abilities.faults.line import Line, Meeting, babble, delay, loss, silence, truncation
from hil_bench.canopen_device.frame import Frame
from hil_bench.devices.measurement.low_pass import random_stream

MS = 1_000_000
FRAME = Frame(0x181, bytes(range(1, 9)))
OTHER = Frame(0x182, b"\x01")


class FakeNode:
    def __init__(self):
        self.received = []

    def receive(self, frame, now):
        self.received.append((frame, now // MS))


@pytest.fixture
def node():
    return FakeNode()


@pytest.fixture
def line(node):
    return Line(node)


def send(line, *frames, now=0):
    sent = []
    line.deliver(now)
    line.release(sent.append)
    emit = line.sender(sent.append)
    for frame in frames:
        emit(frame)
    return sent


def receive(line, *frames, now=0):
    taken = []
    take = line.guard(lambda frame, _now: taken.append(frame))
    for frame in frames:
        take(frame, now)
    return taken


def test_without_a_fault_frames_pass(line):
    assert send(line, FRAME, OTHER) == [FRAME, OTHER]
    assert receive(line, FRAME, OTHER) == [FRAME, OTHER]


def test_silence_lets_nothing_through(line):
    line.meetings.append(Meeting(silence))
    assert send(line, FRAME) == receive(line, FRAME) == []


@pytest.mark.parametrize(
    ("direction", "sent", "received"),
    [
        (FaultDirection.SENT, [], [FRAME]),
        (FaultDirection.RECEIVED, [FRAME], []),
        (FaultDirection.BOTH, [], []),
    ],
)
def test_a_fault_may_meet_one_direction_only(line, direction, sent, received):
    line.meetings.append(Meeting(silence, direction))
    assert send(line, FRAME) == sent
    assert receive(line, FRAME) == received


def test_a_fault_may_meet_one_identifier_only(line):
    line.meetings.append(Meeting(silence, can_id=0x181))
    assert send(line, FRAME, OTHER) == [OTHER]


def test_a_share_of_the_frames_is_lost(line):
    line.meetings.append(Meeting(loss(0.25, random_stream(1, "node"))))
    sent = send(line, *[FRAME] * 4000)
    # Five standard deviations of a binomial: 5 sqrt(4000 * 0.25 * 0.75) = 137.
    assert len(sent) == pytest.approx(3000, abs=137)


def test_late_frames_come_in_their_order_when_it_is_time(line, node):
    line.meetings.append(Meeting(delay(2 * MS)))
    assert send(line, FRAME, OTHER, now=1 * MS) == []
    assert send(line, now=2 * MS) == []
    assert send(line, OTHER, now=3 * MS) == [FRAME, OTHER]
    assert receive(line, FRAME, OTHER, now=1 * MS) == []
    line.deliver(2 * MS)
    assert node.received == []
    line.deliver(3 * MS)
    assert node.received == [(FRAME, 3), (OTHER, 3)]


def test_late_frames_come_though_the_fault_is_over(line):
    meeting = Meeting(delay(2 * MS))
    line.meetings.append(meeting)
    send(line, FRAME, now=1 * MS)
    line.meetings.remove(meeting)
    assert send(line, OTHER, now=3 * MS) == [FRAME, OTHER]


def test_two_delays_add_and_a_lost_frame_is_not_late(line):
    line.meetings += [Meeting(delay(MS)), Meeting(delay(MS)), Meeting(silence, can_id=0x182)]
    send(line, FRAME, OTHER, now=0)
    assert send(line, now=1 * MS) == []
    assert send(line, now=2 * MS) == [FRAME]


@pytest.mark.parametrize(("length", "data"), [(0, ""), (3, "010203"), (8, "0102030405060708")])
def test_frames_are_cut_to_a_length(line, length, data):
    line.meetings.append(Meeting(truncation(length)))
    assert send(line, FRAME) == [FRAME._replace(data=bytes.fromhex(data))]


def test_short_frames_are_filled_and_remote_frames_stay(line):
    line.meetings.append(Meeting(truncation(3)))
    remote = Frame(0x181, is_remote=True)
    assert send(line, OTHER, remote) == [Frame(0x182, b"\x01\x00\x00"), remote]


def test_a_babbling_node_sends_its_frames():
    sent = []
    babble(0x001, 3)(sent.append)
    assert [(frame.can_id, len(frame.data)) for frame in sent] == [(0x001, 8)] * 3
