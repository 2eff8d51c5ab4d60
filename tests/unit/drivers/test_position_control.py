"""The control law by hand, and the loop against a scripted set of devices."""

import math
import struct

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_drivers import (
    ControllerParameters,
    DeviceFaultError,
    DriverTimeoutError,
    MotionProfile,
    Network,
    PositionController,
    PositionLoop,
    PositionSensor,
    PressureSensor,
    ProportionalValve,
    StaleValueError,
)
from hil_drivers.motion_profile import SetPoint

PARAMETERS = ControllerParameters(position_gain=20.0, full_speed=0.5, dead_zone=0.2, tolerance=1e-4)


@pytest.mark.parametrize(
    ("setpoint", "position", "command"),
    [
        # v = v_s + 20 (x_s - x); opening 0.2 + 0.8 |v| / 0.5.
        (SetPoint(0.01, 0.0, 0.0), 0.0, 0.2 + 0.8 * 0.2 / 0.5),
        (SetPoint(-0.01, 0.0, 0.0), 0.0, -(0.2 + 0.8 * 0.2 / 0.5)),
        (SetPoint(0.0, 0.1, 0.0), 0.0, 0.2 + 0.8 * 0.1 / 0.5),
        (SetPoint(0.0, 0.1, 0.0), 0.01, -(0.2 + 0.8 * 0.1 / 0.5)),  # v = 0.1 - 0.2
        (SetPoint(1.0, 0.0, 0.0), 0.0, 1.0),  # 20 m/s are wanted
        (SetPoint(0.0, 0.0, 0.0), 1.0, -1.0),
        # At rest within the tolerance: centred; beyond it, or on the move: not.
        (SetPoint(0.0, 0.0, 0.0), 0.99e-4, 0.0),
        (SetPoint(0.0, 0.0, 0.0), -1.1e-4, 0.2 + 0.8 * 20 * 1.1e-4 / 0.5),
        (SetPoint(0.0, 1e-3, 0.0), 0.0, 0.2 + 0.8 * 1e-3 / 0.5),
    ],
)
def test_the_law(setpoint, position, command):
    controller = PositionController(PARAMETERS)
    assert controller.command(setpoint, position) == pytest.approx(command, rel=1e-12)


@given(st.floats(-10, 10), st.floats(-10, 10), st.floats(-10, 10))
def test_the_command_is_odd_and_in_range(target, speed, position):
    command = PositionController(PARAMETERS).command
    there = command(SetPoint(target, speed, 0.0), position)
    mirrored = command(SetPoint(-target, -speed, 0.0), -position)
    assert abs(there) <= 1.0
    # A wanted speed of exactly 0 on the move has no sign to mirror.
    assert there == -mirrored or abs(there) == PARAMETERS.dead_zone


class Devices(can.BusABC):
    """Answers each SYNC 1 ms later with the TPDOs of four devices, in virtual time."""

    def __init__(self):
        self.channel_info = "devices"
        self.time = 0.0
        self.position_um = 2000
        self.valve_state = 0b1111
        self.silent = set()
        self.syncs = []
        self.commands = []
        self._due = []
        super().__init__(channel="devices")

    def send(self, msg, timeout=None):  # noqa: ARG002 - BusABC's
        if msg.arbitration_id == 0x80:
            self.syncs.append(self.time)
            self._due = [
                (self.time + 1e-3, can_id, data)
                for can_id, data in (
                    (0x181, struct.pack("<Hh", self.valve_state, 4096)),
                    (0x182, struct.pack("<fB", 50.0, 0)),
                    (0x183, struct.pack("<fB", math.nan, 1)),
                    (0x184, struct.pack("<ih", self.position_um, 0)),
                )
                if can_id not in self.silent
            ]
        elif msg.arbitration_id == 0x201:
            self.commands.append((self.time, struct.unpack("<Hh", msg.data)[1]))

    def recv(self, timeout=None):
        deadline = self.time + timeout
        if self._due and self._due[0][0] <= deadline:
            due, can_id, data = self._due.pop(0)
            self.time = max(self.time, due)
            return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)
        self.time = deadline
        return None


