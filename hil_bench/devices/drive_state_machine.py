"""The power drive state machine of CiA 402 (IEC 61800-7-201), driven by the control word 0x6040.

    state                    status, bits 6 5 3 2 1 0   left by
    NOT_READY                0 0 0 0 0 0                itself
    SWITCH_ON_DISABLED       1 0 0 0 0 0                shutdown
    READY_TO_SWITCH_ON       0 1 0 0 0 1                switch on, disable voltage, quick stop
    SWITCHED_ON              0 1 0 0 1 1                the same, enable, shutdown
    OPERATION_ENABLED        0 1 0 1 1 1                the same, disable operation
    QUICK_STOP_ACTIVE        0 0 0 1 1 1                itself once it stands; disable voltage
    FAULT_REACTION           0 0 1 1 1 1                itself once it stands
    FAULT                    0 0 1 0 0 0                the rising edge of bit 7

One control word makes one transition; 0x0F in READY_TO_SWITCH_ON makes the two to
OPERATION_ENABLED, as most drives do.

The commands are bits of the control word: shutdown x110, switch on 0111, enable 1111 (bits 3 to 0),
disable voltage xx0x, quick stop x01x.
"""

from enum import StrEnum
from types import MappingProxyType
from typing import Final

RESET_BIT: Final = 1 << 7


class DriveState(StrEnum):
    """The states of the machine."""

    NOT_READY = "NOT_READY"
    SWITCH_ON_DISABLED = "SWITCH_ON_DISABLED"
    READY_TO_SWITCH_ON = "READY_TO_SWITCH_ON"
    SWITCHED_ON = "SWITCHED_ON"
    OPERATION_ENABLED = "OPERATION_ENABLED"
    QUICK_STOP_ACTIVE = "QUICK_STOP_ACTIVE"
    FAULT_REACTION = "FAULT_REACTION"
    FAULT = "FAULT"


STATUS: Final = MappingProxyType(
    {
        DriveState.NOT_READY: 0x00,
        DriveState.SWITCH_ON_DISABLED: 0x40,
        DriveState.READY_TO_SWITCH_ON: 0x21,
        DriveState.SWITCHED_ON: 0x23,
        DriveState.OPERATION_ENABLED: 0x27,
        DriveState.QUICK_STOP_ACTIVE: 0x07,
        DriveState.FAULT_REACTION: 0x0F,
        DriveState.FAULT: 0x08,
    }
)
"""The bits of the status word that tell the state."""

MOVING: Final = frozenset(
    {DriveState.OPERATION_ENABLED, DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT_REACTION}
)
"""States in which the drive has its axis."""

_ON: Final = frozenset(
    {
        DriveState.READY_TO_SWITCH_ON,
        DriveState.SWITCHED_ON,
        DriveState.OPERATION_ENABLED,
        DriveState.QUICK_STOP_ACTIVE,
    }
)


class DriveStateMachine:
    """The machine of one drive.

    Attributes:
        state: the present one.
    """

    def __init__(self) -> None:
        self.state = DriveState.SWITCH_ON_DISABLED
        self._word = 0

    def start(self) -> None:
        """Begin anew, as after power-on."""
        self.state = DriveState.SWITCH_ON_DISABLED
        self._word = 0

    def receive(self, word: int, *, may_enable: bool, may_reset: bool) -> None:
        """Obey a control word.

        Args:
            word: 0x6040.
            may_enable: whether OPERATION_ENABLED may be entered.
            may_reset: whether the cause of a fault is gone.
        """
        is_reset = bool(word & ~self._word & RESET_BIT)
        self._word = word
        if self.state is DriveState.FAULT:
            if is_reset and may_reset:
                self.state = DriveState.SWITCH_ON_DISABLED
        elif self.state in _ON or self.state is DriveState.SWITCH_ON_DISABLED:
            self.state = self._after(word, may_enable=may_enable)

    def _after(self, word: int, *, may_enable: bool) -> DriveState:
        state = self.state
        if not word & 0b10:  # disable voltage
            state = DriveState.SWITCH_ON_DISABLED
        elif not word & 0b100:  # quick stop
            is_moving = state in MOVING
            state = DriveState.QUICK_STOP_ACTIVE if is_moving else DriveState.SWITCH_ON_DISABLED
        elif state is DriveState.QUICK_STOP_ACTIVE:
            pass  # until it stands
        elif not word & 0b1:  # shutdown
            state = DriveState.READY_TO_SWITCH_ON
        elif state is not DriveState.SWITCH_ON_DISABLED:
            is_enabled = bool(word & 0b1000) and may_enable
            state = DriveState.OPERATION_ENABLED if is_enabled else DriveState.SWITCHED_ON
        return state

    def fault(self) -> None:
        """Take a fault; a moving axis is stopped first."""
        if self.state in MOVING:
            self.state = DriveState.FAULT_REACTION
        else:
            self.state = DriveState.FAULT

    def stand_still(self) -> None:
        """Hear that the axis stands: a quick stop or a fault reaction is over."""
        if self.state is DriveState.QUICK_STOP_ACTIVE:
            self.state = DriveState.SWITCH_ON_DISABLED
        elif self.state is DriveState.FAULT_REACTION:
            self.state = DriveState.FAULT
