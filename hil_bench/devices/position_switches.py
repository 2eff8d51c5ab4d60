"""Switches of a CiA 406 encoder: cam switches 0x6300 to 0x6337, area state 0x6400.

Cam n + 1 of the one channel is bit n of the state 0x6300.01. It is active while the position is
between its limits, both included; once active, it stays so until the position is further outside
than its hysteresis. A cam that is not enabled is not active. The polarity turns a bit round,
whether its cam is enabled or not.

Sources: BEI MHK5 manual (objects, area state), Turck BL20 manual, object 6B00h (limits, polarity of
a cam that is not enabled). The sense of the hysteresis is this device's own.
"""

from typing import Final, NamedTuple

from hil_bench.canopen_device.datatypes import INTEGER32, UNSIGNED8, UNSIGNED16
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.devices.profile_objects import optional

OUT_OF_RANGE: Final = 1 << 0
"""Bit of the area state: the position is beyond what the encoder can measure."""
OVERFLOW: Final = 1 << 1
"""Bit of the area state: the position is above the work area."""
UNDERFLOW: Final = 1 << 2
"""Bit of the area state: the position is below the work area."""

_CAMS: Final = 8
_LOWEST: Final = -(1 << 31)
_HIGHEST: Final = (1 << 31) - 1


class Cam(NamedTuple):
    """The objects of one cam: limits and hysteresis [steps]."""

    low: Variable
    high: Variable
    hysteresis: Variable

    def is_active(self, position: int, *, was_active: bool) -> bool:
        """Return True if the cam is active at `position`."""
        margin = self.hysteresis.value if was_active else 0
        return bool(self.low.value - margin <= position <= self.high.value + margin)


class CamSwitches:
    """The cams of one channel."""

    def __init__(self, object_dictionary: ObjectDictionary) -> None:
        """Bind the profile's objects; EdsError where one is of a wrong kind."""
        od = object_dictionary
        self._state = optional(od, 0x6300, 1, UNSIGNED8)
        self._enable = optional(od, 0x6301, 1, UNSIGNED8)
        self._polarity = optional(od, 0x6302, 1, UNSIGNED8)
        self._cams = tuple(
            Cam(
                optional(od, 0x6310 + number, 1, INTEGER32),
                optional(od, 0x6320 + number, 1, INTEGER32),
                optional(od, 0x6330 + number, 1, UNSIGNED16),
            )
            for number in range(_CAMS)
        )
        self._active = 0

    def restart(self) -> None:
        """Begin anew: no cam has been active."""
        self._active = 0

    def switch(self, position: int) -> None:
        """Show the cams at `position` [steps]."""
        enabled: int = self._enable.value
        polarity: int = self._polarity.value
        self._active = self._present(position, enabled) if enabled else 0
        self._state.value = self._active ^ polarity

    def _present(self, position: int, enabled: int) -> int:
        active = 0
        for number, cam in enumerate(self._cams):
            bit = 1 << number
            if enabled & bit and cam.is_active(position, was_active=bool(self._active & bit)):
                active |= bit
        return active


class WorkArea:
    """The area in which the machine is meant to work."""

    def __init__(self, object_dictionary: ObjectDictionary) -> None:
        """Bind the profile's objects; EdsError where one is of a wrong kind."""
        self._state = optional(object_dictionary, 0x6400, 1, UNSIGNED8)
        self._low = optional(object_dictionary, 0x6401, 1, INTEGER32, absent=_LOWEST)
        self._high = optional(object_dictionary, 0x6402, 1, INTEGER32, absent=_HIGHEST)

    def show(self, position: int, *, is_out_of_range: bool) -> None:
        """Show where `position` [steps] is, and whether the encoder could measure it."""
        low: int = self._low.value
        high: int = self._high.value
        state = OUT_OF_RANGE if is_out_of_range else 0
        if position > high:
            state |= OVERFLOW
        if position < low:
            state |= UNDERFLOW
        self._state.value = state