@pytest.fixture
def devices():
    bus = Devices()
    yield bus
    bus.shutdown()


@pytest.fixture
def loop(devices):
    network = Network(devices, clock=lambda: devices.time)
    valve = ProportionalValve(network, 1)
    pressures = PressureSensor(network, 2), PressureSensor(network, 3)
    position = PositionSensor(network, 4)
    # What setup() does is told by the transcripts of each driver; here its result is enough.
    for device in (valve, *pressures, position):
        network.subscribe(0x180 + device.node.node_id, device._received[0].receive)
    for pressure in pressures:
        pressure._pascal_per_digit = 1e5
    position._position_step = 1e-6
    return PositionLoop(
        network,
        valve=valve,
        position=position,
        pressures=pressures,
        controller=PositionController(PARAMETERS),
        period=2e-3,
    )


@pytest.fixture
def rest():
    return MotionProfile(0.0, [0.0], speed=1.0, acceleration=1.0)


def test_a_cycle_samples_commands_and_records(loop, devices, rest):
    (record,) = loop.run(rest, 2e-3)
    assert record[:4] == pytest.approx((0.0, 0.0, 2e-3, 50e5))
    assert math.isnan(record.pressure_b)
    # v = 20 * -2 mm = -0.04 m/s.
    assert record.spool_setpoint == pytest.approx(-(0.2 + 0.8 * 0.04 / 0.5))
    assert record.spool_position == 0.25
    assert devices.commands[-1][1] == round(record.spool_setpoint * 16384)


def test_cycles_keep_their_grid(loop, devices, rest):
    records = list(loop.run(rest, 0.02))
    assert [record.time for record in records] == pytest.approx([n * 2e-3 for n in range(10)])
    # The first SYNC is the sample before the run, answered 1 ms later.
    assert devices.syncs == pytest.approx([0.0, *[1e-3 + n * 2e-3 for n in range(10)]])
    # The command follows the values, 1 ms after their SYNC, without waiting for the cycle's end.
    assert [time for time, _ in devices.commands] == pytest.approx(
        [2e-3 + n * 2e-3 for n in range(10)]
    )
    assert (loop.overruns, loop.missed_samples) == (0, 0)


def test_a_slow_caller_costs_cycles_and_not_the_grid(loop, devices, rest):
    times = []
    for record in loop.run(rest, 0.02):
        times.append(record.time)
        if len(times) == 2:
            devices.time += 5e-3  # up to 9 ms into a grid of 2 ms: cycles 2 and 3 are left out
    assert times == pytest.approx([0.0, 2e-3, 8e-3, 10e-3, 12e-3, 14e-3, 16e-3, 18e-3])
    assert loop.overruns == 2


def test_a_missing_value_is_bridged_and_counted(loop, devices, rest):
    run = loop.run(rest, 1.0)
    first = next(run)
    devices.silent = {0x184}
    second = next(run)
    assert loop.missed_samples == 1
    assert second.position == first.position


def test_values_that_stay_away_end_the_run(loop, devices, rest):
    run = loop.run(rest, 1.0)
    next(run)
    devices.silent = {0x184}
    with pytest.raises(StaleValueError, match="node 4"):
        list(run)
    # Not before the age limit of 100 ms, and within one period after it.
    assert 0.1 <= devices.time <= 0.11


def test_a_device_that_never_answers_is_named(loop, devices, rest):
    devices.silent = {0x183}
    with pytest.raises(DriverTimeoutError, match="node 3: value with SYNC"):
        next(loop.run(rest, 1.0))


def test_a_valve_that_leaves_active_ends_the_run(loop, devices, rest):
    run = loop.run(rest, 1.0)
    next(run)
    devices.valve_state = 0b0011
    with pytest.raises(DeviceFaultError, match="valve in FAULT_HOLD"):
        next(run)


def test_a_period_must_be_positive(loop):
    with pytest.raises(ValueError, match="a positive time"):
        PositionLoop(
            loop._network,
            valve=loop._valve,
            position=loop._position,
            pressures=loop._pressures,
            period=0.0,
        )
