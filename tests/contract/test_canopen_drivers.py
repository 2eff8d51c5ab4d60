"""What the CANopen drivers promise beyond `test_drivers`, over every CAN bus there is."""

import pytest
from support.patience import GUARD

from hil_bench.plants.hydraulic_cylinder.model import paper_parameters
from hil_drivers import (
    DeviceFaultError,
    DeviceMismatchError,
    DriverTimeoutError,
    NmtState,
    SdoAbortError,
    ValveState,
)
from hil_drivers.emergency import MEANINGS

IN_VIRTUAL_TIME = pytest.mark.parametrize("connect", ["embedded"], indirect=True)
"""For what happens within a time: a busy machine may hold the other process up for longer."""

HEARTBEAT_ERROR, RPDO_TIMEOUT = 0x8130, 0x8250


def sample(rig):
    """Sends SYNC, and waits until each device has answered."""
    since = rig.network.now()
    rig.network.sync()
    for device in rig.devices:
        rig.network.wait_until(
            lambda device=device: device.received_at > since, GUARD, f"{device.node}: TPDO"
        )


def test_devices_answer_sync_with_the_plants_rest(started):
    sample(started)
    parameters = paper_parameters()
    assert started.valve.state is ValveState.INIT
    assert started.valve.spool_position == 0.0
    assert started.position.speed == 0.0
    # At rest the forces on the piston differ by no more than friction holds.
    assert started.pressure_a.is_valid
    force = (
        started.pressure_a.pressure * parameters.A_A - started.pressure_b.pressure * parameters.A_B
    )
    assert abs(force) <= parameters.F_s
    assert started.pressure_a.pressure > 1e5


def test_setup_leads_to_heartbeats_in_operational(started):
    started.network.wait_for_state([1, 2, 3, 4], NmtState.OPERATIONAL, GUARD)


@IN_VIRTUAL_TIME
def test_silence_is_a_fault_that_can_be_reset(rig):
    rig.valve.setup(command_timeout=0.5)
    rig.network.start_node(1)
    rig.valve.enable(timeout=GUARD)
    node = rig.valve.node
    rig.network.wait_until(lambda: node.emergencies, GUARD, "emergency")
    assert node.emergencies[0].code == RPDO_TIMEOUT
    with pytest.raises(DeviceFaultError, match=MEANINGS[RPDO_TIMEOUT]):
        rig.valve.enable()
    rig.valve.reset_fault(timeout=GUARD)
    rig.valve.enable(timeout=GUARD)


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


@IN_VIRTUAL_TIME
def test_a_closed_valve_takes_silence_for_no_fault(rig):
    rig.network.start_heartbeat(127, 0.05)
    rig.valve.setup(command_timeout=0.5, heartbeat_timeout=0.5)
    rig.network.start_node(1)
    with rig.valve:
        rig.valve.enable(timeout=GUARD)
    rig.network.stop_heartbeat()
    rig.network.pump(0.7)
    assert rig.valve.read_state() is ValveState.DISABLED
    assert not rig.valve.node.emergencies


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


def test_another_device_under_the_node_id_is_refused(rig):
    for node_id, device in ((1, rig.position), (4, rig.valve)):
        device.node.sdo.rx_cobid = 0x600 + node_id
        device.node.sdo.tx_cobid = 0x580 + node_id
        rig.network.subscribe(0x580 + node_id, device.node.sdo.receive)
        with pytest.raises(DeviceMismatchError, match="device type"):
            device.setup()
