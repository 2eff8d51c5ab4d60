"""Driver for a proportional valve by the auxiliary valve messages of ISO 11783-7, B.11 and B.13."""

import contextlib
import math
from enum import IntEnum
from typing import Final, Self

from hil_drivers.errors import DeviceFaultError, DriverError, StaleValueError
from hil_drivers.j1939.address_claim import ClaimState
from hil_drivers.j1939.device import J1939Device
from hil_drivers.j1939.port import J1939Port

REPEAT: Final = 0.1
"""Time between two commands while the caller waits [s]."""

_COMMAND, _ESTIMATED_FLOW = 0xFE30, 0xFE10
_PRIORITY: Final = 3
_HIGHEST_NUMBER: Final = 15
_STEPS: Final = 250
_HIGHEST_FLOW: Final = 250
_LEAST_BYTES: Final = 5


class FlowState(IntEnum):
    """The state of a valve's flow, by its last message; other values are reserved."""

    BLOCKED = 0
    EXTEND = 1
    RETRACT = 2
    FLOAT = 3
    ERROR = 14
    NOT_AVAILABLE = 15


class ExitReason(IntEnum):
    """Why a valve obeys no command; other values are reserved, or not for us."""

    NONE = 0
    TIMEOUT = 5
    INVALID = 6
    FAULT = 9
    UNKNOWN = 63


class AuxiliaryValve(J1939Device):
    """A valve driver.

    Once a set-point is assigned it is sent again each 100 ms while the caller waits in the network,
    since such a valve goes to its centre without.

    Args:
        port: our end of the bus.
        address: of the valve.
        number: of the valve, 0 to 15.
        max_age: values older than this [s] are refused.

    Attributes:
        max_age: as passed in; may be changed.
        received_at: when the last estimated flow came [s]; -inf before.

    Raises:
        ValueError: address or number is out of range.
    """

    def __init__(
        self, port: J1939Port, address: int, *, number: int = 0, max_age: float = 0.3
    ) -> None:
        super().__init__(port, address)
        if not 0 <= number <= _HIGHEST_NUMBER:
            raise ValueError(f"auxiliary valve {number}: 0 to {_HIGHEST_NUMBER} is right")
        self.max_age = max_age
        self.received_at = -math.inf
        self._number = number
        self._flow = math.nan
        self._state, self._reason = FlowState.NOT_AVAILABLE, ExitReason.NONE
        self._fraction = 0.0
        self._due = math.inf
        port.subscribe(_ESTIMATED_FLOW + number, self._take_flow)
        port.network.add_service(self._repeat)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def age(self) -> float:
        """Time since the last estimated flow came [s]; infinite before the first."""
        return self.port.network.now() - self.received_at

    @property
    def spool_setpoint(self) -> float:
        """Set-point as fraction of full flow, -1 to 1, positive extends; assigning sends it."""
        return self._fraction

    @spool_setpoint.setter
    def spool_setpoint(self, fraction: float) -> None:
        if not -1.0 <= fraction <= 1.0:
            raise ValueError(f"spool set-point {fraction}: a fraction from -1 to 1 is right")
        self._fraction = fraction
        self.send()

    @property
    def flow(self) -> float:
        """Estimated flow as a fraction of the full flow, positive extends; NaN for an error."""
        self._check_age()
        return self._flow

    @property
    def state(self) -> FlowState:
        """The flow state that the valve reports."""
        self._check_age()
        return self._state

    @property
    def exit_reason(self) -> ExitReason:
        """Why it obeys no command."""
        self._check_age()
        return self._reason

    def check_active(self) -> None:
        """Check that the valve obeys our commands.

        Raises:
            DeviceFaultError: it says that it obeys none.
        """
        if self.state is FlowState.ERROR or self.exit_reason is not ExitReason.NONE:
            spn = self.trouble_codes[0].spn if self.trouble_codes else 0
            codes = ", ".join(f"SPN {code.spn} FMI {code.fmi}" for code in self.trouble_codes)
            said = f"; it reports {codes}" if codes else ""
            what = f"{self}: {self.state.name}, obeys no command: {self.exit_reason.name}{said}"
            raise DeviceFaultError(what, spn)

    def send(self) -> None:
        """Send the set-point as it is, again."""
        steps = round(abs(self._fraction) * _STEPS)
        state = FlowState.BLOCKED
        if steps:
            state = FlowState.EXTEND if self._fraction > 0.0 else FlowState.RETRACT
        data = bytes((steps, 0xFF, 0xF0 | state, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF))
        self.port.send(_COMMAND + self._number, data, priority=_PRIORITY)
        self._due = self.port.network.now() + REPEAT

    def close(self) -> None:
        """Block the valve, and command it no more."""
        self._fraction = 0.0
        with contextlib.suppress(DriverError):  # its own time-out blocks it then
            self.send()
        self._due = math.inf
        self.port.network.remove_service(self._repeat)

    def _check_age(self) -> None:
        if not self.age <= self.max_age:
            heard = math.isfinite(self.received_at)
            what = f"estimated flow {self.age:.3g} s old" if heard else "no estimated flow yet"
            raise StaleValueError(f"{what}, {self.max_age:g} s allowed", device=self)

    def _repeat(self, now: float) -> float:
        if now >= self._due:
            self._due = now + REPEAT
            if self.port.state is ClaimState.CLAIMED:  # a wait does not raise what a set-point does
                self.send()
        return self._due

    def _take_flow(self, source: int, data: bytes, now: float) -> bool:
        if source != self.address:
            return True
        if len(data) < _LEAST_BYTES:
            return False
        state, reason, flow = data[2] & 0xF, data[4] & 0x3F, data[0]
        self._state = FlowState(state) if state in [*FlowState] else FlowState.NOT_AVAILABLE
        self._reason = ExitReason(reason) if reason in [*ExitReason] else ExitReason.UNKNOWN
        is_valid = flow <= _HIGHEST_FLOW and self._state is not FlowState.ERROR
        self._flow = (flow - 125) / 100.0 if is_valid else math.nan
        self.received_at = now
        return True
