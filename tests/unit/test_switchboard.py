"""Nodes on buses: who hears whom, and in which order frames leave."""

from pathlib import Path

import pytest

from hil_bench.abilities.faults.line import Line, Meeting, delay, silence
from hil_bench.bench.switchboard import Switchboard
from hil_bench.canopen_device.agenda import Agenda
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.node import Node
from hil_bench.frame import address_of

EDS = Path(__file__).parent / "canopen_device" / "device.eds"
MS = 1_000_000
START = Frame(0x000, b"\x01\x00")
SYNC = Frame(0x080)


class Rig:
    """Nodes 5, 6 and following on buses of the given numbers, which have booted."""

    def __init__(self, *buses):
        agenda = Agenda()
        node_ids = range(5, 5 + len(buses))
        self.nodes = [Node(load_eds(EDS, n), n, agenda=agenda) for n in node_ids]
        self.board = Switchboard(dict(zip(self.nodes, buses, strict=True)), agenda)
        self.board.start(0)
        self.now = 0
        self.boot_ups = self.round()

    def round(self, *frames):
        """Do one round with all nodes; return what they send."""
        self.board.receive(frames, self.now, self.board.ports)
        sent = self.board.send(self.now, self.board.ports)
        self.now += MS
        return sent

    def fault(self, node, *rules):
        """Give the line of a node these faults."""
        line = Line(node)
        line.meetings += [Meeting(rule) for rule in rules]
        self.board.lay(self, {node: line})
        return line

    def start_synchronous(self):
        """Let the first TPDO of each node follow each SYNC, and no other be sent."""
        for node in self.nodes:
            node.object_dictionary.download(0x1800, 2, b"\x01")
            write_number(node, 0x1801, 1, 1 << 31 | 0x280 + node.node_id)
        self.round(*(START._replace(bus=frame.bus) for frame in self.boot_ups))
        self.round()


def write_number(node, index, subindex, value):
    """Write an UNSIGNED32 as SDO does."""
    node.object_dictionary.download(index, subindex, value.to_bytes(4, "little"))


@pytest.fixture
def pair():
    """Two nodes on one bus."""
    return Rig(0, 0)


@pytest.fixture
def apart():
    """A node on bus 0 and one on bus 2."""
    return Rig(0, 2)


def test_a_frame_has_the_number_of_its_senders_bus(apart):
    assert apart.boot_ups == [Frame(0x705, b"\0"), Frame(0x706, b"\0", bus=2)]


def test_a_frame_goes_to_the_nodes_of_its_bus(apart):
    assert 0x605 in apart.board.routes
    assert address_of(0x605, 2) not in apart.board.routes
    apart.round(START._replace(bus=2))
    assert [node.state.name for node in apart.nodes] == ["PRE_OPERATIONAL", "OPERATIONAL"]


def test_a_frame_that_nobody_takes_is_counted(pair):
    pair.round(Frame(0x7FF), Frame(0x080, is_extended=True), SYNC)
    assert pair.board.unrouted == 2


def test_frames_with_a_nodes_own_identifiers_from_elsewhere_are_counted(apart):
    """TPDO 1 of the node, its SDO answers, EMCY and heartbeat (CiA 301); no request to it."""
    first, second = apart.nodes
    write_number(first, 0x1800, 1, 0x185)
    apart.round()
    own = [Frame(0x185, b"\0"), Frame(0x585, bytes(8)), Frame(0x085, bytes(8)), Frame(0x705, b"\0")]
    apart.round(*own)
    assert (first.counters.foreign_frames, second.counters.foreign_frames) == (4, 0)
    apart.round(Frame(0x705, is_remote=True), Frame(0x605, bytes(8)), Frame(0x705, bus=2), SYNC)
    assert first.counters.foreign_frames == 4
    assert {frame.can_id for frame in own} <= set(apart.board.routes)  # what the kernel lets pass


def test_what_a_node_sends_to_another_is_not_foreign(pair):
    first, second = pair.nodes
    write_number(first, 0x1016, 1, 6 << 16 | 100)
    second.object_dictionary.download(0x1017, 0, (50).to_bytes(2, "little"))
    assert Frame(0x706, b"\x7f") in pair.round()
    pair.round()
    assert second.counters.foreign_frames == 0
    pair.round(Frame(0x706, b"\x7f"))
    assert second.counters.foreign_frames == 1


def test_a_node_hears_another_in_the_next_round(pair):
    first, second = pair.nodes
    write_number(first, 0x1016, 1, 6 << 16 | 100)
    second.object_dictionary.download(0x1017, 0, (50).to_bytes(2, "little"))
    assert Frame(0x706, b"\x7f") in pair.round()
    assert not pair.board.is_timeless(Frame(0x605, bytes(8)))
    assert pair.board.concerned([Frame(0x605, bytes(8))]) is pair.board.ports
    pair.round()
    second.object_dictionary.download(0x1017, 0, bytes(2))
    pair.now += 100 * MS  # the time of 0x1016.01 after the heartbeat that was heard
    pair.round()
    assert 0x8130 in first.emcy.present


