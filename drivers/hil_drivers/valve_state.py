"""States of a proportional valve (CiA 408).

The device tells its state in bits 3 to 0 (R M H D) of the status word 0x6041; bits 2 to 0 (M H D)
of the control word 0x6040 lead there, through all states between. A rising edge of bit 3 of the
control word leads out of a fault state.

The source is the profile's table in the manual of Moog's ACV (B99224-DV018-D-211).
"""

from enum import IntEnum

RESET_FAULT = 0b1000
"""Bit of the control word whose rising edge resets a fault."""

STATE_BITS = 0b1111
"""Bits of the status word that tell the state."""


class ValveState(IntEnum):
    """State of the device, from bits R M H D of the status word.

    The spool follows the set-point only in ACTIVE; in HOLD and FAULT_HOLD it is at the device's
    hold set-point. NOT_READY is power-up, and also how FAULT_INIT reads.
    """

    NOT_READY = 0b0000
    INIT = 0b1000
    DISABLED = 0b1001
    HOLD = 0b1011
    ACTIVE = 0b1111
    FAULT_REACTION = 0b0111
    FAULT_HOLD = 0b0011
    FAULT_DISABLED = 0b0001

    @property
    def is_fault(self) -> bool:
        """Return True if this is certainly a fault state; NOT_READY may be one too."""
        return self in {self.FAULT_REACTION, self.FAULT_HOLD, self.FAULT_DISABLED}

    @property
    def command(self) -> int:
        """Control word that leads to this state."""
        return self & 0b0111
