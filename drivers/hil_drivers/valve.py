"""Driver for a proportional valve with spool position feedback (CiA 408)."""

from collections.abc import Mapping
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

from device_profiles import VALVE_408
from hil_drivers.device import Device, Input, milliseconds
from hil_drivers.errors import DeviceFaultError, DeviceMismatchError
from hil_drivers.network import Network
from hil_drivers.node import object_name
from hil_drivers.pdo import (
    ObjectKey,
    PdoKind,
    PdoMapping,
    SentPdo,
    Signal,
    configure_pdo,
    verify_mapping,
)
from hil_drivers.valve_control import ValveControl
from hil_drivers.valve_state import ValveState

_CONTROL_WORD, _STATUS_WORD = (0x6040, 0), (0x6041, 0)
_SET_POINT, _ACTUAL_VALUE = (0x6300, 1), (0x6301, 1)
_REFERENCE = (0x6311, 1)
_DEVICE_MODE = (0x6042, 0)
_SET_POINT_BY_BUS = 1
_CONTROL_MODE, _PRESSURE_SET_POINT = (0x6043, 0), (0x6380, 1)
_PRESSURE_ACTUAL, _PRESSURE_REFERENCE = (0x6381, 1), (0x6391, 1)
_PRESSURE_ACTIVE = 1 << 8
_AXIS_SET_POINT, _AXIS_ACTUAL = (0x6600, 1), (0x6601, 1)
_UNIT, _PREFIX = 2, 3
_METRE = 1
_HIGHEST_AXIS = (1 << 31) - 1
_CONSUMER_HEARTBEAT = (0x1016, 1)


class ControlMode(IntEnum):
    """The control mode of a valve (0x6043)."""

    SPOOL = 2
    PRESSURE = 4
    PRESSURE_AND_FLOW = 5
    AXIS_POSITION = 9


class Output(NamedTuple):
    """A value for the device: which sent PDO brings it, and where in it it stands."""

    pdo: SentPdo
    signal: Signal


