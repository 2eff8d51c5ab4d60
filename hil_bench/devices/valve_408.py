"""A proportional valve with position feedback on the bus: profile CiA 408.

The set-point 0x6300.01 reaches the spool only while the device is ACTIVE (`valve_state_machine`)
with device mode 0x6042 = 1. In every other state the hold set-point 0x6314.01 takes its place.
Either one goes through limits, scaling, ramp and compensations (`demand_generator`) and then is the
demand value 0x6310.01. The reference value 0x6311.01 stands for 100 %.

ACTIVE needs the NMT state OPERATIONAL: leaving it leads to HOLD at once. Since a control word acts
only when it arrives, one that still stands in 0x6040 does not bring ACTIVE back.

An RPDO that missed its deadline, a lost heartbeat and a life guarding event are faults, for which
the node's services send the EMCY; so is a control deviation that lasts (`position_control`). The
error code 0x604E shows it until the fault is reset. A reset is not obeyed while the heartbeat or
the guarding is still missing.

A valve with a pressure sensor has the control modes pressure and p/Q (`pressure_control`), one with
a position sensor axis position control (`position_control`): while it is ACTIVE and the bus rules,
the controller gives the set-point. `dither` moves the spool.

With 0x604F = 1 the local control word and set-point rule (`local_command`). Each change of 0x604F
leads to INIT.
"""

import math
from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import INTEGER8, INTEGER16, UNSIGNED8, UNSIGNED16
from hil_bench.canopen_device.emcy import COMMUNICATION, HEARTBEAT, RPDO_TIMEOUT
from hil_bench.canopen_device.events import NodeEvent, NodeEventKind
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.node import Node
from hil_bench.devices.bound_objects import TpdoTrigger, locate, optional, required, saturate
from hil_bench.devices.demand_generator import DemandGenerator, Dither
from hil_bench.devices.position_control import (
    AXIS_DEVIATION_EMCY,
    DEVIATION_EMCY,
    POSITION,
    DeviationMonitor,
    PositionControl,
)
from hil_bench.devices.pressure_control import PRESSURE, PRESSURE_AND_FLOW, PressureControl
from hil_bench.devices.valve_state_machine import (
    FAULT_STATES,
    STATUS_BITS,
    LocalCommand,
    ValveState,
    ValveStateMachine,
)
from hil_bench.errors import EdsError, ParameterError, SdoAbort

PRESSURE_BIT: Final = 1 << 8
"""Bit of the status word: in p/Q, the pressure controller has the spool."""
LOCAL_BIT: Final = 1 << 4
"""Bit of the status word: the local control word rules."""
RAMP_BIT: Final = 1 << 9
"""Bit of the status word: the ramp is running."""
LIMIT_BIT: Final = 1 << 10
"""Bit of the status word: a limit holds the demand value back."""
DEVIATION_BIT: Final = 1 << 11
"""Bit of the status word: the control deviation monitoring has tripped."""

SPOOL: Final = 2
"""Value of the control mode 0x6043: spool position."""

SETPOINT_BY_BUS: Final = 1
"""Value of the device mode 0x6042."""

REFERENCE: Final = 16384
"""Value of 100 % where the EDS has no 0x6311."""

_SUPERVISION_LOST: Final = (NodeEventKind.HEARTBEAT_LOST, NodeEventKind.GUARDING_LOST)
_SUPERVISION_RESUMED: Final = (NodeEventKind.HEARTBEAT_RESUMED, NodeEventKind.GUARDING_RESUMED)

LOCAL_TIMEOUT_EMCY: Final = 0x8100
"""Communication error: the local command's watchdog."""

_HELD: Final = frozenset({ValveState.HOLD, ValveState.FAULT_REACTION, ValveState.FAULT_HOLD})
"""States in which axis position control holds the axis."""

_NO_CONTROL_WORD: Final = 0
_LOWEST: Final = -32768
_HIGHEST: Final = 32767


