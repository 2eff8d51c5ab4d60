"""What the valve does when its controller falls silent: RPDOs, heartbeats and guarding missing.

Status words: low four bits R M H D as in `test_valve_state_machine`.
"""

import pytest
from support.valves import ACTIVE, FAULT_HOLD, HOLD, activate, control, fit_valve, status

from device_profiles import VALVE_408
from hil_bench.canopen_device.frame import Frame
from hil_bench.devices.valve_state_machine import ValveState

CONTROLLER = 0x7F


@pytest.fixture
def active(make_rig):
    """A valve that follows the bus, at 50 %."""
    rig = activate(fit_valve(make_rig(VALVE_408)), 8192)
    assert rig.spool == 0.5e-3
    return rig


def watch_rpdo(rig, milliseconds):
    assert rig.write(0x1400, 5, milliseconds, 2) is None


def test_an_rpdo_timeout_is_a_fault_that_holds(active):
    watch_rpdo(active, 50)
    control(active, 0x0007, 8192)
    active.tick(48)  # 49 ms after the RPDO
    assert (status(active), active.spool) == (ACTIVE, 0.5e-3)
    assert active.emcy_codes() == []
    active.tick()
    assert (status(active), active.spool) == (FAULT_HOLD, 0.0)
    assert active.value(0x604E) == 0x8250
    active.tick(100)
    assert active.emcy_codes() == [0x8250]


def test_an_rpdo_timeout_is_recovered_by_a_reset_and_another_word(active):
    watch_rpdo(active, 50)
    control(active, 0x0007, 8192)
    active.tick(50)
    control(active, 0x0007, 8192)
    assert (status(active), active.spool) == (FAULT_HOLD, 0.0)
    control(active, 0x000F, 8192)
    assert (status(active), active.spool) == (HOLD, 0.0)
    assert active.value(0x604E) == 0
    control(active, 0x0007, 8192)
    assert (status(active), active.spool) == (ACTIVE, 0.5e-3)
    assert active.emcy_codes() == [0x8250, 0x0000]


def watch_controller(rig, milliseconds, *, stays_operational):
    """Consumer heartbeat time, and 0x1029.01: 1 is "no change of the NMT state" (CiA 301)."""
    assert rig.write(0x1029, 1, int(stays_operational), 1) is None
    assert rig.write(0x1016, 1, CONTROLLER << 16 | milliseconds, 4) is None


def heartbeat(rig):
    rig.receive(0x700 + CONTROLLER, 0x05)


def test_a_lost_heartbeat_is_a_fault_that_holds(active):
    watch_controller(active, 100, stays_operational=True)
    heartbeat(active)
    active.tick(99)
    assert (status(active), active.spool) == (ACTIVE, 0.5e-3)
    active.tick()
    assert (status(active), active.spool) == (FAULT_HOLD, 0.0)
    assert active.value(0x604E) == 0x8130
    assert active.emcy_codes() == [0x8130]


def test_a_lost_heartbeat_with_the_default_error_behaviour_holds_too(active):
    watch_controller(active, 100, stays_operational=False)
    heartbeat(active)
    active.tick(100)
    assert active.spool == 0.0
    assert active.valve.state is ValveState.FAULT_HOLD
    active.nmt(active.START)
    control(active, 0x0007, 8192)
    assert active.spool == 0.0


def test_no_reset_while_the_heartbeat_is_missing(active):
    watch_controller(active, 100, stays_operational=True)
    heartbeat(active)
    active.tick(100)
    control(active, 0x000F, 8192)
    assert status(active) == FAULT_HOLD
    heartbeat(active)
    control(active, 0x0007, 8192)
    control(active, 0x000F, 8192)
    assert status(active) == HOLD
    control(active, 0x0007, 8192)
    assert status(active) == ACTIVE


def test_a_heartbeat_that_is_no_longer_watched_does_not_bar_the_reset(active):
    watch_controller(active, 100, stays_operational=True)
    heartbeat(active)
    active.tick(100)
    assert active.write(0x1016, 1, 0, 4) is None
    control(active, 0x000F)
    assert status(active) == HOLD


def guard(rig):
    """The NMT master's remote request (CiA 301, node guarding)."""
    rig.node.receive(Frame(0x705, is_remote=True), rig.now)


def watch_guarding(rig, milliseconds):
    assert rig.write(0x1029, 1, 1, 1) is None
    assert rig.write(0x100C, 0, milliseconds, 2) is None
    assert rig.write(0x100D, 0, 1, 1) is None
    guard(rig)


def test_a_life_guarding_event_is_a_fault_like_a_lost_heartbeat(active):
    watch_guarding(active, 100)
    active.tick(99)
    assert (status(active), active.spool) == (ACTIVE, 0.5e-3)
    active.tick()
    assert (status(active), active.spool) == (FAULT_HOLD, 0.0)
    assert active.value(0x604E) == 0x8130
    control(active, 0x000F)
    assert status(active) == FAULT_HOLD
    guard(active)
    control(active, 0x0007)
    control(active, 0x000F)
    assert status(active) == HOLD


def test_guarding_that_is_switched_off_does_not_bar_the_reset(active):
    watch_guarding(active, 100)
    active.tick(100)
    assert active.write(0x100D, 0, 0, 1) is None
    control(active, 0x000F)
    assert status(active) == HOLD


@pytest.mark.parametrize("command", ["RESET_COMMUNICATION", "RESET_NODE"])
def test_after_a_reset_nobody_is_missing(active, command):
    watch_controller(active, 100, stays_operational=True)
    heartbeat(active)
    active.tick(100)
    active.nmt(getattr(active, command))
    active.tick(2)
    watch_rpdo(active, 50)
    active.nmt(active.START)
    control(active, 0x0007)
    active.tick(50)
    assert status(active) & 0x8 == 0
    control(active, 0x000F)
    assert status(active) == HOLD
