"""When a CiA 404 sensor sends its process value by itself: 0x6133.01 to 0x6135.01.

Each is an event for the TPDOs that carry the value (types 254 and 255). The delta: the value has
changed by more than 0x6133.01 since the last event, or since the delta was set; a negative delta
means by anything, 0 is off. The limits: the value has gone below 0x6134.01, or above 0x6135.01;
they are off while the upper one is not above the lower one, as by default.

Source: esd CAN-CBX-Pt100 manual C.3032.21, objects 9133h and 9134h. That a limit counts once, when
it is passed, and how the limits are switched off, is this device's own.
"""

import math

from hil_bench.canopen_device.datatypes import REAL32
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.devices.analogue_input import check_real32
from hil_bench.devices.profile_objects import TpdoTrigger, optional


class ValueInterrupts:
    """The interrupts of one channel."""

    def __init__(
        self, object_dictionary: ObjectDictionary, trigger: TpdoTrigger, channel: int = 1
    ) -> None:
        """Bind the profile's objects; EdsError where one is of a wrong kind.

        Args:
            object_dictionary: that of the sensor.
            trigger: sends the TPDOs that carry the value.
            channel: sub-index of the objects.
        """
        self._trigger = trigger
        self._delta = optional(object_dictionary, 0x6133, channel, REAL32)
        self._lower = optional(object_dictionary, 0x6134, channel, REAL32)
        self._upper = optional(object_dictionary, 0x6135, channel, REAL32)
        for variable in (self._delta, self._lower, self._upper):
            variable.add_check(check_real32)
        self._last = math.nan
        self._is_outside = False

    def watch(self, value: float) -> None:
        """Take a new process value."""
        delta: float = self._delta.value
        lower: float = self._lower.value
        upper: float = self._upper.value
        was_outside = self._is_outside
        self._is_outside = lower < upper and not lower <= value <= upper
        has_passed = self._is_outside and not was_outside
        if delta == 0.0 or math.isnan(self._last):
            self._last = value
        if has_passed or (delta != 0.0 and _has_changed(value, self._last, delta)):
            self._last = value
            self._trigger.pull()


def _has_changed(value: float, last: float, delta: float) -> bool:
    return value != last if delta < 0.0 else abs(value - last) > delta
