"""Protocols of the sensor drivers, the same on every bus.

A controller that is written against these protocols does not care which bus that is: the classes of
`hil_drivers` are CANopen's, those of `hil_drivers.modbus` Modbus'.
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol

from hil_drivers.valve_state import ValveState


class Reading(NamedTuple):
    """One value of a sensor.

    Attributes:
        value: in `unit`; NaN where it is not valid.
        unit: symbol of its SI unit.
        received_at: when it came, on the controller's clock [s].
        is_valid: whether the device says so.
    """

    value: float
    unit: str
    received_at: float
    is_valid: bool


class Medium(Protocol):
    """The bus as a control loop needs it."""

    def now(self) -> float:
        """Return the controller's time [s]."""

    def sync(self) -> None:
        """Ask all devices that wait for it to send, where the bus has such a call."""

    def pump_until(self, deadline: float) -> None:
        """Wait until `deadline` [s], and take what comes meanwhile."""

    def wait_for(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Wait until `condition` holds, and return whether it did within `timeout` seconds."""


class PolledDevice(Protocol):
    """A device whose values come by themselves, or when it is asked."""

    max_age: float
    """Values older than this [s] are refused."""

    @property
    def received_at(self) -> float:
        """When the oldest of its values came, on the controller's clock [s]; -inf before."""

    @property
    def age(self) -> float:
        """Time since then [s]."""

    def setup(self) -> None:
        """Check that the device is what it should be, and have it give its values."""

    def poll(self) -> bool:
        """Ask for the present values and return True; False where they come by themselves."""


class PressureSource(PolledDevice, Protocol):
    """A pressure sensor on any bus."""

    @property
    def pressure(self) -> float:
        """Pressure [Pa]; NaN while the device says that its value is not valid."""

    @property
    def is_valid(self) -> bool:
        """Return True if the device says that its value is valid."""

    @property
    def reading(self) -> Reading:
        """The pressure with unit, time and validity."""


class PositionSource(PolledDevice, Protocol):
    """A position sensor on any bus."""

    @property
    def position(self) -> float:
        """Position [m]."""

    @property
    def speed(self) -> float:
        """Speed [m/s]."""

    @property
    def is_valid(self) -> bool:
        """Return True if the device says that its value is valid."""

    @property
    def reading(self) -> Reading:
        """The position with unit, time and validity."""


class CommandedValve(PolledDevice, Protocol):
    """A proportional valve on any bus."""

    spool_setpoint: float
    """Spool set-point as fraction of full opening, -1 to 1; assigning sends it."""

    @property
    def state(self) -> ValveState:
        """State by the last status word."""

    @property
    def spool_position(self) -> float:
        """Spool position as fraction of full opening [-], positive for P to A."""

    def check_active(self) -> None:
        """Raise a `DeviceFaultError` if by the last status word the valve is not ACTIVE."""

    def enable(self, *, timeout: float = 1.0) -> None:
        """Bring the valve to ACTIVE, where the spool follows the set-point."""

    def hold(self, *, timeout: float = 1.0) -> None:
        """Bring the valve to HOLD, where the spool is at the device's hold set-point."""

    def disable(self, *, timeout: float = 1.0) -> None:
        """Bring the valve to DISABLED."""

    def reset_fault(self, *, timeout: float = 1.0) -> None:
        """Lead the valve out of a fault state, with set-point 0."""

    def read_state(self) -> ValveState:
        """Return the state now, asked of the device."""

    def close(self) -> None:
        """Leave the valve disabled and no longer watching us."""
