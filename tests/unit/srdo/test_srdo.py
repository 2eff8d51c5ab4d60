"""SRDOs of a node with two mapped objects: INTEGER16 0x2000 and UNSIGNED8 0x2001.

By the pre-defined set SRDO 1 of node 5 has the identifiers 0xFF + 2 x 5 = 0x109 and 0x10A. The
inverted frame is the plain one with every bit turned round: 0x34 0x12 0x07 and 0xCB 0xED 0xF8.
"""

import struct
from binascii import crc_hqx

import pytest

from hil_bench.abilities.srdo.nodes import services
from hil_bench.abilities.srdo.srdo import signature
from hil_bench.canopen_device.datatypes import INTEGER16, UNSIGNED8, UNSIGNED16, UNSIGNED32
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import Access, ObjectDictionary, Variable

NODE_ID, PLAIN, INVERTED = 5, 0x109, 0x10A
MS = 1_000_000
SENT, RECEIVED = 1, 2
START, STOP, PRE_OPERATIONAL, RESET = 1, 2, 128, 129
SCT, SRVT = 20, 5
CONFIGURATION, FAILED = 0x6300, 0x8F00
DEVICE_STATE = 0x08000022


def objects(direction, valid=0xA5):
    value = {"mappable": True, "access": Access.RWR if direction == SENT else Access.RWW}
    maps = [0x20000010, 0x20000010, 0x20010008, 0x20010008]
    return ObjectDictionary(
        [
            Variable(0x1000, 0, "type", UNSIGNED32),
            Variable(0x1001, 0, "errors", UNSIGNED8),
            Variable(0x1014, 0, "COB-ID EMCY", UNSIGNED32, default=0x85),
            Variable(0x1200, 1, "request", UNSIGNED32, default=0x605),
            Variable(0x1200, 2, "answer", UNSIGNED32, default=0x585),
            Variable(0x1301, 1, "direction", UNSIGNED8, default=direction),
            Variable(0x1301, 2, "SCT", UNSIGNED16, default=SCT),
            Variable(0x1301, 3, "SRVT", UNSIGNED8, default=SRVT),
            Variable(0x1301, 4, "type", UNSIGNED8, default=254),
            Variable(0x1301, 5, "plain", UNSIGNED32),
            Variable(0x1301, 6, "inverted", UNSIGNED32),
            Variable(0x1381, 0, "count", UNSIGNED8, default=4),
            *(
                Variable(0x1381, sub, f"map {sub}", UNSIGNED32, default=word)
                for sub, word in enumerate(maps, start=1)
            ),
            Variable(0x13FE, 0, "valid", UNSIGNED8, default=valid),
            Variable(0x13FF, 1, "signature", UNSIGNED16),
            Variable(
                0x2000, 0, "a", INTEGER16, default=0x1234 if direction == SENT else 0, **value
            ),
            Variable(0x2001, 0, "b", UNSIGNED8, default=7 if direction == SENT else 0, **value),
        ]
    )


class Rig:
    def __init__(self, od):
        self.od, self.node, self.now = od, Node(od, NODE_ID, added=services(od)), 0
        self.node.start(0)
        self.frames = []
        self.tick()

    def tick(self, count=1):
        """End this tick, whose frames have come, and begin the next one."""
        for _ in range(count):
            self.node.expire(self.now)
            self.node.serve(self.now, self.frames.append)
            self.now += MS

    def receive(self, can_id, data):
        handler = self.node.routes.get(can_id)
        if handler is not None:
            handler(Frame(can_id, bytes(data)), self.now)

    def nmt(self, command):
        self.receive(0x000, [command, NODE_ID])
        self.tick(2)

    def sent(self, *can_ids):
        taken = [frame for frame in self.frames if frame.can_id in can_ids]
        self.frames = []
        return taken

    def write(self, index, subindex, value, size):
        head = bytes([0x23 | (4 - size) << 2]) + index.to_bytes(2, "little") + bytes([subindex])
        self.receive(0x605, head + value.to_bytes(4, "little"))
        self.tick()
        (answer,) = self.sent(0x585)
        return int.from_bytes(answer.data[4:], "little") if answer.data[0] == 0x80 else None

    def emcy(self):
        return [int.from_bytes(frame.data[:2], "little") for frame in self.sent(0x85)]

    def pair(self, plain=b"\x34\x12\x07", inverted=b"\xcb\xed\xf8", wait=0):
        self.receive(PLAIN, plain)
        if wait:
            self.tick(wait)
        self.receive(INVERTED, inverted)

    def values(self):
        return self.od.number(0x2000), self.od.number(0x2001)


