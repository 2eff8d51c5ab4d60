import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.canopen_device.agenda import NEVER
from hil_bench.canopen_device.datatypes import UNSIGNED32
from hil_bench.canopen_device.events import NodeEvent, NodeEventKind
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.errors import ConfigError


@pytest.mark.parametrize("node_id", [0, 128])
def test_node_id_is_checked(object_dictionary, node_id):
    with pytest.raises(ConfigError, match="use 1 to 127"):
        Node(object_dictionary, node_id)


def test_silent_until_started(object_dictionary):
    node, sent = Node(object_dictionary, 5), []
    node.receive(Frame(0, b"\x01\x00"), 0)
    node.serve(0, sent.append)
    assert (sent, node.state, node.deadline) == ([], NmtState.INITIALISING, NEVER)


@pytest.mark.parametrize(
    ("startup", "state"),
    [  # CiA 302-2, 0x1F80 bit 2: 0 enters OPERATIONAL by itself, 1 does not.
        (0x00000000, NmtState.OPERATIONAL),
        (0x00000004, NmtState.PRE_OPERATIONAL),
    ],
)
def test_startup(object_dictionary, startup, state):
    startup_object = Variable(0x1F80, 0, "NMT startup", UNSIGNED32, default=startup)
    node, sent = Node(ObjectDictionary([*object_dictionary, startup_object]), 5), []
    node.start(0)
    node.serve(0, sent.append)
    assert node.state is state
    assert sent == [Frame(0x705, b"\x00")]


def test_deadline_is_the_next_heartbeat(rig):
    rig.node.object_dictionary.download(0x1017, 0, (100).to_bytes(2, "little"))
    assert rig.node.deadline == 0
    rig.run()
    assert rig.node.deadline == rig.now + 100_000_000
    rig.receive(0x605, bytes.fromhex("4000100000000000"))
    assert rig.node.deadline == 0


def test_events_tell_state_changes(rig):
    rig.node.events.clear()
    rig.receive(0x000, b"\x01\x05")
    rig.receive(0x000, b"\x01\x05")  # no change, no event
    assert list(rig.node.events) == [NodeEvent(NodeEventKind.STATE_CHANGED, NmtState.OPERATIONAL)]


def test_a_flood_pushes_no_event_out_and_takes_no_memory(rig):
    rig.node.events.clear()
    rig.receive(0x000, b"\x01\x05")
    for _ in range(1000):
        rig.receive(0x205, bytes(4))
        rig.receive(0x000, b"\x80\x05")
        rig.receive(0x000, b"\x01\x05")
    assert list(rig.node.events) == [
        NodeEvent(NodeEventKind.RPDO_RECEIVED, 1),
        NodeEvent(NodeEventKind.STATE_CHANGED, NmtState.PRE_OPERATIONAL),
        NodeEvent(NodeEventKind.STATE_CHANGED, NmtState.OPERATIONAL),
    ]


def test_routes_are_renewed_with_each_identifier(rig):
    dictionary = rig.node.object_dictionary
    routes = rig.node.routes
    dictionary.download(0x1017, 0, b"\x00\x00")
    assert rig.node.routes is routes

    dictionary.download(0x1005, 0, (0xA0).to_bytes(4, "little"))
    assert rig.node.routes is not routes
    assert 0xA0 in rig.node.routes
    assert 0x80 not in rig.node.routes

    dictionary.download(0x1400, 1, (0x80000205).to_bytes(4, "little"))
    assert 0x205 not in rig.node.routes
    dictionary.download(0x1016, 1, (9 << 16 | 10).to_bytes(4, "little"))
    assert 0x709 in rig.node.routes


def test_two_rpdos_on_one_identifier(rig):
    dictionary = rig.node.object_dictionary
    dictionary.download(0x1401, 1, (0x80000305).to_bytes(4, "little"))
    dictionary.download(0x1401, 1, (0x205).to_bytes(4, "little"))
    dictionary.download(0x1401, 2, b"\xff")
    rig.receive(0x000, b"\x01\x05")
    rig.receive(0x205, bytes.fromhex("34120100"))
    assert dictionary.variable(0x2000).value == 0x1234
    assert dictionary.variable(0x2002).value == 0x011234


def test_hook_of_an_object_is_told_by_an_rpdo_too(rig):
    told = []
    rig.node.object_dictionary.add_hook(0x2000, 0, told.append)
    rig.receive(0x000, b"\x01\x05")
    rig.receive(0x205, bytes.fromhex("0700 0000"))
    assert told == [7]


def test_long_emcy_detail_is_a_mistake_of_the_application(rig):
    with pytest.raises(ValueError, match="longer than 5 bytes"):
        rig.node.emcy.raise_error(0x5000, 1, bytes(6))


def test_emcy_queue_is_bounded(rig):
    for code in range(0x6000, 0x6020):
        rig.node.emcy.raise_error(code, 1)
    codes = [int.from_bytes(frame.data[:2], "little") for frame in rig.run()]
    assert codes == list(range(0x6010, 0x6020))  # the latest 16
    assert rig.node.counters.dropped_emcy == 16


FRAMES = st.builds(
    Frame,
    st.one_of(
        st.sampled_from([0x000, 0x080, 0x205, 0x305, 0x605, 0x185, 0x705, 0x707]),
        st.integers(0, 0x7FF),
    ),
    st.one_of(st.binary(max_size=8), st.sampled_from([b"\x01\x05", b"\x80\x00", b"\x02\x00"])),
    st.booleans() | st.just(value=False),
    st.booleans() | st.just(value=False),
)


@given(st.lists(st.tuples(FRAMES, st.integers(0, 2000)), max_size=60))
def test_no_frame_harms_a_node(make_rig, traffic):
    rig = make_rig()
    rig.node.object_dictionary.download(0x1016, 1, (7 << 16 | 10).to_bytes(4, "little"))
    rig.receive(0x000, b"\x01\x05")
    for frame, pause in traffic:
        rig.node.receive(frame, rig.now)
        rig.run(pause)

    for variable in rig.node.object_dictionary:
        if variable.value is not None:
            variable.data_type.encode(variable.value)
            assert variable.low is None or variable.value >= variable.low
            assert variable.high is None or variable.value <= variable.high
    assert all(len(frame.data) <= 8 for frame in rig.sent)
    rig.receive(0x000, b"\x81\x05")
    assert rig.run() == [Frame(0x705, b"\x00")]
    assert rig.request(bytes.fromhex("4000100000000000")) == [bytes.fromhex("4300100091010000")]
