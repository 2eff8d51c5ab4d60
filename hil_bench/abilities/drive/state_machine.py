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

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.object_dictionary import Variable
from hil_bench.errors import SdoAbort

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


# Homing of a drive on its current position: CiA 402, mode 6, methods 35 and 37.
#
# The rising edge of bit 4 of the control word starts it; once the axis stands, where it is counts
# as 0. Taking bit 4 away before that interrupts it. Bits 13, 12 and 10 of the status word: 0 0 0
# under way, 0 0 1 interrupted or not started, 0 1 1 complete. Neither method can fail, so bit 13
# stays 0.
#
# Sources: the bits by open masters and drives (a table quoted in several of them), the manuals of
# Parker and Kollmorgen; the methods by the manual of KEB, ETG.6010 as open masters quote it, and
# drivers of Festo and Ingenia drives. On the sign of a home offset (0x607C) manuals disagree: the
# drive has none. Methods that search a switch or an index pulse have nothing to search here.

METHODS: Final = (35, 37)
"""Values that 0x6098 may hold; both are the current position, the first is the older number."""

_START: Final = 1 << 4
_REACHED, _ATTAINED = 1 << 10, 1 << 12


class Homing:
    """The course of homing, and the position that counts as 0.

    Args:
        method: 0x6098.

    Attributes:
        origin: position of the encoder that counts as 0 [increments].
        is_under_way: whether it was started and waits for the axis to stand.
    """

    def __init__(self, method: Variable) -> None:
        method.add_check(_check_method)
        self.origin = 0.0
        self.is_under_way = False
        self._is_attained = False
        self._was_set = False

    def restart(self) -> None:
        """Forget the home position, as at power-on."""
        self.origin = 0.0
        self.is_under_way = self._is_attained = self._was_set = False

    def receive(self, word: int, *, may_start: bool) -> None:
        """Take a control word.

        Args:
            word: the control word.
            may_start: whether the drive is enabled and in this mode.
        """
        is_set = bool(word & _START)
        if is_set and not self._was_set and may_start:
            self.is_under_way, self._is_attained = True, False
        elif not (is_set and may_start):
            self.is_under_way = False
        self._was_set = is_set

    def attain(self, position: float) -> None:
        """Let the present position count as 0.

        Args:
            position: by the origin of before [increments].
        """
        self.origin += position
        self.is_under_way, self._is_attained = False, True

    @property
    def status(self) -> int:
        """Bits of the status word."""
        if self.is_under_way:
            return 0
        return _REACHED | (_ATTAINED if self._is_attained else 0)


def _check_method(method: int) -> None:
    if method not in METHODS:
        raise SdoAbort(*abort_codes.VALUE)
