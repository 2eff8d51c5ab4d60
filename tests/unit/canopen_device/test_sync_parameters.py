"""What SYNC may be set to, on devices that have all its objects or some of them (CiA 301)."""

import pytest

from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import ObjectDictionary

VALUE = 0x06090030
PRODUCER, CONSUMER = 0x40000080, 0x00000080
START = Frame(0x000, b"\x01\x05")


def node_without(object_dictionary, *indices):
    kept = [variable for variable in object_dictionary if variable.index not in indices]
    node = Node(ObjectDictionary(kept), 5)
    node.start(0)
    node.serve(0, [].append)
    return node


def download(node, index, value, size=4):
    """Write an object; return the abort code, None where it is taken."""
    try:
        node.object_dictionary.download(index, 0, value.to_bytes(size, "little"))
    except SdoAbort as error:
        return error.code
    return None


@pytest.mark.parametrize(
    ("overflow", "abort"),
    # CiA 301, object 0x1019: 0, and 2 to 240; 1 and 241 to 255 are reserved.
    [(0, None), (1, VALUE), (2, None), (3, None), (240, None), (241, VALUE), (255, VALUE)],
)
@pytest.mark.parametrize("absent", [(), (0x1005,), (0x1006,)])
def test_the_counter_overflows_within_its_range(object_dictionary, absent, overflow, abort):
    node = node_without(object_dictionary, *absent)
    assert download(node, 0x1019, overflow, 1) == abort


def test_a_device_without_a_window_takes_synchronous_pdos_at_any_time(object_dictionary):
    node = node_without(object_dictionary, 0x1007)
    node.receive(START, 0)
    node.receive(Frame(0x080), 0)
    node.receive(Frame(0x305, b"\x07\0\0\0"), 3_600_000_000_000)  # an hour after SYNC
    node.receive(Frame(0x080), 3_600_000_000_001)
    assert node.object_dictionary.variable(0x2002).value == 7
    assert node.counters.late_synchronous_pdos == 0


@pytest.mark.parametrize(
    ("cob_id", "abort"),
    # CiA 301, object 0x1005: while bit 30 is set, bits 0 to 29 do not change.
    [
        *((PRODUCER, None), (CONSUMER, None), (0x81, None)),
        *((PRODUCER + 1, VALUE), (PRODUCER + 0x400, VALUE)),
    ],
)
def test_a_producer_keeps_its_identifier(object_dictionary, cob_id, abort):
    node = node_without(object_dictionary)
    assert download(node, 0x1005, PRODUCER) is None
    assert download(node, 0x1005, cob_id) == abort


@pytest.mark.parametrize(("cob_id", "abort"), [(PRODUCER, VALUE), (CONSUMER, None), (0x81, None)])
def test_a_device_without_a_period_never_produces(object_dictionary, cob_id, abort):
    assert download(node_without(object_dictionary, 0x1006), 0x1005, cob_id) == abort


@pytest.mark.parametrize("cob_id", [0x81, PRODUCER + 1])
def test_a_consumer_takes_another_identifier(object_dictionary, cob_id):
    node = node_without(object_dictionary)
    assert download(node, 0x1005, cob_id) is None


def test_bit_31_of_the_cob_id_means_nothing(object_dictionary):
    node = node_without(object_dictionary)
    assert download(node, 0x1005, 0x80000081) is None
    node.object_dictionary.download(0x1801, 2, b"\x01")  # TPDO 2 with every SYNC
    node.receive(START, 0)
    sent = []
    node.receive(Frame(0x081), 0)
    node.transmit_pdos(0, sent.append)
    assert 0x285 in [frame.can_id for frame in sent]


def sync_with_counter(rig, overflow=8):
    rig.node.object_dictionary.download(0x1019, 0, bytes([overflow]))


def emcy_codes(frames):
    return [int.from_bytes(frame.data[:2], "little") for frame in frames if frame.can_id == 0x085]


