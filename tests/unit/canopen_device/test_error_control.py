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
    return rig.node.emcy.is_present(0x8130, source=WATCHED)


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
