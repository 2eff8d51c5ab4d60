import gc
import random
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.eds_sections import VERIFY_CONFIGURATION

from hil_bench.canopen_device.agenda import NEVER
from hil_bench.canopen_device.datatypes import UNSIGNED32
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.errors import ConfigError, SdoAbort
from hil_bench.canopen_device.events import NodeEvent, NodeEventKind
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import UNCONFIGURED, NmtState
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable


@pytest.mark.parametrize("node_id", [0, 128])
def test_node_id_is_checked(object_dictionary, node_id):
    with pytest.raises(ConfigError, match="use 1 to 127"):
        Node(object_dictionary, node_id)


@pytest.mark.parametrize("node_id", [1, 127])
def test_the_first_and_the_last_node_id_are_possible(object_dictionary, node_id):
    node = Node(object_dictionary, node_id)
    node.start(0)
    sent = []
    node.serve(0, sent.append)
    assert [frame.can_id for frame in sent] == [0x700 + node_id]


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


def test_the_history_has_the_newest_error_first_with_two_bytes_of_its_detail(rig):
    """0x1003: the code in the low half, the maker's additional information above it (CiA 301)."""
    rig.node.emcy.raise_error(0x3100, 4, b"\x01\x02\x03")
    rig.node.emcy.raise_error(0x5000, 1)
    dictionary = rig.node.object_dictionary
    assert [dictionary.number(0x1003, place) for place in range(3)] == [2, 0x5000, 0x02013100]


def test_emcy_queue_is_bounded(rig):
    for code in range(0x6000, 0x6020):
        rig.node.emcy.raise_error(code, 1)
    codes = [int.from_bytes(frame.data[:2], "little") for frame in rig.run()]
    assert codes == list(range(0x6010, 0x6020))  # the latest 16
    assert rig.node.counters.dropped_emcy == 16


def test_startup_refuses_to_make_an_nmt_master(object_dictionary):
    startup_object = Variable(0x1F80, 0, "NMT startup", UNSIGNED32, default=4)
    node = Node(ObjectDictionary([*object_dictionary, startup_object]), 5)
    for startup in (0x4, 0x0, 0xC):
        node.object_dictionary.download(0x1F80, 0, startup.to_bytes(4, "little"))
    for startup in (0x1, 0x2, 0x10, 0x5):
        with pytest.raises(SdoAbort, match="invalid value"):
            node.object_dictionary.download(0x1F80, 0, startup.to_bytes(4, "little"))


def test_a_device_without_0x1006_is_no_sync_producer(object_dictionary):
    kept = [variable for variable in object_dictionary if variable.index != 0x1006]
    node = Node(ObjectDictionary(kept), 5)
    with pytest.raises(SdoAbort, match="invalid value"):
        node.object_dictionary.download(0x1005, 0, (0x40000080).to_bytes(4, "little"))


def test_a_device_without_0x100C_is_not_guarded(object_dictionary):
    kept = [variable for variable in object_dictionary if variable.index != 0x100C]
    node, sent = Node(ObjectDictionary(kept), 5), []
    node.start(0)
    node.serve(0, sent.append)
    node.receive(Frame(0x705, is_remote=True), 0)
    node.serve(0, sent.append)
    assert sent == [Frame(0x705, b"\x00")]
    assert node.counters.ignored_frames == 1


def test_the_default_sdo_channel_never_changes(object_dictionary):
    # An EDS may declare 0x1200 as rw, which CiA 301 does not.
    channel = [
        Variable(0x1200, 1, "request", UNSIGNED32, default=0x605),
        Variable(0x1200, 2, "response", UNSIGNED32, default=0x585),
    ]
    node = Node(ObjectDictionary([*object_dictionary, *channel]), 5)
    for subindex in (1, 2):
        with pytest.raises(SdoAbort, match="read only"):
            node.object_dictionary.download(0x1200, subindex, (0x6A0).to_bytes(4, "little"))