@pytest.fixture
def sender():
    rig = Rig(objects(SENT))
    rig.sent()
    return rig


@pytest.fixture
def receiver():
    rig = Rig(objects(RECEIVED))
    rig.nmt(START)
    rig.sent()
    return rig


def test_the_signature_covers_parameters_and_mapping():
    od = objects(SENT)
    Node(od, NODE_ID, added=services(od))
    raw = struct.pack("<BHBIIB", SENT, SCT, SRVT, PLAIN, INVERTED, 4)
    for sub, word in enumerate((0x20000010, 0x20000010, 0x20010008, 0x20010008), start=1):
        raw += struct.pack("<BI", sub, word)
    assert signature(od, 1) == crc_hqx(raw, 0)
    assert od.number(0x13FF, 1) == signature(od, 1)  # as the device is delivered


def test_a_sender_sends_pairs_each_refresh_time(sender):
    sender.tick(30)
    assert sender.sent(PLAIN, INVERTED) == []  # not in PRE-OPERATIONAL
    sender.nmt(START)
    sender.tick(60)
    frames = sender.sent(PLAIN, INVERTED)
    assert [frame.can_id for frame in frames] == [PLAIN, INVERTED] * 4  # at 0, 20, 40, 60 ms
    assert {frame.data for frame in frames[::2]} == {b"\x34\x12\x07"}
    assert {frame.data for frame in frames[1::2]} == {b"\xcb\xed\xf8"}
    sender.nmt(STOP)
    sender.tick(60)
    assert sender.sent(PLAIN, INVERTED) == []


@pytest.mark.parametrize(
    ("index", "subindex", "value", "size"),
    [(0x1301, 2, 50, 2), (0x1381, 1, 0x20010008, 4), (0x1301, 5, 0x119, 4)],
)
def test_a_write_makes_the_configuration_invalid(sender, index, subindex, value, size):
    assert sender.write(index, subindex, value, size) is None
    assert sender.od.number(0x13FE) == 0
    sender.nmt(START)
    sender.tick(30)
    assert sender.sent(PLAIN, INVERTED) == []


def test_an_unsigned_configuration_is_an_emcy_and_a_signed_one_works(sender):
    sender.write(0x1301, 2, 10, 2)
    sender.nmt(START)
    assert sender.emcy() == [CONFIGURATION]
    sender.nmt(PRE_OPERATIONAL)
    assert sender.write(0x13FF, 1, signature(sender.od, 1), 2) is None
    assert sender.write(0x13FE, 0, 0xA5, 1) is None
    sender.nmt(START)
    sender.tick(10)
    assert len(sender.sent(PLAIN, INVERTED)) == 4


def test_both_frames_of_a_pair_carry_the_same_objects(sender):
    sender.write(0x1381, 2, 0x20010008, 4)
    sender.write(0x13FF, 1, signature(sender.od, 1), 2)
    sender.write(0x13FE, 0, 0xA5, 1)
    sender.nmt(START)
    assert sender.emcy() == [CONFIGURATION]
    sender.tick(SCT)
    assert sender.sent(PLAIN, INVERTED) == []


def test_a_sender_a_whole_cycle_late_sends_one_pair_and_waits(sender):
    sender.nmt(START)
    sender.sent()
    sender.now += (2 * SCT - 2) * MS  # the next pair was due SCT after the start, two ticks ago
    sender.tick()
    assert len(sender.sent(PLAIN, INVERTED)) == 2
    sender.tick(SCT - 1)
    assert sender.sent(PLAIN, INVERTED) == []
    sender.tick()
    assert len(sender.sent(PLAIN, INVERTED)) == 2


def test_a_wrong_signature_is_not_valid(sender):
    sender.write(0x13FF, 1, signature(sender.od, 1) ^ 1, 2)
    sender.nmt(START)
    assert sender.emcy() == [CONFIGURATION]


