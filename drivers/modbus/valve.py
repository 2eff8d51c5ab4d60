"""Driver for a proportional valve with spool position feedback on Modbus."""

import logging
from pathlib import Path
from types import TracebackType
from typing import Self

from device_profiles import REGISTERS
from drivers.errors import (
    DeviceFaultError,
    DriverError,
    DriverTimeoutError,
    RemoteProtocolError,
)
from drivers.modbus.client import ModbusClient
from drivers.modbus.device import ModbusDevice
from drivers.modbus.register_map import Register, RegisterMap
from drivers.valve_state import RESET_FAULT, STATE_BITS, ValveState

logger = logging.getLogger(__name__)

POLL_PERIOD = 0.005
"""Time between two looks at the status word while a transition is awaited [s]."""

_INPUTS, _HOLDING, _COILS = "input_registers", "holding_registers", "coils"


class ProportionalValve(ModbusDevice):
    """A proportional valve whose set-point comes by Modbus.

    `setup` takes control of the valve, `close` gives it back. A valve that was set up with a
    command time-out must be told its set-point again and again, by `spool_setpoint` or `send`; it
    has a fault otherwise, which is its protection against a controller that died.

    Args:
        client: the client that reaches the device.
        unit_id: its unit-ID.
        registers: its register map.
        max_age: values older than this [s] are refused.

    Raises:
        ValueError: the unit-ID is out of range.
        RegisterMapError: the register map cannot be read.
        DeviceMismatchError: the register map lacks what the driver needs.
    """

    PROFILE = "valve_408"

    def __init__(
        self,
        client: ModbusClient,
        unit_id: int,
        registers: RegisterMap | Path | str = REGISTERS / "valve_408.toml",
        *,
        max_age: float = 0.1,
    ) -> None:
        super().__init__(client, unit_id, registers, max_age=max_age)
        self._status = self.map.require(_INPUTS, "0x6041")
        self._actual = self.map.require(_INPUTS, "spool_position")
        self._error = self.map.find(_INPUTS, "0x604E")
        self._setpoint = self.map.require(_HOLDING, "spool_setpoint")
        self._control_word = self.map.require(_HOLDING, "control_word")
        self._watchdog = self.map.require(_HOLDING, "watchdog")
        self._control = self.map.require(_COILS, "0x604F")
        self._poll_registers([self._actual, self._status, self._error])
        self._word = 0
        self._fraction = 0.0
        self._is_set_up = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def setup(self, *, command_timeout: float = 0.1) -> None:
        """Checks the device and takes control of it.

        Args:
            command_timeout: the device's reaction comes when no command did for this time [s]; 0
                switches that off.

        Raises:
            ValueError: the time-out is negative, or longer than the device can watch.
        """
        if not 0 <= command_timeout <= 65.535:
            raise ValueError(f"command time-out {command_timeout} s: 0 to 65.535 s is right")
        super().setup()
        self._write(self._watchdog, command_timeout)
        self._is_set_up = True
        self.client.write_coil(self.unit_id, self._control.address, on=True)
        self.poll()

    @property
    def state(self) -> ValveState:
        """State by the last status word."""
        return self._state_of(int(self._value(self._status)))

    def check_active(self) -> None:
        """Raises a `DeviceFaultError` if by the last status word the valve is not ACTIVE."""
        state = self.state
        if state is not ValveState.ACTIVE:
            raise self._fault(state)

    @property
    def spool_position(self) -> float:
        """Spool position as fraction of full opening [-], positive for P to A."""
        return self._value(self._actual) * self._actual.factor

    @property
    def spool_setpoint(self) -> float:
        """Spool set-point as fraction of full opening, -1 to 1; assigning sends it."""
        return self._fraction

    @spool_setpoint.setter
    def spool_setpoint(self, fraction: float) -> None:
        self._put_setpoint(fraction)
        self._write(self._setpoint, fraction)

    def send(self) -> None:
        """Sends the set-point as it is, again."""
        self._write(self._setpoint, self._fraction)

    def enable(self, *, timeout: float = 1.0) -> None:
        """Brings the valve to ACTIVE, where the spool follows the set-point.

        Out of a fault state leads `reset_fault`; a device in one gives a `DeviceFaultError`.
        """
        self._reach(ValveState.ACTIVE, timeout)

    def hold(self, *, timeout: float = 1.0) -> None:
        """Brings the valve to HOLD, where the spool is at the device's hold set-point."""
        self._put_setpoint(0.0)
        self._reach(ValveState.HOLD, timeout)

    def disable(self, *, timeout: float = 1.0) -> None:
        """Brings the valve to DISABLED."""
        self._put_setpoint(0.0)
        self._reach(ValveState.DISABLED, timeout)

    def reset_fault(self, *, timeout: float = 1.0) -> None:
        """Leads a valve out of a fault state, to INIT, DISABLED or HOLD, with set-point 0."""
        self._put_setpoint(0.0)
        deadline = self.client.now() + timeout
        while (state := self.read_state()) is ValveState.NOT_READY or state.is_fault:
            if self.client.now() >= deadline:
                raise self._fault(state)
            # The device acts on the edge of bit 3, so it must have seen it low before.
            self._command(ValveState.DISABLED.command)
            self._command(ValveState.DISABLED.command | RESET_FAULT)
        self._command(state.command)

    def read_state(self) -> ValveState:
        """Returns the state now, read from the device."""
        words = self.client.read_registers(
            self.unit_id, _INPUTS, self._status.address, self._status.count
        )
        return self._state_of(int(self._status.decode(words)))

    def close(self) -> None:
        """Leaves the valve disabled and gives its control back, as far as it can be reached.

        Never raises a `DriverError`: what could not be done is logged as a warning.
        """
        if not self._is_set_up:
            return
        for what, act in (("disabled", self.disable), ("given back", self._release)):
            try:
                act()
            except DriverError as error:
                logger.warning("%s: could not be %s: %s", self, what, error)

    def _release(self) -> None:
        self.client.write_coil(self.unit_id, self._control.address, on=False)

    def _write(self, register: Register, value: float) -> None:
        self.client.write_registers(self.unit_id, register.address, register.encode(value))

    def _put_setpoint(self, fraction: float) -> None:
        if not -1.0 <= fraction <= 1.0:
            raise ValueError(f"spool set-point {fraction}: a fraction from -1 to 1 is right")
        self._fraction = fraction

    def _command(self, control_word: int) -> None:
        """Sends set-point and control word, by one request where the map lets it."""
        setpoint, word = self._setpoint, self._control_word
        words = setpoint.encode(self._fraction)
        if setpoint.address + setpoint.count == word.address:
            words += word.encode(control_word)
            self.client.write_registers(self.unit_id, setpoint.address, words)
            return
        self._write(setpoint, self._fraction)
        self._write(word, control_word)

    def _reach(self, target: ValveState, timeout: float) -> None:
        """Commands a state until the device is there.

        Raises:
            DriverTimeoutError: it did not get there in time.
        """
        deadline = self.client.now() + timeout
        while True:
            self._command(target.command)
            state = self.read_state()
            if state is target:
                return
            if state.is_fault or (state is ValveState.NOT_READY and self._read_error()):
                raise self._fault(state)
            if self.client.now() >= deadline:
                raise DriverTimeoutError(
                    f"{self}: valve not {target.name} within {timeout:g} s: it is {state.name}"
                )
            self.client.pump_until(self.client.now() + POLL_PERIOD)

    def _read_error(self) -> int:
        """Returns the emergency error code of the present fault; 0 for none or where unknown."""
        if self._error is None:
            return 0
        words = self.client.read_registers(
            self.unit_id, _INPUTS, self._error.address, self._error.count
        )
        return int(self._error.decode(words))

    def _state_of(self, status_word: int) -> ValveState:
        try:
            return ValveState(status_word & STATE_BITS)
        except ValueError:
            raise RemoteProtocolError(
                f"{self}: status word 0x{status_word:04X} tells no state of CiA 408"
            ) from None

    def _fault(self, state: ValveState) -> DeviceFaultError:
        code = self._read_error()
        if not code:
            return DeviceFaultError(f"{self}: valve in {state.name}, no error code", 0)
        return DeviceFaultError(f"{self}: valve in {state.name} after error 0x{code:04X}", code)
