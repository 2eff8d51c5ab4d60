"""The control deviation monitoring of a CiA 408 valve: 0x6351 to 0x6355; of its axis: 0x6651 ff.

A control deviation outside the thresholds that lasts the delay time is an error: bit 11 of the
status word, EMCY 0x8301, for the axis 0x8303. The time begins anew when the deviation is back
inside, when the fault is acknowledged, and when a parameter of the monitoring is written.

Source: Moog ACV CANopen manual B99224-DV018-D-211, sections 7.15.1 and 7.15.3 (function), 8.1.4
(error codes).
"""

from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import INTEGER8, INTEGER16, INTEGER32, UNSIGNED16
from hil_bench.canopen_device.emcy import DEVICE_PROFILE, EmcyProducer
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.devices.profile_objects import optional
from hil_bench.errors import SdoAbort

DEVIATION_EMCY: Final = 0x8301
"""Position control monitoring."""

_MILLISECOND: Final = 1_000_000


class DeviationMonitor:
    """The monitoring of one valve.

    Attributes:
        is_on: whether it watches.
        has_tripped: whether the deviation has been outside for too long, and still is.
    """

    def __init__(
        self,
        object_dictionary: ObjectDictionary,
        emcy: EmcyProducer,
        *,
        base: int = 0x6350,
        code: int = DEVIATION_EMCY,
    ) -> None:
        """Bind the profile's objects; EdsError where one is of a wrong kind.

        Args:
            object_dictionary: of the valve.
            emcy: sends what it finds.
            base: index of the control deviation, before those of the monitoring.
            code: of its emergency message.
        """
        self._emcy, self._code = emcy, code
        od = object_dictionary
        self._type = optional(od, base + 1, 0, INTEGER8)
        self._delay = optional(od, base + 2, 1, UNSIGNED16)
        self._upper = optional(od, base + 4, 1, INTEGER16, INTEGER32)
        self._lower = optional(od, base + 5, 1, INTEGER16, INTEGER32)
        self._type.add_check(_check_type)
        for variable in (self._type, self._delay, self._upper, self._lower):
            variable.add_hook(self.restart)
        self.is_on = self.has_tripped = False
        self.restart()

    def restart(self, _written: int = 0) -> None:
        """Begin anew with the objects' present values."""
        self.is_on = self._type.value == 1
        self._outside_since: int | None = None
        self._recover()

    def watch(self, deviation: int, now: int) -> bool:
        """Take the deviation [increments] at `now` [ns]; return whether it has just tripped."""
        if self._lower.value <= deviation <= self._upper.value:
            self._outside_since = None
            self._recover()
            return False
        if self._outside_since is None:
            self._outside_since = now
        if self.has_tripped or now - self._outside_since < self._delay.value * _MILLISECOND:
            return False
        self.has_tripped = True
        self._emcy.raise_error(self._code, DEVICE_PROFILE)
        return True

    def _recover(self) -> None:
        if self.has_tripped:
            self.has_tripped = False
            self._emcy.clear_error(self._code)


def _check_type(monitoring: int) -> None:
    if monitoring not in {0, 1}:
        raise SdoAbort(*abort_codes.VALUE)