def test_lss_queue_is_bounded(rig):
    rig.receive(0x7E5, bytes.fromhex("0401000000000000"))
    for _ in range(100):
        rig.receive(0x7E5, bytes.fromhex("5E00000000000000"))
    assert len(rig.run()) == 64
    assert rig.node.counters.dropped_lss_requests == 36


IDENTIFIERS = (0x000, 0x080, 0x100, 0x205, 0x305, 0x605, 0x681, 0x185, 0x705, 0x707, 0x7E5)

FRAMES = st.builds(
    Frame,
    st.one_of(st.sampled_from(IDENTIFIERS), st.integers(0, 0x7FF)),
    st.one_of(st.binary(max_size=8), st.sampled_from([b"\x01\x05", b"\x80\x00", b"\x02\x00"])),
    st.booleans() | st.just(value=False),
    st.booleans() | st.just(value=False),
    fd=st.just(0),
)


@given(st.lists(st.tuples(FRAMES, st.integers(0, 2000)), max_size=60))
def test_no_frame_harms_a_node(make_rig, traffic):
    rig = make_rig()
    turn_everything_on(rig)
    for frame, pause in traffic:
        rig.node.receive(frame, rig.now)
        rig.run(pause)

    for variable in rig.node.object_dictionary:
        if variable.value is not None:
            variable.data_type.encode(variable.value)
            assert variable.low is None or variable.value >= variable.low
            assert variable.high is None or variable.value <= variable.high
    assert all(len(frame.data) <= 8 for frame in rig.sent)
    check_alive(rig)


def turn_everything_on(rig):
    """Let every service listen: heartbeat, TIME, a second SDO channel, guarding; then start."""
    for index, subindex, value in (
        *((0x1016, 1, 7 << 16 | 10), (0x1012, 0, 0x80000100), (0x1201, 1, 0x681)),
        *((0x1201, 2, 0x682), (0x1801, 1, 0x80000285), (0x1801, 1, 0x285)),
    ):
        rig.node.object_dictionary.download(index, subindex, value.to_bytes(4, "little"))
    rig.node.object_dictionary.download(0x100C, 0, b"\x14\x00")
    rig.node.object_dictionary.download(0x100D, 0, b"\x02")
    rig.receive(0x000, b"\x01\x05")


def check_alive(rig):
    """Whatever came before, after a reset node by its present node-ID the node is as new."""
    node_id = rig.node.node_id
    if node_id == UNCONFIGURED:
        return
    rig.run(200_000)  # a silence that LSS asked for lasts 131 s at most
    rig.receive(0x000, bytes([0x81, 0]))
    rig.run()
    rig.receive(0x600 + rig.node.node_id, bytes.fromhex("4000100000000000"))
    answer = Frame(0x580 + rig.node.node_id, bytes.fromhex("4300100091010000"))
    assert answer in rig.run()


@pytest.mark.long
def test_a_million_random_frames(make_rig):
    rig = make_rig()
    turn_everything_on(rig)
    generator = random.Random(301)  # noqa: S311 - frames, not secrets
    for batch in range(20):
        for _ in range(5000):
            receive_random_frames(rig, generator, 10)
            rig.run(generator.choice((1, 1, 1, 30)))
            rig.sent.clear()
            rig.node.events.clear()
        if batch == 0:
            gc.collect()
            before = len(gc.get_objects())
        if rig.node.node_id == UNCONFIGURED or rig.node.state is NmtState.STOPPED:
            turn_on_anew(rig)
    gc.collect()
    assert len(gc.get_objects()) < before + 1000
    check_alive(rig)


