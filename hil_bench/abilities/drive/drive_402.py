"""A drive on the bus: profile CiA 402, for an axis that turns behind a valve.

The drive has the encoder of its axis and closes its loops itself: a velocity controller (PI, with
the demand fed forward) gives the spool, and in the position modes a position controller (P) gives
its set-point. 0x2402 has their gains: .01 position [0.01 1/s], .02 velocity [0.01, spool by
deviation, each as a part of full], .03 integral time [ms].

Positions count 65536 increments a revolution, velocities increments a second, accelerations
increments a second squared.

Modes of operation (0x6060): 1 profile position, 3 profile velocity, 6 homing (`homing`), 8 cyclic
synchronous position, 9 cyclic synchronous velocity. Profile position takes a set-point with the
rising edge of bit 4 of the control word and acknowledges it by bit 12 of the status word until bit
4 is 0; bit 5 changes it at once, otherwise one set-point waits; bit 6 makes it relative. Bit 8,
halt, stops in both profile modes. The cyclic modes move to each new target within the interpolation
period 0x60C2.

Following error: a position further from its demand than 0x6065 for longer than 0x6066 is a fault,
0x8611. So are an RPDO that timed out, a lost heartbeat, and leaving OPERATIONAL while enabled. The
reaction to a fault and a quick stop is to stop by 0x6085.

Sources: objects, words and handshake as makers' manuals have them (Nanotec, maxon EPOS4, Elmo); the
text of CiA 402 was not at hand. Gains, units and the refusals are this device's own.
"""

import math
from typing import Final

from hil_bench.abilities.drive.motion import Motion
from hil_bench.abilities.drive.state_machine import (
    MOVING,
    STATUS,
    DriveState,
    DriveStateMachine,
    Homing,
)
from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import (
    INTEGER8,
    INTEGER32,
    UNSIGNED8,
    UNSIGNED16,
    UNSIGNED32,
    DataType,
)
from hil_bench.canopen_device.emcy import COMMUNICATION, DEVICE_PROFILE, HEARTBEAT, RPDO_TIMEOUT
from hil_bench.canopen_device.events import NodeEvent, NodeEventKind
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import Variable
from hil_bench.devices.bound_objects import TpdoTrigger, optional, required, saturate
from hil_bench.errors import SdoAbort

PROFILE_POSITION: Final = 1
PROFILE_VELOCITY: Final = 3
HOMING: Final = 6
CYCLIC_POSITION: Final = 8
CYCLIC_VELOCITY: Final = 9
MODES: Final = (PROFILE_POSITION, PROFILE_VELOCITY, HOMING, CYCLIC_POSITION, CYCLIC_VELOCITY)
"""What 0x6060 may hold, beside 0 for none."""

INCREMENTS: Final = 65536 / (2.0 * math.pi)
"""Increments in a radian."""

FOLLOWING_EMCY: Final = 0x8611
LEFT_EMCY: Final = 0x8100
"""Communication: OPERATIONAL was left while the drive was enabled."""

_NEW, _AT_ONCE, _RELATIVE, _HALT = 1 << 4, 1 << 5, 1 << 6, 1 << 8
_VOLTAGE, _REMOTE, _REACHED, _LIMITED = 1 << 4, 1 << 9, 1 << 10, 1 << 11
_SPECIFIC, _FOLLOWING = 1 << 12, 1 << 13
_SECOND: Final = 1_000_000_000
_MILLISECOND: Final = 1_000_000
_LOWEST, _HIGHEST = -(1 << 31), (1 << 31) - 1
_POSITION_MODES: Final = (PROFILE_POSITION, HOMING, CYCLIC_POSITION)


