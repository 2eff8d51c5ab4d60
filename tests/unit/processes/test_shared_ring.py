"""The ring between loop and recorder."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.abilities.common.shared_ring import SharedRing


def test_messages_come_out_in_order_with_their_kind():
    ring = SharedRing(1024)
    for number in range(5):
        assert ring.put(number, bytes([number]) * number)
    assert list(ring.take()) == [(n, bytes([n]) * n) for n in range(5)]
    assert list(ring.take()) == []


@given(st.lists(st.tuples(st.booleans(), st.binary(max_size=40)), max_size=60))
def test_nothing_is_lost_torn_or_reordered_round_the_end(steps):
    """A message is either refused by `put` or comes out whole, whatever the sizes."""
    ring = SharedRing(104)
    expected, found = [], []
    for number, (is_taken, message) in enumerate(steps):
        if ring.put(number, message):
            expected.append((number, message))
        if is_taken:
            found += ring.take()
    found += ring.take()
    assert found == expected
    assert ring.lost == len(steps) - len(expected)


def test_a_full_ring_refuses_and_counts_until_there_is_room_again():
    ring = SharedRing(64)  # two messages of 12 bytes header and 20 bytes content
    assert ring.put(1, bytes(20))
    assert ring.put(2, bytes(20))
    assert not ring.put(3, b"")
    assert ring.lost == 1
    assert [kind for kind, _ in ring.take()] == [1, 2]
    assert ring.put(4, bytes(20))
    assert [kind for kind, _ in ring.take()] == [4]


@pytest.mark.parametrize("byte", [0, 4, 8, 12, 15])  # check sum, kind, length, content
def test_a_message_that_is_not_all_there_yet_waits(byte):
    ring = SharedRing(64)
    ring.put(7, b"content")
    whole = ring._data[byte]
    ring._data[byte] = whole ^ 1
    assert list(ring.take()) == []
    ring._data[byte] = whole
    assert list(ring.take()) == [(7, b"content")]