def test_what_was_heard_acts_before_what_came_since(pair):
    _, second = pair.nodes
    pair.start_synchronous()
    write_number(second, 0x1400, 1, 1 << 31 | 0x206)
    write_number(second, 0x1400, 1, 0x185)  # the first node's TPDO
    assert pair.round(SYNC)[0].can_id == 0x185
    pair.round(Frame(0x185, bytes.fromhex("34120000")))
    assert second.object_dictionary.variable(0x2000).value == 0x1234


def test_a_remote_frame_settles_nothing(pair):
    pair.start_synchronous()
    pair.board.receive([SYNC, Frame(0x080, is_remote=True)], pair.now, pair.board.ports)
    node = pair.nodes[0]
    entry = node.object_dictionary.number(0x1A00, 1)
    node.object_dictionary.variable(entry >> 16, entry >> 8 & 0xFF).value = 0x12
    sent = pair.board.send(pair.now, pair.board.ports)
    assert sent[0].data[0] == 0x12  # as at the end of the round


def test_a_request_that_another_node_takes_as_data_is_not_timeless(pair):
    first, second = pair.nodes
    write_number(first, 0x1201, 1, 0x681)
    write_number(first, 0x1201, 2, 0x682)
    pair.round()
    assert pair.board.is_timeless(Frame(0x681, bytes(8)))
    write_number(second, 0x1400, 1, 1 << 31 | 0x206)
    write_number(second, 0x1400, 1, 0x681)
    pair.round()
    assert not pair.board.is_timeless(Frame(0x681, bytes(8)))


def test_a_request_concerns_one_node(pair):
    request = Frame(0x606, bytes.fromhex("4000100000000000"))
    (port,) = pair.board.concerned([request])
    assert port.node is pair.nodes[1]
    assert pair.board.concerned([request, request]) is pair.board.ports
    assert pair.board.concerned([Frame(0x606, is_extended=True)]) == ()
    assert pair.board.concerned([Frame(0x7FF)]) == ()


def test_with_a_fault_on_a_line_every_node_is_concerned(pair):
    pair.fault(pair.nodes[0])
    assert pair.board.concerned([Frame(0x606, bytes(8))]) is pair.board.ports


def test_a_changed_identifier_is_followed(pair):
    before = pair.board.routes
    pair.round(Frame(0x605, bytes.fromhex("2305100090000000")))  # 0x1005 = 0x90
    assert pair.board.routes is not before
    assert {0x080, 0x090} <= pair.board.routes.keys()


def test_each_sync_of_a_round_has_its_pdos_before_those_of_the_next(pair):
    pair.start_synchronous()
    assert [frame.can_id for frame in pair.round(SYNC, SYNC)] == [0x185, 0x186] * 2


def test_a_line_loses_what_its_fault_loses_and_no_other(pair):
    pair.start_synchronous()
    pair.fault(pair.nodes[0], silence)
    assert [frame.can_id for frame in pair.round(SYNC)] == [0x186]
    pair.board.lay(pair, {})
    assert [frame.can_id for frame in pair.round(SYNC)] == [0x185, 0x186]


def test_late_frames_come_after_what_is_settled_and_before_what_is_new(apart):
    # Node 6 sends 2 ms late, and SYNC reaches it in time: only what it sends meets the fault.
    apart.start_synchronous()
    _, node = apart.nodes
    line = apart.fault(node)
    late = Meeting(delay(2 * MS), can_id=0x186)
    line.meetings.append(late)
    sync = SYNC._replace(bus=2)
    assert apart.round(sync) == []
    line.meetings.remove(late)
    apart.round()
    apart.board.emit(Frame(0x555))  # of this round, from no node
    sent = apart.round(sync)
    assert [(frame.can_id, frame.bus) for frame in sent] == [(0x555, 0), (0x186, 2), (0x186, 2)]


def test_late_frames_of_a_node_come_before_its_settled_ones(pair):
    pair.start_synchronous()
    line = pair.fault(pair.nodes[0])
    late = Meeting(delay(MS), can_id=0x185)
    line.meetings.append(late)
    assert [frame.can_id for frame in pair.round(SYNC)] == [0x186]
    line.meetings.remove(late)
    # The late one, then those of the first SYNC, then those of the second.
    assert [frame.can_id for frame in pair.round(SYNC, SYNC)] == [0x185, *[0x185, 0x186] * 2]


def test_a_late_frame_reaches_its_node(pair):
    pair.fault(pair.nodes[0], delay(2 * MS))
    pair.round(START)
    assert [node.state.name for node in pair.nodes] == ["PRE_OPERATIONAL", "OPERATIONAL"]
    pair.round()
    pair.round()
    assert pair.nodes[0].state.name == "OPERATIONAL"
