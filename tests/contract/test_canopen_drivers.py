"""What the CANopen drivers promise beyond `test_drivers`, over every CAN bus there is."""

import pytest
from support.patience import GUARD

from hil_drivers import DriverTimeoutError, NmtState, SdoAbortError

IN_VIRTUAL_TIME = pytest.mark.parametrize("connect", ["embedded"], indirect=True)
"""For what happens within a time: a busy machine may hold the other process up for longer."""

HEARTBEAT_ERROR = 0x8130


def test_setup_leads_to_heartbeats_in_operational(started):
    started.network.wait_for_state([1, 2, 3, 4], NmtState.OPERATIONAL, GUARD)


@IN_VIRTUAL_TIME
def test_a_lost_heartbeat_is_a_fault(rig):
    rig.network.start_heartbeat(127, 0.05)
    rig.valve.setup(command_timeout=0.0, heartbeat_timeout=1.0)
    rig.network.start_node(1)
    rig.valve.enable(timeout=GUARD)
    rig.network.pump(0.2)  # watching begins with the first heartbeat (CiA 301)
    rig.network.stop_heartbeat()
    rig.network.wait_until(lambda: rig.valve.node.emergencies, GUARD, "emergency")
    assert rig.valve.node.active_emergency.code == HEARTBEAT_ERROR
    assert rig.valve.read_state().is_fault


def test_commands_reach_the_valve_only_in_operational(started):
    started.network.enter_pre_operational(1)
    with pytest.raises(DriverTimeoutError, match=r"valve not ACTIVE within 0\.2 s: it is INIT"):
        started.valve.enable(timeout=0.2)


def test_a_reset_node_boots_and_has_forgotten_its_setup(started):
    network, node = started.network, started.valve.node
    default = node.default(0x1800, 2, otherwise=0)
    assert node.read(0x1800, 2) == 1 != default
    network.reset_node(1, timeout=GUARD)
    assert node.nmt_state is NmtState.PRE_OPERATIONAL
    assert node.read(0x1800, 2) == default


def test_a_refused_access_names_object_and_reason(rig):
    rig.position.node.read_device_type()
    with pytest.raises(SdoAbortError, match=r"0x6004 \(.*read only object") as caught:
        rig.position.node.write(0x6004, 0, 1)
    assert caught.value.code == 0x06010002
