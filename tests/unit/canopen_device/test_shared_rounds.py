"""SYNCs and remote requests that share a round: each has a PDO of its own (CiA 301, PDO).

The PDO of a SYNC carries the values that were there when the next SYNC came; that of the last one
in a round carries those at the round's end.
"""

import struct

import pytest

BOTH_WAYS = 0x2028  # INTEGER32, 4 bytes in RPDO 1 and TPDO 4 here
ECHO_COB_ID = 0x485  # TPDO 4


def allow_requests(rig, number, transmission_type):
    """Give TPDO `number` a type, with remote requests allowed (bit 30 clear)."""
    dictionary, index = rig.node.object_dictionary, 0x1800 + number - 1
    can_id = 0x80 + 0x100 * number + 5
    dictionary.download(index, 1, (0x80000000 | can_id).to_bytes(4, "little"))
    dictionary.download(index, 2, bytes([transmission_type]))
    dictionary.download(index, 1, can_id.to_bytes(4, "little"))


def map_echo(rig, transmission_type):
    """Let the synchronous RPDO 2 write 0x2002, and TPDO 4 send a value that RPDO 1 writes."""
    dictionary = rig.node.object_dictionary
    for mapping, cob_id, communication in ((0x1600, 0x205, 0x1400), (0x1A03, 0x485, 0x1803)):
        dictionary.download(communication, 1, (0x80000000 | cob_id).to_bytes(4, "little"))
        dictionary.download(mapping, 0, b"\x00")
        dictionary.download(mapping, 1, (BOTH_WAYS << 16 | 32).to_bytes(4, "little"))
        dictionary.download(mapping, 0, b"\x01")
        dictionary.download(communication, 2, bytes([transmission_type]))
        dictionary.download(communication, 1, cob_id.to_bytes(4, "little"))


def start(rig):
    rig.receive(0x000, b"\x01\x05")
    rig.run()


def measure(rig, value):
    rig.node.object_dictionary.variable(0x2012).value = value


def real(value):
    return struct.pack("<f", value)


@pytest.mark.parametrize("transmission_type", [1, 2, 3, 7, 240])
@pytest.mark.parametrize("together", [1, 2, 3, 5])
def test_every_nth_sync_has_its_pdo_however_many_share_a_round(rig, transmission_type, together):
    rig.node.object_dictionary.download(0x1801, 2, bytes([transmission_type]))
    start(rig)
    syncs, sent = 0, 0
    for _ in range(60):
        for _ in range(together):
            rig.receive(0x080, b"")
            syncs += 1
        sent += [frame.can_id for frame in rig.run()].count(0x285)
        assert sent == syncs // transmission_type  # CiA 301: every n-th SYNC


def test_the_sync_that_the_start_value_names_is_the_first_within_a_round_too(rig):
    dictionary = rig.node.object_dictionary
    dictionary.download(0x1019, 0, b"\x04")  # the counter runs from 1 to 4
    dictionary.download(0x1801, 1, (0x80000285).to_bytes(4, "little"))
    dictionary.download(0x1801, 6, b"\x03")
    dictionary.download(0x1801, 2, b"\x02")
    dictionary.download(0x1801, 1, (0x40000285).to_bytes(4, "little"))
    start(rig)
    sent = []
    for counters in ((1, 2), (3, 4), (1, 2, 3), (4,)):
        for counter in counters:
            rig.receive(0x080, bytes([counter]))
        sent.append([frame.can_id for frame in rig.run()].count(0x285))
    # Counted from the first SYNC with counter 3: 3 4 | 1 2 3 | 4 is 1 2 | 3 4 5 | 6.
    assert sent == [0, 1, 1, 1]


