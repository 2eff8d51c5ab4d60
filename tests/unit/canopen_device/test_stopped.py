"""What a node leaves alone in the NMT state STOPPED (CiA 301: no SYNC, no EMCY)."""

import pytest

from hil_bench.canopen_device.agenda import NEVER


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
