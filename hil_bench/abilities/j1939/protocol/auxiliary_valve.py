"""The driver of a proportional valve: auxiliary valve command and estimated flow, ISO 11783-7.

The command (PGN 65072 + number) says which port and how much; each 100 ms the device says what
flows (PGN 65040 + number), in which state it is and why it obeys no command.
"""

import math
from enum import IntEnum
from typing import Final

from hil_bench.abilities.j1939.protocol.ecu import Ecu
from hil_bench.abilities.j1939.protocol.signals import Signal
from hil_bench.canopen_device.agenda import MILLISECOND

COMMAND: Final = 0xFE30
ESTIMATED_FLOW: Final = 0xFE10
"""PGNs of valve 0; those of the others follow."""

HIGHEST_NUMBER: Final = 15
PERIOD: Final = 100 * MILLISECOND
PRIORITY: Final = 3

FLOW_COMMAND: Final = Signal(0, 8, 0.4)
FLOW: Final = Signal(0, 8, 1.0, -125.0)

_FLOW_SPN: Final = 1907
"""Port flow command of valve 0."""
_ABNORMAL_RATE: Final = 9
_NEUTRAL: Final = 0.01
_LEAST_BYTES: Final = 3
_NO_LIMIT: Final = 0x1F
_RESERVED: Final = 0x30


def pack_command(share: float) -> bytes:
    """Return the data of a command; `share` is a part of the full flow, -1 to 1."""
    flow = FLOW_COMMAND.raw(abs(100.0 * share))
    state = ValveState.BLOCK
    if flow:
        state = ValveState.EXTEND if share > 0.0 else ValveState.RETRACT
    return bytes((flow, 0xFF, 0xF0 | state, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF))


def command_in(data: bytes) -> float:
    """Return the part of the full flow that a command asks for, -1 to 1; NaN for nothing valid."""
    if len(data) < _LEAST_BYTES:
        return math.nan
    share, state = FLOW_COMMAND.value(data) / 100.0, data[2] & 0xF
    if state == ValveState.BLOCK:
        return 0.0
    if state not in {ValveState.EXTEND, ValveState.RETRACT} or not share <= 1.0:
        return math.nan  # this spool cannot float
    return share if state == ValveState.EXTEND else -share


class ValveState(IntEnum):
    """State of a valve, and of a command."""

    BLOCK = 0
    EXTEND = 1
    RETRACT = 2
    ERROR = 14


class ExitReason(IntEnum):
    """Why no command is obeyed."""

    NONE = 0
    TIMEOUT = 5
    INVALID = 6
    FAULT = 9


class AuxiliaryValve:
    """A valve driver on an ECU, in place of a valve of CiA 408.

    Args:
        ecu: that carries it on the bus.
        number: of the valve, 0 to 15.
        full_opening: spool position of 100 % [m].
        timeout: the longest time between two commands [ns]; 0 for any.

    Attributes:
        full_opening: as passed in.
        reason: why it obeys no command.
        position: of the spool, as a part of the full opening.
    """

    def __init__(self, ecu: Ecu, number: int, *, full_opening: float, timeout: int) -> None:
        self.full_opening = full_opening
        self.reason = ExitReason.NONE
        self._ecu, self._timeout = ecu, timeout
        self.position = 0.0
        self._share = 0.0
        self._shown = 0.0
        self._deadline: int | None = None
        self._trouble = _FLOW_SPN if number == 0 else None
        ecu.take(COMMAND + number, self._take)
        ecu.provide(ESTIMATED_FLOW + number, self._flow, period=PERIOD, priority=PRIORITY)

    @property
    def state(self) -> ValveState:
        """The state of the spool."""
        if self._shown != self._shown:
            return ValveState.ERROR
        if abs(self._shown) < _NEUTRAL:
            return ValveState.BLOCK
        return ValveState.EXTEND if self._shown > 0.0 else ValveState.RETRACT

    def command(self, now: int) -> float:
        """Return the spool set-point [m]; 0 without a valid command that is not too old."""
        if self._deadline is not None and now >= self._deadline:
            self._share = 0.0
            self._deadline = None
            self.reason = ExitReason.TIMEOUT
            if self._trouble is not None:
                self._ecu.begin_trouble(self._trouble, _ABNORMAL_RATE)
        return self._share * self.full_opening

    @property
    def setpoint(self) -> float:
        """The commanded set-point, as a part of the full opening."""
        return self._share

    @property
    def flow(self) -> float:
        """The reported flow, as a part of the full flow; NaN for an error."""
        return self._shown

    def publish(self, spool_position: float, now: int) -> None:  # noqa: ARG002 - it shows it later
        """Take the spool position [m]."""
        self.position = spool_position / self.full_opening

    def show(self, flow: float, now: int) -> None:  # noqa: ARG002 - it is sent later
        """Say from now on that this flows, as a part of the full flow; NaN for an error."""
        self._shown = flow

    def _take(self, _source: int, data: bytes, now: int) -> None:
        """Take a command; one that says nothing valid blocks the valve."""
        if len(data) < _LEAST_BYTES:
            return
        if self.reason is ExitReason.TIMEOUT and self._trouble is not None:
            self._ecu.end_trouble(self._trouble, _ABNORMAL_RATE)
        self._deadline = now + self._timeout if self._timeout else None
        share = command_in(data)
        is_valid = not math.isnan(share)
        self.reason = ExitReason.NONE if is_valid else ExitReason.INVALID
        self._share = share if is_valid else 0.0

    def _flow(self) -> bytes:
        percent = 100.0 * self._shown
        extend, retract = FLOW.raw(percent), FLOW.raw(-percent)
        state = _RESERVED | self.state
        reason = ExitReason.FAULT if self.state is ValveState.ERROR else self.reason
        return bytes((extend, retract, state, _NO_LIMIT, 0xC0 | reason, 0xFF, 0xFF, 0xFF))