SENSIBLE = [
    *((0x000, bytes([command, 0])) for command in (1, 1, 1, 1, 2, 128, 130)),
    *((0x707, bytes([state])) for state in (0, 4, 5, 127)),
    *((0x205, bytes(length)) for length in (3, 4, 5)),
    *[
        (0x080, b""),
        (0x305, bytes(4)),
        (0x100, bytes(6)),
        (0x605, bytes.fromhex("A300000000000000")),
    ],
    *(
        (can_id, bytes([command]) + multiplexer + tail)
        for can_id in (0x605, 0x681)
        for command in (0x20, 0x21, 0x2B, 0x40, 0xA4, 0xC4)
        for multiplexer in map(bytes.fromhex, ("081000", "101001", "202000", "212000", "171000"))
        for tail in (bytes.fromhex("7F000000"), b"save")
    ),
    *((0x605, bytes([command]) + bytes(7)) for command in (1, 2, 3, 0x81, 0x60, 0x70, 0xA1, 0xC1)),
    *(
        (0x7E5, bytes.fromhex(text).ljust(8, b"\0"))
        for text in ("0401", "0400", "1105", "17", "5E")
    ),
]
"""Frames that a master would send, so that the random ones meet a node that is doing something."""


def receive_random_frames(rig, generator, count):
    """A quarter sensible, a quarter on identifiers that the node listens to; odd flags at times."""
    receive, now = rig.node.receive, rig.now
    for _ in range(count):
        kind = generator.random()
        if kind < 0.25:
            receive(Frame(*generator.choice(SENSIBLE)), now)
            continue
        can_id = generator.choice(IDENTIFIERS) if kind < 0.5 else generator.randrange(0x800)
        data = generator.randbytes(generator.choice((0, 1, 2, 4, 8, 8, 8)))
        is_odd = generator.random() < 0.02
        receive(Frame(can_id, data, is_odd and generator.random() < 0.5, is_odd), now)


def turn_on_anew(rig):
    """Give the node its node-ID again, as an LSS master would, and start it."""
    for text in ("0401", "1105", "0400"):
        rig.receive(0x7E5, bytes.fromhex(text).ljust(8, b"\0"))
    rig.receive(0x000, b"\x82\x00")
    rig.run()
    rig.receive(0x000, b"\x01\x00")


# What a node leaves alone in the NMT state STOPPED (CiA 301: no SYNC, no EMCY).


@pytest.fixture
def stopped(rig):
    rig.receive(0x000, b"\x02\x05")
    rig.run()
    return rig


def test_sync_is_not_taken(stopped):
    stopped.receive(0x080, b"")
    assert stopped.node.syncs == 0


def test_an_emergency_waits_without_waking_the_node(stopped):
    stopped.node.emcy.raise_error(0x5000, 1)
    assert stopped.run() == []
    assert stopped.node.deadline == NEVER
    stopped.receive(0x000, b"\x80\x05")  # enter PRE-OPERATIONAL
    assert [frame.can_id for frame in stopped.run()] == [0x085]


# 0x1020: what a master wrote of its configuration, until something changes (CiA 301).


PLAIN = Path(__file__).parent / "device.eds"


@pytest.fixture
def objects(make_file):
    text = PLAIN.read_text(encoding="utf-8")
    text = text.replace("SupportedObjects=29\n", "SupportedObjects=30\n30=0x1020\n", 1)
    path = make_file("device.eds", text + VERIFY_CONFIGURATION)
    dictionary = load_eds(path, 5)
    Node(dictionary, 5)
    for subindex, value in ((1, 15000), (2, 3_600_000)):
        dictionary.download(0x1020, subindex, value.to_bytes(4, "little"))
    return dictionary


def stamps(objects):
    return [objects.number(0x1020, subindex) for subindex in (1, 2)]


def test_it_keeps_what_the_master_wrote(objects):
    assert stamps(objects) == [15000, 3_600_000]


def test_a_changed_parameter_clears_both(objects):
    objects.download(0x1017, 0, b"\x64\x00")
    assert stamps(objects) == [0, 0]


def test_to_clear_the_history_of_errors_changes_no_configuration(objects):
    objects.download(0x1003, 0, b"\x00")
    assert stamps(objects) == [15000, 3_600_000]


def test_a_device_without_it_watches_nothing():
    dictionary = load_eds(PLAIN, 5)
    Node(dictionary, 5)
    assert 0x1020 not in dictionary