class ValveDevice:
    """The valve behind one node: control word and set-point in, spool position and status word out.

    Attributes:
        node: the node that carries it on the bus.
        full_opening: spool position of 100 % [m].
        local: what commands it while 0x604F is 1.
        pressure_control: what commands it in the control modes pressure and p/Q.
        position_control: what commands it in the control mode axis position.
        enable_input: whether the input that lets the valve be more than DISABLED is on.
    """

    def __init__(self, node: Node, full_opening: float) -> None:
        """Bind the profile's objects; EdsError where one is missing or of a wrong kind.

        Args:
            node: the node; its object dictionary comes from the valve's EDS file.
            full_opening: spool position of 100 % [m].

        Raises:
            ParameterError: `full_opening` is not a positive length.
        """
        if not 0.0 < full_opening < math.inf:
            raise ParameterError(
                f"full_opening is {full_opening!r} m; the spool position of 100 % is more than 0"
            )
        self.node = node
        self.full_opening = full_opening
        self.local = LocalCommand()
        self.enable_input = True
        self._machine = ValveStateMachine()
        self._lost_heartbeats: set[int] = set()
        self._bind_control()
        self._bind_spool()
        self._generator = DemandGenerator(node.object_dictionary, self._reference)
        od = node.object_dictionary
        self.pressure_control = PressureControl(od, self._control_mode, self._reference)
        self.position_control = PositionControl(od, node.emcy, self._reference)
        self._dither = Dither(node.object_dictionary)
        self._monitor = DeviationMonitor(node.object_dictionary, node.emcy)
        self._status_trigger = TpdoTrigger(node, (0x6041, 0))
        self._start()

    def _bind_control(self) -> None:
        od = self.node.object_dictionary
        required(od, 0x6040, 0, UNSIGNED16).add_hook(self._receive_control_word)
        self._status_word = required(od, 0x6041, 0, UNSIGNED16)
        self._mode = optional(od, 0x6042, 0, INTEGER8, UNSIGNED8, absent=SETPOINT_BY_BUS)
        self._control_mode = optional(od, 0x6043, 0, INTEGER8, absent=SPOOL)
        self._control_mode.add_check(self._check_control_mode)
        self._control_mode.add_hook(self._change_control_mode)
        self._error_code = optional(od, 0x604E, 0, UNSIGNED16)
        self._local = optional(od, 0x604F, 0, INTEGER8, UNSIGNED8)
        self._local.add_hook(self._change_control)

    def _bind_spool(self) -> None:
        od = self.node.object_dictionary
        self._setpoint = required(od, 0x6300, 1, INTEGER16)
        self._actual = required(od, 0x6301, 1, INTEGER16)
        self._demand = optional(od, 0x6310, 1, INTEGER16)
        self._reference = optional(od, 0x6311, 1, INTEGER16, absent=REFERENCE)
        self._hold_setpoint = optional(od, 0x6314, 1, INTEGER16)
        self._deviation = optional(od, 0x6350, 1, INTEGER16)
        if self._reference.default <= 0:
            raise EdsError(
                f"{locate(od, self._reference)} is {self._reference.default}; "
                "the value that stands for 100 % is more than 0"
            )
        self._reference.add_check(_check_reference)
        self._reference.add_hook(self._scale)

    @property
    def state(self) -> ValveState:
        """State of the device state machine, as of the last `command` or control word."""
        return self._machine.state

    def command(self, now: int) -> float:
        """Hear what happened on the bus and return the spool set-point [m].

        Args:
            now: bench time [ns].
        """
        if self.node.events:
            self._hear_events()
        if self._local.value:
            self._watch_local(now)
        elif self.node.state is not NmtState.OPERATIONAL:
            self._machine.deactivate()  # heard already, unless a flood pushed the event out
        if not self.enable_input:
            self._machine.disable()
        demand = self._generator.generate(self._present_setpoint(now), now)
        if self._machine.state is ValveState.FAULT_REACTION:
            self._end_reaction()
        self._demand.value = demand
        if self._dither.type.value and self._machine.state is ValveState.ACTIVE:
            return (demand + self._dither.swing(now)) * self._metres
        return demand * self._metres

    def measure_pressure(self, pressure: float, now: int) -> None:  # noqa: ARG002 - no delay
        """Take what the valve's pressure sensor measures [Pa] at `now` [ns]."""
        self.pressure_control.measure(pressure)

    def measure_position(self, position: float, speed: float, now: int) -> None:  # noqa: ARG002
        """Take what the valve's position sensor measures [m], [m/s] at `now` [ns]."""
        self.position_control.measure(position, speed)

    @property
    def modes(self) -> tuple[int, ...]:
        """The control modes that the valve has, by its sensors."""
        modes: tuple[int, ...] = (SPOOL,)
        if self.pressure_control.sense:
            modes += (PRESSURE, PRESSURE_AND_FLOW)
        return (*modes, POSITION) if self.position_control.is_fitted else modes

    def publish(self, spool_position: float, now: int) -> None:
        """Put the measured spool position and the status word into the object dictionary.

        Args:
            spool_position: actual spool position [m].
            now: bench time [ns].
        """
        actual = saturate(
            spool_position * self._increments, _LOWEST, _HIGHEST, unknown=self._actual.value
        )
        self._actual.value = actual
        deviation = self._demand.value - actual
        if not _LOWEST <= deviation <= _HIGHEST:
            deviation = min(max(deviation, _LOWEST), _HIGHEST)
        self._deviation.value = deviation
        if self._monitor.is_on and self._monitor.watch(deviation, now):
            self._fault(DEVIATION_EMCY)
        if self.position_control.is_closed and self.position_control.watch(now):
            self._fault(AXIS_DEVIATION_EMCY)
        status = self._present_status()
        if status != self._status_word.value:
            self._status_word.value = status
            self._status_trigger.pull()

    def adopt(self, state: ValveState) -> None:
        """Enter the state that another valve reports, of which this one is the twin."""
        self._hear_events()
        self._machine.adopt(state)

    def shift(self, spool: float, position: float) -> None:
        """Have the ramp and the axis' controller go on from elsewhere.

        Args:
            spool: by how much the spool is elsewhere, as fraction of full opening.
            position: by how much the axis is [m].
        """
        self._generator.shift_ramp(spool * self._reference.value)
        self.position_control.shift(spool, position)

    def _present_status(self) -> int:
        status = STATUS_BITS[self._machine.state]
        if self.pressure_control.is_active:
            status |= PRESSURE_BIT
        if self._local.value:
            status |= LOCAL_BIT
        if self._generator.ramp.is_running:
            status |= RAMP_BIT
        if self._generator.is_limited or self.position_control.is_limited:
            status |= LIMIT_BIT
        if self._monitor.has_tripped or self.position_control.monitor.has_tripped:
            status |= DEVIATION_BIT
        return status

    def _end_reaction(self) -> None:
        """Leave FAULT_REACTION once the spool is told its hold set-point."""
        if not self._generator.ramp.is_running:
            self._machine.end_reaction()
            if not self.enable_input:
                self._machine.disable()

    def _present_setpoint(self, now: int) -> int:
        if self._machine.state is ValveState.ACTIVE:
            if self._local.value:
                return self.local.setpoint
            if self._mode.value == SETPOINT_BY_BUS:
                return self._commanded_setpoint(now)
        self.pressure_control.restart()
        if self._control_mode.value == POSITION and not self._local.value:
            is_held = self._machine.state in _HELD
            held = self.position_control.hold(now) if is_held else None
            if held is not None:
                return held
        self.position_control.release()
        return int(self._hold_setpoint.value)

    def _commanded_setpoint(self, now: int) -> int:
        mode = self._control_mode.value
        if mode == SPOOL:
            return int(self._setpoint.value)
        if mode == POSITION:
            followed = self.position_control.follow(now)
            return int(self._hold_setpoint.value) if followed is None else followed
        return self.pressure_control.control(self._setpoint.value, now)

    def receive_local(self, control_word: int | None, setpoint: float | None, now: int) -> None:
        """Take a local command; what is None stays as it is.

        Args:
            control_word: as that of 0x6040.
            setpoint: spool set-point as fraction of full opening.
            now: bench time [ns].

        Raises:
            SdoAbort: 0800 0022, 0x604F is not 1.
        """
        if not self._local.value:
            raise SdoAbort(*abort_codes.DEVICE_STATE)
        self.local.received_at = now
        if setpoint is not None:
            increments = setpoint * self._reference.value
            self.local.setpoint = saturate(increments, _LOWEST, _HIGHEST, unknown=0)
        if control_word is not None:
            self.local.control_word = control_word
            self._hear_events()
            self._obey(control_word)

    def _watch_local(self, now: int) -> None:
        if self._machine.state is ValveState.ACTIVE and self.local.is_late(now):
            self.node.emcy.raise_error(LOCAL_TIMEOUT_EMCY, COMMUNICATION)
            self._fault(LOCAL_TIMEOUT_EMCY)

    def _start(self) -> None:
        self.local.restart()
        self._was_local = bool(self._local.value)
        self._machine.start()
        self._lost_heartbeats.clear()
        self._scale(self._reference.value)
        self._generator.restart()
        self._monitor.restart()
        self._change_control_mode()
        self._show_identity()

    def _show_identity(self) -> None:
        """Show what 0x6052 and 0x605F take from the device itself."""
        od = self.node.object_dictionary
        if (serial_number := od.find(0x6052)) is not None:
            serial_number.value = f"{od.number(0x1018, 4):08X}"
        if (capability := od.find(0x605F)) is not None:
            capability.value = sum(1 << mode for mode in self.modes)

    def _check_control_mode(self, mode: int) -> None:
        """Refuse a mode that this valve does not have.

        Raises:
            SdoAbort: 0609 0030.
        """
        if mode not in self.modes:
            raise SdoAbort(*abort_codes.VALUE)

    def _change_control_mode(self, _written: int = 0) -> None:
        self.pressure_control.restart()
        self.position_control.release()

    def _scale(self, reference: int) -> None:
        self._metres = self.full_opening / reference
        self._increments = reference / self.full_opening

    def _hear_events(self) -> None:
        while self.node.events:
            self._hear(self.node.events.popleft())

    def _hear(self, event: NodeEvent) -> None:
        kind, detail = event
        if kind is NodeEventKind.STATE_CHANGED:
            if detail != NmtState.OPERATIONAL and not self._local.value:
                self._machine.deactivate()
        elif kind is NodeEventKind.RESET_NODE:
            self._start()
        elif kind is NodeEventKind.RESET_COMMUNICATION:
            self._lost_heartbeats.clear()
        elif kind in _SUPERVISION_RESUMED:
            self._lost_heartbeats.discard(detail)
        elif kind in _SUPERVISION_LOST:
            self._lost_heartbeats.add(detail)
            self._fault(HEARTBEAT)
        elif kind is NodeEventKind.RPDO_TIMEOUT:
            self._fault(RPDO_TIMEOUT)

    def _fault(self, error_code: int) -> None:
        self._machine.fault(takes_time=self._generator.has_ramp)
        if self._machine.state in FAULT_STATES:
            self._error_code.value = error_code

    def _receive_control_word(self, control_word: int) -> None:
        if self.node.events:
            self._hear_events()  # what came before this word counts before it
        if not self._local.value:
            self._obey(control_word)

    def _change_control(self, local: int) -> None:
        self._hear_events()
        if bool(local) != self._was_local:
            self._was_local = bool(local)
            self.local.restart()
            self._obey(_NO_CONTROL_WORD)

    def _obey(self, control_word: int) -> None:
        had_fault = self._machine.state in FAULT_STATES
        self._machine.receive(
            control_word,
            may_activate=bool(self._local.value) or self.node.state is NmtState.OPERATIONAL,
            may_reset=not self._lost_heartbeats,
            is_enabled=self.enable_input,
        )
        if had_fault and self._machine.state not in FAULT_STATES:
            self._error_code.value = 0
            self._monitor.restart()
            self.position_control.monitor.restart()
            self.node.emcy.clear_error(LOCAL_TIMEOUT_EMCY)


def _check_reference(reference: int) -> None:
    if reference <= 0:
        raise SdoAbort(*abort_codes.VALUE_TOO_LOW)