class DriveDevice:
    """The drive behind one node.

    Attributes:
        node: the node that carries it on the bus.
        full_opening: spool position of 100 % [m].
    """

    def __init__(self, node: Node, full_opening: float, full_speed: float) -> None:
        """Bind the profile's objects; EdsError where one is missing or of a wrong kind.

        Args:
            node: the node; its object dictionary comes from the drive's EDS file.
            full_opening: spool position of 100 % [m].
            full_speed: speed at 100 % without load, roughly [rad/s].
        """
        self.node = node
        self.full_opening = full_opening
        self._full_speed = full_speed * INCREMENTS
        self._machine = DriveStateMachine()
        self._motion = Motion()
        self._homing = Homing(self._find(0x6098, INTEGER8))
        self._measured = self._speed = self._integral = 0.0
        self._target = self._cyclic_velocity = 0.0
        self._waiting: float | None = None
        self._then: int | None = None
        self._outside_since: int | None = None
        self._lost: set[int] = set()
        self._is_reached = True
        self._was_new = self._is_acknowledged = self._is_limited = False
        self._bind_words()
        self._bind_motion()
        self._bind_limits()
        self._status_trigger = TpdoTrigger(node, (0x6041, 0))
        self._start()

    def _find(self, index: int, data_type: DataType, subindex: int = 0) -> Variable:
        return required(self.node.object_dictionary, index, subindex, data_type)

    def _bind_words(self) -> None:
        self._control = self._find(0x6040, UNSIGNED16)
        self._control.add_hook(self._receive_control_word)
        self._status = self._find(0x6041, UNSIGNED16)
        self._mode = self._find(0x6060, INTEGER8)
        self._mode.add_check(_check_mode)
        self._mode.add_hook(self._change_mode)
        self._mode_display = self._find(0x6061, INTEGER8)
        self._error = optional(self.node.object_dictionary, 0x603F, 0, UNSIGNED16)

    def _bind_motion(self) -> None:
        self._position_demand = self._find(0x6062, INTEGER32)
        self._position = self._find(0x6064, INTEGER32)
        self._velocity_demand = self._find(0x606B, INTEGER32)
        self._velocity = self._find(0x606C, INTEGER32)
        self._deviation = self._find(0x60F4, INTEGER32)
        self._target_position = self._find(0x607A, INTEGER32)
        self._target_position.add_hook(self._take_cyclic_target)
        self._target_velocity = self._find(0x60FF, INTEGER32)
        self._period = self._find(0x60C2, UNSIGNED8, 1)
        self._exponent = self._find(0x60C2, INTEGER8, 2)
        modes = optional(self.node.object_dictionary, 0x6502, 0, UNSIGNED32)
        modes.default = modes.value = sum(1 << mode - 1 for mode in MODES)

    def _bind_limits(self) -> None:
        self._window = self._find(0x6065, UNSIGNED32)
        self._window_time = self._find(0x6066, UNSIGNED16)
        self._reached_window = self._find(0x6067, UNSIGNED32)
        self._fastest = self._find(0x6081, UNSIGNED32)
        self._acceleration = self._find(0x6083, UNSIGNED32)
        self._deceleration = self._find(0x6084, UNSIGNED32)
        self._quick_stop = self._find(0x6085, UNSIGNED32)
        for ramp in (self._acceleration, self._deceleration, self._quick_stop):
            ramp.add_check(_check_ramp)
        self._gains = [self._find(0x2402, UNSIGNED16, sub) for sub in (1, 2, 3)]

    @property
    def state(self) -> DriveState:
        """State of the power drive state machine."""
        return self._machine.state

    def command(self, now: int) -> float:
        """Hear what happened on the bus, move the demand on, and return the spool [m]."""
        if self.node.events:
            self._hear_events()
        dt = 0.0 if self._then is None else (now - self._then) / _SECOND
        self._then = now
        if self._machine.state not in MOVING:
            self._motion.restart(self._measured, 0.0)
            self._integral = 0.0
            self._show_demand()
            return 0.0
        if dt:
            self._advance(dt)
        self._watch(now)
        self._show_demand()
        return self._control_spool(dt) * self.full_opening

    def publish(self, answer: float, now: int) -> None:
        """Take the position of the spool, which the drive does not need."""

    def measure(self, angle: float, speed: float, now: int) -> None:
        """Take what the drive's encoder measures, and show it.

        Args:
            angle: of the shaft [rad]; NaN leaves the last value.
            speed: of the shaft [rad/s]; NaN leaves the last value.
            now: bench time [ns].
        """
        if math.isfinite(angle):
            self._measured = angle * INCREMENTS - self._homing.origin
        if math.isfinite(speed):
            self._speed = speed * INCREMENTS
        self._position.value = saturate(self._measured, _LOWEST, _HIGHEST, unknown=0)
        self._velocity.value = saturate(self._speed, _LOWEST, _HIGHEST, unknown=0)
        status = self._present_status()
        if status != self._status.value:
            self._status.value = status
            self._status_trigger.pull()

    def _advance(self, dt: float) -> None:
        motion, mode = self._motion, self._mode_display.value
        if self._machine.state is not DriveState.OPERATION_ENABLED:
            motion.ramp_to(0.0, self._quick_stop.value, self._quick_stop.value, dt)
            if motion.velocity == 0.0:
                self._machine.stand_still()
            return
        rise, fall = self._acceleration.value, self._deceleration.value
        is_halted = bool(self._control.value & _HALT)
        if mode == CYCLIC_POSITION:
            motion.follow(self._target_position.value, self._cyclic_velocity, dt)
        elif mode == CYCLIC_VELOCITY:
            motion.restart(motion.position, self._target_velocity.value)
            motion.position += motion.velocity * dt
        elif is_halted or mode in {0, HOMING}:
            motion.ramp_to(0.0, rise, fall, dt)
            if self._homing.is_under_way and motion.velocity == 0.0 and self._stands:
                self._homing.attain(self._measured)
                self._measured = 0.0
                self._hold()
        elif mode == PROFILE_VELOCITY:
            motion.ramp_to(self._target_velocity.value, rise, fall, dt)
        else:
            self._advance_to_target(rise, fall, dt)

    def _advance_to_target(self, rise: float, fall: float, dt: float) -> None:
        fastest = self._fastest.value
        self._is_reached = self._motion.move_to(self._target, fastest, rise, fall, dt)
        if self._is_reached and self._waiting is not None:
            self._target, self._waiting = self._waiting, None
            self._is_reached = False

    def _control_spool(self, dt: float) -> float:
        position_gain, gain, integral_ms = (variable.value for variable in self._gains)
        wanted: float = self._motion.velocity
        if self._mode_display.value in _POSITION_MODES:
            wanted += 0.01 * position_gain * (self._motion.position - self._measured)
        deviation = (wanted - self._speed) / self._full_speed
        proportional = wanted / self._full_speed + 0.01 * gain * deviation
        spool: float = proportional + self._integral
        self._is_limited = abs(spool) > 1.0
        if integral_ms and not self._is_limited:
            self._integral += 0.01 * gain * deviation * dt * 1000.0 / integral_ms
            self._integral = min(max(self._integral, -1.0), 1.0)
        return min(max(spool, -1.0), 1.0)

    def _watch(self, now: int) -> None:
        """Find a following error that lasts."""
        is_outside = (
            self._machine.state is DriveState.OPERATION_ENABLED
            and self._mode_display.value in _POSITION_MODES
            and abs(self._motion.position - self._measured) > self._window.value
        )
        if not is_outside:
            self._outside_since = None
            return
        if self._outside_since is None:
            self._outside_since = now
        if now - self._outside_since >= self._window_time.value * _MILLISECOND:
            self._fault(FOLLOWING_EMCY, DEVICE_PROFILE)

    def _show_demand(self) -> None:
        motion = self._motion
        for variable, value in (
            (self._position_demand, motion.position),
            (self._velocity_demand, motion.velocity),
            (self._deviation, motion.position - self._measured),
        ):
            variable.value = saturate(value, _LOWEST, _HIGHEST, unknown=0)

    def _present_status(self) -> int:
        mode = self._mode_display.value
        status = STATUS[self._machine.state] | _VOLTAGE | _REMOTE
        if self._is_limited and self._machine.state in MOVING:
            status |= _LIMITED
        if self._error.value == FOLLOWING_EMCY:
            status |= _FOLLOWING
        if self._machine.state is not DriveState.OPERATION_ENABLED:
            return status
        return status | self._mode_status(mode)

    def _mode_status(self, mode: int) -> int:
        window = self._reached_window.value
        if mode == PROFILE_POSITION:
            reached = self._is_reached and abs(self._target - self._measured) <= window
            return (_REACHED if reached else 0) | (_SPECIFIC if self._is_acknowledged else 0)
        if mode == PROFILE_VELOCITY:
            wanted = 0 if self._control.value & _HALT else self._target_velocity.value
            reached = abs(self._speed - wanted) <= 0.02 * self._full_speed
            return (_REACHED if reached else 0) | (_SPECIFIC if self._stands else 0)
        if mode == HOMING:
            return self._homing.status
        return _SPECIFIC if mode else 0  # cyclic modes: the drive follows the command

    @property
    def _stands(self) -> bool:
        return abs(self._speed) <= 0.005 * self._full_speed

    def _receive_control_word(self, word: int) -> None:
        if self.node.events:
            self._hear_events()
        was_enabled = self._machine.state is DriveState.OPERATION_ENABLED
        had_fault = self._machine.state is DriveState.FAULT
        self._machine.receive(
            word,
            may_enable=self.node.state is NmtState.OPERATIONAL,
            may_reset=not self._lost,
        )
        is_enabled = self._machine.state is DriveState.OPERATION_ENABLED
        if had_fault and self._machine.state is not DriveState.FAULT:
            self.node.emcy.clear_error(self._error.value)
            self._error.value = 0
        if is_enabled and not was_enabled:
            self._hold()
        self._take_set_point(word, is_enabled=is_enabled and was_enabled)
        is_homing = self._mode_display.value == HOMING
        self._homing.receive(word, may_start=is_enabled and was_enabled and is_homing)

    def _take_set_point(self, word: int, *, is_enabled: bool) -> None:
        is_new = bool(word & _NEW) and not self._was_new
        self._was_new = bool(word & _NEW)
        if not word & _NEW:
            self._is_acknowledged = False
        if not (is_new and is_enabled and self._mode_display.value == PROFILE_POSITION):
            return
        if self._waiting is not None:
            return  # no room: not acknowledged
        base = self._target if word & _RELATIVE else 0.0
        target = base + self._target_position.value
        if word & _AT_ONCE or self._is_reached:
            self._target = target
        else:
            self._waiting = target
        self._is_reached = False
        self._is_acknowledged = True

    def _take_cyclic_target(self, target: int) -> None:
        period = self._period.value * 10.0**self._exponent.value
        self._cyclic_velocity = (target - self._motion.position) / period if period > 0.0 else 0.0

    def _change_mode(self, mode: int) -> None:
        if mode != self._mode_display.value:
            self._mode_display.value = mode
            self._homing.is_under_way = False
            self._hold()

    def _hold(self) -> None:
        """Stay where the axis is until there is a new set-point."""
        self._motion.restart(self._measured, self._motion.velocity)
        self._target = self._measured
        self._target_position.value = saturate(self._measured, _LOWEST, _HIGHEST, unknown=0)
        self._waiting = None
        self._is_reached = True
        self._cyclic_velocity = 0.0
        self._outside_since = None

    def _hear_events(self) -> None:
        while self.node.events:
            self._hear(self.node.events.popleft())

    def _hear(self, event: NodeEvent) -> None:
        kind, detail = event
        if kind is NodeEventKind.RESET_NODE:
            self._start()
        elif kind is NodeEventKind.STATE_CHANGED:
            if detail != NmtState.OPERATIONAL and self._machine.state in MOVING:
                self._fault(LEFT_EMCY, COMMUNICATION)
        elif kind in {NodeEventKind.HEARTBEAT_LOST, NodeEventKind.GUARDING_LOST}:
            self._lost.add(detail)
            self._fault(HEARTBEAT, 0)
        elif kind in {NodeEventKind.HEARTBEAT_RESUMED, NodeEventKind.GUARDING_RESUMED}:
            self._lost.discard(detail)
        elif kind in {NodeEventKind.RPDO_TIMEOUT, NodeEventKind.SRDO_FAILED}:
            self._fault(RPDO_TIMEOUT, 0)

    def _fault(self, code: int, register_bits: int) -> None:
        """Enter a fault; where the node's services have not sent the EMCY, do."""
        if self._machine.state in {DriveState.FAULT, DriveState.FAULT_REACTION}:
            return
        if register_bits:
            self.node.emcy.raise_error(code, register_bits)
        self._error.value = code
        self._machine.fault()

    def _start(self) -> None:
        self._machine.start()
        self._homing.restart()
        self._measured = self._speed = self._integral = 0.0
        self._then = None
        self._lost.clear()
        self._was_new = self._is_acknowledged = self._is_limited = False
        self._mode_display.value = self._mode.value
        self._hold()


def _check_mode(mode: int) -> None:
    if mode != 0 and mode not in MODES:
        raise SdoAbort(*abort_codes.VALUE)


def _check_ramp(ramp: int) -> None:
    if ramp == 0:
        raise SdoAbort(*abort_codes.VALUE_TOO_LOW)
