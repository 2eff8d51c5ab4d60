"""The state machine of a proportional valve (CiA 408, device control), on any bus."""

import logging
from abc import ABC, abstractmethod
from typing import ClassVar, Self

from hil_drivers.errors import (
    DeviceFaultError,
    DriverError,
    DriverTimeoutError,
    RemoteProtocolError,
)
from hil_drivers.interfaces import Medium
from hil_drivers.valve_state import RESET_FAULT, STATE_BITS, ValveState

logger = logging.getLogger(__name__)

POLL_PERIOD = 0.005
"""Time that the device gets to act on a command before its state is read [s]."""


class ValveControl(ABC):
    """Common parts of the drivers of a valve: its states, its set-point, and its end.

    A driver says how its bus tells the status word, takes set-point and control word, and explains
    a fault.
    """

    RELEASED: ClassVar[str]
    """What `close` leaves the valve besides disabled, as messages have it."""

    _fraction = 0.0
    _is_set_up = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def state(self) -> ValveState:
        """State by the last status word."""
        return self._state_of(self._status_word())

    def read_state(self) -> ValveState:
        """Return the state now, asked of the device."""
        return self._state_of(self._read_status_word())

    def check_active(self) -> None:
        """Raise a `DeviceFaultError` if by the last status word the valve is not ACTIVE."""
        state = self.state
        if state is not ValveState.ACTIVE:
            raise self._fault(state)

    @property
    def spool_setpoint(self) -> float:
        """Spool set-point as fraction of full opening, -1 to 1; assigning sends it."""
        return self._fraction

    @spool_setpoint.setter
    def spool_setpoint(self, fraction: float) -> None:
        if not -1.0 <= fraction <= 1.0:
            raise ValueError(f"spool set-point {fraction}: a fraction from -1 to 1 is right")
        self._fraction = fraction
        self.send()

    @abstractmethod
    def send(self) -> None:
        """Send the set-point as it is, again."""

    def enable(self, *, timeout: float = 1.0) -> None:
        """Bring the valve to ACTIVE, where the spool follows the set-point.

        Out of a fault state leads `reset_fault`; a device in one gives a `DeviceFaultError`.
        """
        self._reach(ValveState.ACTIVE, timeout)

    def hold(self, *, timeout: float = 1.0) -> None:
        """Bring the valve to HOLD, where the spool is at the device's hold set-point."""
        self._fraction = 0.0
        self._reach(ValveState.HOLD, timeout)

    def disable(self, *, timeout: float = 1.0) -> None:
        """Bring the valve to DISABLED."""
        self._fraction = 0.0
        self._reach(ValveState.DISABLED, timeout)

    def reset_fault(self, *, timeout: float = 1.0) -> None:
        """Lead a valve out of a fault state, to INIT, DISABLED or HOLD, with set-point 0."""
        self._fraction = 0.0
        deadline = self._medium.now() + timeout
        while (state := self.read_state()) is ValveState.NOT_READY or state.is_fault:
            if self._medium.now() >= deadline:
                raise self._fault(state)
            # The device acts on the edge of bit 3, so it must have seen it low before.
            self._command(ValveState.DISABLED.command)
            self._command(ValveState.DISABLED.command | RESET_FAULT)
        self._command(state.command)

    def close(self) -> None:
        """Disable and release the valve, as far as it can still be reached.

        Never raises a `DriverError`: what could not be done is logged as a warning, or, of a valve
        in a fault state, as information.
        """
        if not self._is_set_up:
            return
        for what, act in (("disabled", self.disable), (self.RELEASED, self._release)):
            try:
                act()
            except DriverError as error:
                # In a fault state the valve has stopped by itself.
                level = logging.INFO if isinstance(error, DeviceFaultError) else logging.WARNING
                logger.log(level, "%s: could not be %s: %s", self, what, error)

    def _reach(self, target: ValveState, timeout: float) -> None:
        """Command a state until the device is there.

        Raises:
            DriverTimeoutError: it did not get there in time.
        """
        deadline = self._medium.now() + timeout
        while True:
            self._command(target.command)
            state = self.read_state()
            if state is target:
                return
            if state.is_fault or (state is ValveState.NOT_READY and self._has_error()):
                raise self._fault(state)
            if self._medium.now() >= deadline:
                raise DriverTimeoutError(
                    f"{self}: valve not {target.name} within {timeout:g} s: "
                    f"it is {state.name}{self._circumstances()}"
                )

    def _command(self, control_word: int) -> None:
        """Send set-point and control word, and let the device act on them."""
        self._send_command(control_word)
        self._medium.pump_until(self._medium.now() + POLL_PERIOD)

    def _state_of(self, status_word: int) -> ValveState:
        try:
            return ValveState(status_word & STATE_BITS)
        except ValueError:
            raise RemoteProtocolError(
                f"{self}: status word 0x{status_word:04X} is no state of CiA 408"
            ) from None

    def _circumstances(self) -> str:
        """Return further reasons why the device does not reach a state."""
        return ""

    @property
    @abstractmethod
    def _medium(self) -> Medium:
        """The bus that the device is on."""

    @abstractmethod
    def _status_word(self) -> int:
        """Return the last status word."""

    @abstractmethod
    def _read_status_word(self) -> int:
        """Return the status word now, asked of the device."""

    @abstractmethod
    def _send_command(self, control_word: int) -> None:
        """Send set-point and control word."""

    @abstractmethod
    def _has_error(self) -> bool:
        """Return True if the device tells an error, so that NOT_READY is a fault state."""

    @abstractmethod
    def _fault(self, state: ValveState) -> DeviceFaultError:
        """Return the exception for a device in this state."""

    @abstractmethod
    def _release(self) -> None:
        """Have the device need us no longer."""
