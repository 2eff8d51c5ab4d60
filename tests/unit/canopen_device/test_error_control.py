"""Heartbeat and guarding of one node while it is reset, and when both are lost at once."""

import pytest

from hil_bench.canopen_device.events import NodeEventKind
from hil_bench.canopen_device.frame import Frame

WATCHED = 7
TIME = 100  # [ms]
RESET_COMMUNICATION = b"\x82\x05"
OPERATIONAL = b"\x05"


@pytest.fixture
def watching(rig):
    """A node that watches the heartbeat of another one."""
    rig.node.object_dictionary.download(0x1016, 1, (WATCHED << 16 | TIME).to_bytes(4, "little"))
    rig.run()
    return rig


def is_lost(rig):
    return 0x8130 in rig.node.emcy.present


def test_after_a_reset_watching_begins_with_the_next_heartbeat(watching):
    entry = watching.node.object_dictionary.variable(0x1016, 1)
    entry.default = entry.value  # as a DCF would give it
    watching.receive(0x700 + WATCHED, OPERATIONAL)
    watching.receive(0x000, RESET_COMMUNICATION)
    watching.run(2 * TIME)
    assert not is_lost(watching)
    watching.receive(0x700 + WATCHED, OPERATIONAL)
    watching.run(2 * TIME)
    assert is_lost(watching)


def test_a_heartbeat_that_comes_before_the_boot_up_is_not_heard(watching):
    entry = watching.node.object_dictionary.variable(0x1016, 1)
    entry.default = entry.value
    watching.receive(0x000, RESET_COMMUNICATION)
    watching.receive(0x700 + WATCHED, OPERATIONAL)
    watching.run()
    watching.run(2 * TIME)
    assert not is_lost(watching)


def guard(rig, life_time):
    """Let the master guard the node, which expects it within a life time [ms]."""
    rig.node.object_dictionary.download(0x100C, 0, life_time.to_bytes(2, "little"))
    rig.node.object_dictionary.download(0x100D, 0, b"\x01")


def test_guarding_before_the_boot_up_is_not_answered(rig):
    guard(rig, TIME)
    rig.receive(0x000, RESET_COMMUNICATION)
    rig.receive(0x705, b"", is_remote=True)
    assert rig.run() == [Frame(0x705, b"\x00")]
    assert rig.node.counters.ignored_frames == 1


def test_heartbeat_and_guarding_that_are_lost_at_once_are_both_told(watching):
    guard(watching, TIME)
    watching.receive(0x700 + WATCHED, OPERATIONAL)
    watching.receive(0x705, b"", is_remote=True)
    watching.node.events.clear()
    watching.run(TIME)
    kinds = [event.kind for event in watching.node.events]
    assert kinds == [NodeEventKind.HEARTBEAT_LOST, NodeEventKind.GUARDING_LOST]


def test_heartbeat_keeps_its_mean_period_when_rounds_do_not_divide_it(rig):
    rig.node.object_dictionary.download(0x1017, 0, (10).to_bytes(2, "little"))
    rig.run()  # the producer starts with a heartbeat
    start, times = rig.now, []
    for _ in range(100):
        times += [(rig.now - start) // 1_000_000 for frame in rig.run(3) if frame.can_id == 0x705]

    # Due at 10, 20, 30 ms ..., each sent in the first round of 3 ms at or after that.
    assert times == [-(-due // 3) * 3 for due in range(10, 301, 10)]


def test_missed_heartbeats_are_not_made_up_for(rig):
    rig.node.object_dictionary.download(0x1017, 0, (10).to_bytes(2, "little"))
    rig.run()
    assert len(rig.run(1000)) == 1
    assert rig.run(9) == []
    assert len(rig.run(1)) == 1


def test_watching_survives_the_change_of_another_entry(rig):
    dictionary = rig.node.object_dictionary
    dictionary.download(0x1016, 1, (7 << 16 | 10).to_bytes(4, "little"))
    rig.receive(0x707, b"\x05")
    rig.run(5)
    dictionary.download(0x1016, 2, (8 << 16 | 10).to_bytes(4, "little"))
    rig.run(5)
    assert is_lost(rig)


def test_unused_entry_frees_the_node(rig):
    dictionary = rig.node.object_dictionary
    entry = (7 << 16 | 10).to_bytes(4, "little")
    dictionary.download(0x1016, 1, entry)
    dictionary.download(0x1016, 1, bytes(4))
    dictionary.download(0x1016, 2, entry)
    assert 0x707 in rig.node.routes