def test_nothing_is_written_in_operational(sender):
    sender.nmt(START)
    for index, subindex, size in ((0x1301, 2, 2), (0x1381, 1, 4), (0x13FE, 0, 1), (0x13FF, 1, 2)):
        assert sender.write(index, subindex, 1, size) == DEVICE_STATE


def test_a_receiver_takes_a_pair_that_agrees(receiver):
    receiver.pair(wait=3)
    assert receiver.values() == (0x1234, 7)


def test_half_a_pair_changes_nothing(receiver):
    receiver.receive(PLAIN, b"\x34\x12\x07")
    assert receiver.values() == (0, 0)


@pytest.mark.parametrize(
    ("what", "ticks"),
    [
        ({"inverted": b"\xcb\xed\xf9"}, 1),  # a bit that is not inverted
        ({"plain": b"\x34\x12", "inverted": b"\xcb\xed"}, 1),
        ({"wait": SRVT + 1}, 1),  # too late
    ],
)
def test_a_pair_that_is_wrong_fails(receiver, what, ticks):
    receiver.pair(**what)
    receiver.tick(ticks)
    assert receiver.values() == (0, 0)
    assert FAILED in receiver.emcy()
    receiver.pair()  # nothing is taken any more
    assert receiver.values() == (0, 0)
    receiver.nmt(PRE_OPERATIONAL)
    receiver.nmt(START)
    receiver.pair()
    assert receiver.values() == (0x1234, 7)


def test_a_missing_second_frame_fails_in_the_tick_in_which_the_srvt_ends(receiver):
    receiver.receive(PLAIN, b"\x34\x12\x07")
    receiver.tick(SRVT)
    assert receiver.emcy() == []
    receiver.tick()
    assert receiver.emcy() == [FAILED]


def test_silence_fails_in_the_tick_in_which_the_sct_ends(receiver):
    receiver.pair()
    receiver.tick(SCT)
    assert receiver.emcy() == []
    receiver.tick()
    assert receiver.emcy() == [FAILED]


@pytest.mark.parametrize("before", [0, SRVT])
def test_pairs_at_the_sct_and_at_the_srvt_are_in_time(receiver, before):
    receiver.pair()
    for _ in range(3):
        receiver.tick(SCT - before)
        receiver.pair(wait=before)  # its second frame ends the pair
    assert receiver.emcy() == []
    assert receiver.values() == (0x1234, 7)


def test_a_pair_one_tick_after_the_sct_fails(receiver):
    receiver.pair()
    receiver.tick(SCT + 1)
    receiver.pair(b"\x35\x12\x07", b"\xca\xed\xf8")
    receiver.tick()
    assert receiver.values() == (0x1234, 7)
    assert receiver.emcy() == [FAILED]


def test_a_pair_after_the_sct_fails_where_the_node_has_not_looked_since(receiver):
    """A tick takes its frames before it looks at the time."""
    receiver.pair()
    receiver.now += (SCT + 1) * MS
    receiver.pair(b"\x35\x12\x07", b"\xca\xed\xf8")
    receiver.tick()
    assert receiver.values() == (0x1234, 7)
    assert receiver.emcy() == [FAILED]


def test_remote_and_29_bit_frames_are_none(receiver):
    for frame in (Frame(PLAIN, b"\x34\x12\x07", is_extended=True), Frame(PLAIN, is_remote=True)):
        receiver.node.routes[PLAIN](frame, receiver.now)
    receiver.receive(INVERTED, b"\xcb\xed\xf8")
    assert receiver.values() == (0, 0)


def test_identifiers_beyond_the_safety_range_are_none(sender):
    sender.write(0x1301, 5, 0x201, 4)
    sender.write(0x13FF, 1, signature(sender.od, 1), 2)
    sender.write(0x13FE, 0, 0xA5, 1)
    sender.nmt(START)
    assert sender.emcy() == [CONFIGURATION]


def test_a_node_that_is_off_or_has_none_is_silent():
    rig = Rig(objects(0))
    rig.nmt(START)
    rig.tick(50)
    assert rig.sent(PLAIN, INVERTED, 0x85) == []