def test_a_pdo_has_the_values_of_its_sync_and_not_those_of_the_next(rig):
    map_echo(rig, 1)
    start(rig)
    for value in (10, 20, 30):
        rig.receive(0x205, struct.pack("<i", value))  # synchronous: acts with the SYNC after it
        rig.receive(0x080, b"")
    sent = [frame.data for frame in rig.run() if frame.can_id == ECHO_COB_ID]
    assert sent == [struct.pack("<i", value) for value in (10, 20, 30)]


def test_what_came_after_the_last_sync_waits_for_the_next(rig):
    map_echo(rig, 1)
    start(rig)
    rig.receive(0x080, b"")
    rig.receive(0x205, struct.pack("<i", 7))
    assert struct.pack("<i", 7) not in [frame.data for frame in rig.run()]
    rig.receive(0x080, b"")
    assert [frame.data for frame in rig.run() if frame.can_id == ECHO_COB_ID] == [b"\x07\0\0\0"]


def test_one_event_has_one_pdo_of_type_0_however_many_syncs_follow(rig):
    start(rig)
    rig.node.trigger_tpdo(3)
    rig.receive(0x080, b"")
    rig.receive(0x080, b"")
    assert [frame.can_id for frame in rig.run()].count(0x385) == 1


def test_each_sync_opens_the_window_for_its_own_pdo(rig):
    dictionary = rig.node.object_dictionary
    dictionary.download(0x1007, 0, (500).to_bytes(4, "little"))
    dictionary.download(0x1801, 2, b"\x01")
    start(rig)
    rig.receive(0x080, b"")
    rig.receive(0x080, b"")
    # Both SYNCs came at the round before; at its end, 1 ms later, the window is over for the last.
    assert [frame.can_id for frame in rig.run()].count(0x285) == 1
    assert rig.node.counters.late_synchronous_pdos == 1


@pytest.mark.parametrize("transmission_type", [253, 254, 255])
@pytest.mark.parametrize("requests", [1, 2, 5])
def test_each_remote_request_is_answered(rig, transmission_type, requests):
    allow_requests(rig, 2, transmission_type)
    start(rig)
    for _ in range(requests):
        rig.receive(0x285, b"", is_remote=True)
    assert [frame.can_id for frame in rig.run()].count(0x285) == requests


def test_the_inhibit_time_joins_remote_requests(rig):
    dictionary = rig.node.object_dictionary
    allow_requests(rig, 2, 255)
    dictionary.download(0x1801, 1, (0x80000285).to_bytes(4, "little"))
    dictionary.download(0x1801, 3, (30).to_bytes(2, "little"))  # 3 ms
    dictionary.download(0x1801, 1, (0x285).to_bytes(4, "little"))
    start(rig)  # sends it
    times = []
    for _ in range(9):
        for _ in range(3):
            rig.receive(0x285, b"", is_remote=True)
        times.append([frame.can_id for frame in rig.run()].count(0x285))
    assert times == [0, 0, 1] * 3


def test_a_remote_request_has_the_sample_of_the_sync_before_it(rig):
    allow_requests(rig, 2, 252)
    start(rig)
    for value in (1.0, 2.0):
        measure(rig, value)
        rig.receive(0x080, b"")
        rig.receive(0x285, b"", is_remote=True)
    measure(rig, 3.0)
    # The second SYNC came while the object held 2.0, and the first one's sample was taken by then;
    # the second one's is taken at the round's end.
    assert [frame.data for frame in rig.run() if frame.can_id == 0x285] == [real(2.0), real(3.0)]
    rig.receive(0x285, b"", is_remote=True)
    rig.receive(0x285, b"", is_remote=True)
    measure(rig, 4.0)
    assert [frame.data for frame in rig.run() if frame.can_id == 0x285] == [real(3.0)] * 2


def test_nothing_that_was_asked_for_survives_a_reset(rig):
    rig.node.object_dictionary.download(0x1801, 2, b"\x01")
    start(rig)
    rig.receive(0x080, b"")
    rig.receive(0x080, b"")
    rig.receive(0x000, b"\x82\x05")
    assert [frame.can_id for frame in rig.run()] == [0x705]