@pytest.mark.parametrize("data", [b"", b"\x01\x02"])
def test_a_sync_of_another_length_is_an_error_once_until_a_right_one(rig, data):
    # CiA 301, table of emergency error codes: 8240, unexpected SYNC data length.
    sync_with_counter(rig)
    rig.receive(0x080, data)
    assert emcy_codes(rig.run()) == [0x8240]
    rig.receive(0x080, data)
    assert emcy_codes(rig.run()) == []
    rig.receive(0x080, b"\x01")
    assert emcy_codes(rig.run()) == [0x0000]
    rig.receive(0x080, b"\x02")
    assert emcy_codes(rig.run()) == []
    assert rig.node.counters.unexpected_sync_length == 2


def test_a_counter_that_nobody_asked_for_is_counted_and_no_error(rig):
    rig.receive(0x080, b"\x01")
    rig.receive(0x080, b"")
    assert emcy_codes(rig.run()) == []
    assert rig.node.counters.unexpected_sync_length == 1


@pytest.mark.parametrize("data", [b"", b"\x01"])
def test_without_a_counter_the_first_sync_counts_whatever_the_start_value(rig, data):
    # CiA 301, object 0x18xx.06: the start value needs the counter.
    dictionary = rig.node.object_dictionary
    for subindex, value, size in ((1, 0x80000285, 4), (6, 3, 1), (2, 1, 1), (1, 0x285, 4)):
        dictionary.download(0x1801, subindex, value.to_bytes(size, "little"))
    rig.receive(0x000, b"\x01\x05")
    rig.run()
    rig.receive(0x080, data)
    assert [frame.can_id for frame in rig.run() if frame.can_id == 0x285] == [0x285]


def test_the_period_of_a_running_producer_changes_with_its_writing(rig):
    dictionary = rig.node.object_dictionary
    dictionary.download(0x1006, 0, (10_000).to_bytes(4, "little"))
    dictionary.download(0x1005, 0, PRODUCER.to_bytes(4, "little"))
    assert [frame.can_id for frame in rig.run()] == [0x080]
    dictionary.download(0x1006, 0, (3_000).to_bytes(4, "little"))
    # The first at once, then one each 3 ms.
    counts = [sum(frame.can_id == 0x080 for frame in rig.run()) for _ in range(7)]
    assert counts == [1, 0, 0, 1, 0, 0, 1]


# SYNC in rounds that do not fit it; the services themselves are in tests/transcripts.


MICROSECONDS_10_000 = (10_000).to_bytes(4, "little")
AS_PRODUCER = (0x40000080).to_bytes(4, "little")


def sync_times(rig, rounds, milliseconds):
    """Run and return when SYNC came [ms]."""
    start, times = rig.now, []
    for _ in range(rounds):
        frames = rig.run(milliseconds)
        times += [(rig.now - start) // 1_000_000 for frame in frames if frame.can_id == 0x080]
    return times


def produce(rig):
    rig.node.object_dictionary.download(0x1006, 0, MICROSECONDS_10_000)
    rig.node.object_dictionary.download(0x1005, 0, AS_PRODUCER)
    rig.run()  # the first SYNC


def test_sync_keeps_its_mean_period_when_rounds_do_not_divide_it(rig):
    produce(rig)
    # Due at 10, 20, 30 ms ..., each sent in the first round of 3 ms at or after that.
    assert sync_times(rig, 100, 3) == [-(-due // 3) * 3 for due in range(10, 301, 10)]


def test_missed_syncs_are_not_made_up_for(rig):
    produce(rig)
    assert sync_times(rig, 1, 1000) == [1000]
    assert sync_times(rig, 20, 1) == [10, 20]


def test_a_synchronous_tpdo_after_the_window_is_discarded(rig):
    dictionary = rig.node.object_dictionary
    dictionary.download(0x1007, 0, (2000).to_bytes(4, "little"))
    dictionary.download(0x1801, 2, b"\x01")
    rig.receive(0x000, b"\x01\x05")
    rig.run()
    rig.receive(0x080, b"")
    assert [frame.can_id for frame in rig.run(2)] == [0x285]  # at the very end of the window
    rig.receive(0x080, b"")
    assert rig.run(3) == []
    assert rig.node.counters.late_synchronous_pdos == 1