class ProportionalValve(ValveControl, Device):
    """A proportional valve whose set-point comes by bus.

    It takes commands in NMT state OPERATIONAL only. A valve that was set up with a command time-out
    must be told its set-point again and again, by `spool_setpoint` or `send`; it goes to its fault
    reaction otherwise, which is its protection against a controller that died.

    Args:
        network: the network that the device is on.
        node_id: its node-ID.
        eds: its EDS.
        max_age: values older than this [s] are refused.

    Raises:
        ValueError: the node-ID is out of range.
        EdsError: the EDS cannot be read.
        DeviceMismatchError: the EDS does not map what the driver needs.
    """

    PROFILE = 408
    RELEASED = "left unwatched"

    def __init__(
        self,
        network: Network,
        node_id: int,
        eds: Path | str = VALVE_408,
        *,
        max_age: float = 0.1,
    ) -> None:
        super().__init__(network, node_id, eds, max_age=max_age)
        status = self._carriers(PdoKind.TPDO, [_STATUS_WORD, _ACTUAL_VALUE])
        command = self._carriers(PdoKind.RPDO, [_CONTROL_WORD, _SET_POINT])
        inputs, outputs = self._add_inputs(status), self._outputs(command)
        self._status, self._actual = inputs[_STATUS_WORD], inputs[_ACTUAL_VALUE]
        self._control, self._setpoint = outputs[_CONTROL_WORD], outputs[_SET_POINT]
        self._sent = list(dict.fromkeys(output.pdo for output in outputs.values()))
        self._reference = self.node.default(*_REFERENCE, otherwise=16384)

    def setup(
        self,
        *,
        transmission_type: int = 1,
        event_timer: float = 0.0,
        heartbeat_period: float = 0.1,
        command_timeout: float = 0.1,
        heartbeat_timeout: float = 0.0,
    ) -> None:
        """Check the device, read its scaling, and set how it sends and what it watches.

        Args:
            transmission_type: 1 to 240 sends status and actual value with each n-th SYNC, 254 or
                255 by event.
            event_timer: longest time between two of them [s]; 0 is none.
            heartbeat_period: between the device's heartbeats [s]; 0 is none.
            command_timeout: the device's reaction comes when no command did for this time [s]; 0
                switches that off.
            heartbeat_timeout: the same for our heartbeat, see `Network.start_heartbeat`.
        """
        milliseconds("command time-out", command_timeout)
        watch = self._heartbeat_watch(heartbeat_timeout)
        self._set_up(
            transmission_type=transmission_type,
            event_timer=event_timer,
            heartbeat_period=heartbeat_period,
        )
        self._read_reference()
        for pdo in self._sent:
            verify_mapping(self.node, pdo.mapping)
            self._keep_other_values(pdo)
        if self.node.has(*_DEVICE_MODE):
            self.node.write(*_DEVICE_MODE, _SET_POINT_BY_BUS)
        self._supervise(command_timeout, watch)
        self._is_set_up = True

    @property
    def primary(self) -> Input:
        """The PDO that brings the spool position."""
        return self._actual

    @property
    def status(self) -> Input:
        """The PDO that brings the status word, and where in it that stands."""
        return self._status

    @property
    def spool_position(self) -> float:
        """Spool position as fraction of full opening [-], positive for P to A."""
        return self._value(self._actual) / self._reference

    def set_control_mode(self, mode: ControlMode) -> None:
        """Choose what the valve controls; `SdoAbortError` where it has no sensor for it."""
        self.node.write(*_CONTROL_MODE, mode)

    def set_pressure(self, fraction: float) -> None:
        """Give the pressure set-point as fraction of the valve's full pressure, by SDO.

        Raises:
            ValueError: it is not between 0 and 1.
        """
        if not 0.0 <= fraction <= 1.0:
            raise ValueError(f"pressure {fraction}: 0 to 1 of the full pressure is right")
        self.node.write(
            *_PRESSURE_SET_POINT, round(fraction * self._read_full(_PRESSURE_REFERENCE))
        )

    def read_pressure(self) -> float:
        """Return the pressure that the valve measures as fraction of its full pressure, by SDO."""
        return self.node.read_integer(*_PRESSURE_ACTUAL) / self._read_full(_PRESSURE_REFERENCE)

    @property
    def is_limited_by_pressure(self) -> bool:
        """Return True while the pressure controller limits the spool set-point (p/Q mode)."""
        return bool(self._status_word() & _PRESSURE_ACTIVE)

    def set_axis_position(self, position: float) -> None:
        """Give the set-point of the axis [m], by SDO.

        Raises:
            ValueError: the object cannot hold it.
        """
        increments = position / self._metres_of(_AXIS_SET_POINT[0])
        if not abs(increments) <= _HIGHEST_AXIS:
            raise ValueError(f"axis position {position} m: 32 bits of the valve's unit are right")
        self.node.write(*_AXIS_SET_POINT, round(increments))

    def read_axis_position(self) -> float:
        """Return the position of the axis that the valve measures [m], by SDO."""
        return self.node.read_integer(*_AXIS_ACTUAL) * self._metres_of(_AXIS_ACTUAL[0])

    def _metres_of(self, index: int) -> float:
        """Return the length of an increment [m], by unit and prefix of the object.

        Raises:
            DeviceMismatchError: the object is in no metres, or in those of no machine.
        """
        unit = self.node.read_integer(index, _UNIT)
        if unit != _METRE:
            raise DeviceMismatchError(
                f"{self.node}: {object_name(index, _UNIT)} (unit) is {unit}; 1, metres, is right"
            )
        prefix = self.node.read_integer(index, _PREFIX)
        if not -12 <= prefix <= 3:
            raise DeviceMismatchError(
                f"{self.node}: {object_name(index, _PREFIX)} (prefix) is {prefix}; "
                "-12, picometres, to 3, kilometres, is right"
            )
        return float(10.0**prefix)

    def send(self) -> None:
        """Send control word and set-point as they are, again."""
        pdo, signal = self._setpoint
        signal.encode(pdo.data, round(self._fraction * self._reference))
        for sent in self._sent:
            self.network.send(sent.cob_id, bytes(sent.data))

    def _outputs(self, carriers: Mapping[ObjectKey, PdoMapping]) -> dict[ObjectKey, Output]:
        """Return the outputs that send these objects."""
        pdos = {mapping: SentPdo(mapping) for mapping in carriers.values()}
        return {
            key: Output(pdos[mapping], Signal(mapping, key, self.node.variable(*key)))
            for key, mapping in carriers.items()
        }

    def _read_reference(self) -> None:
        """Read what stands for full opening, where the device says so."""
        if self.node.has(*_REFERENCE):
            self._reference = self._read_full(_REFERENCE)

    def _read_full(self, key: ObjectKey) -> int:
        """Return a reference value.

        Raises:
            DeviceMismatchError: it is not positive.
        """
        reference = self.node.read_integer(*key)
        if reference < 1:
            raise DeviceMismatchError(
                f"{self.node}: {object_name(*key)} (reference value) is {reference}; "
                "a positive number, 16384 by default, is right"
            )
        return reference

    def _keep_other_values(self, pdo: SentPdo) -> None:
        """Fill what else an RPDO carries with what the device holds, to leave it as it is."""
        for mapped in pdo.mapping.objects:
            if mapped.key not in {_CONTROL_WORD, _SET_POINT}:
                value = self.node.read(*mapped.key)
                variable = self.node.variable(*mapped.key)
                Signal(pdo.mapping, mapped.key, variable).encode(pdo.data, value)

    def _heartbeat_watch(self, timeout: float) -> int:
        """Return the entry for 0x1016: whose heartbeat to watch, and for how long [ms].

        Raises:
            ValueError: we send no heartbeat, or the time-out is out of range.
        """
        timeout_ms = milliseconds("heartbeat time-out", timeout)
        if not timeout_ms:
            return 0
        if self.network.heartbeat_node_id is None:
            raise ValueError("heartbeat time-out without a heartbeat: start_heartbeat() first")
        return self.network.heartbeat_node_id << 16 | timeout_ms

    def _supervise(self, command_timeout: float, watch: int) -> None:
        """Set what the device watches: our commands [s], our heartbeat (entry for 0x1016)."""
        for pdo in self._sent:
            pdo.cob_id = configure_pdo(
                self.node, pdo.mapping, transmission_type=None, event_timer=command_timeout
            )
        if watch or self.node.has(*_CONSUMER_HEARTBEAT):
            self.node.write(*_CONSUMER_HEARTBEAT, watch)

    @property
    def _medium(self) -> Network:
        return self.network

    def _status_word(self) -> int:
        return int(self._value(self._status))

    def _read_status_word(self) -> int:
        # By SDO: that needs neither SYNC nor NMT state OPERATIONAL.
        return self.node.read_integer(*_STATUS_WORD)

    def _send_command(self, control_word: int) -> None:
        pdo, signal = self._control
        signal.encode(pdo.data, control_word)
        self.send()

    def _has_error(self) -> bool:
        return self.node.active_emergency is not None

    def _circumstances(self) -> str:
        nmt_state = self.node.nmt_state
        return f", in NMT state {nmt_state.name if nmt_state else 'unknown'}"

    def _release(self) -> None:
        # Our silence must be no fault.
        self._supervise(0.0, 0)

    def _fault(self, state: ValveState) -> DeviceFaultError:
        # A device may take the error back while the fault that it caused is still there.
        errors = [emergency for emergency in self.node.emergencies if not emergency.is_reset]
        if not errors:
            return DeviceFaultError(f"{self.node}: valve in {state.name}, no emergency message", 0)
        emergency = errors[-1]
        return DeviceFaultError(
            f"{self.node}: valve in {state.name} after emergency 0x{emergency.code:04X}, "
            f"{emergency.meaning}",
            emergency.code,
        )
