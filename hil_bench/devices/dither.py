"""The dither of a CiA 408 valve: 0x6360 to 0x6362.

While it is on (0x6360 = 1) and the valve is ACTIVE, a sine of the amplitude 0x6361.01 [increments]
and the frequency 0x6362.01 [Hz] is added to what the spool is told; the demand value 0x6310.01
stays without it. It is sampled once a tick, so a frequency above half of the ticks a second shows
as a lower one.

Source: Moog ACV CANopen manual B99224-DV018-D-211 (objects and unit). Type and shape are this
device's own.
"""

import math
from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import INTEGER8, UNSIGNED16
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.devices.profile_objects import optional
from hil_bench.errors import SdoAbort

_SECOND: Final = 1_000_000_000


class Dither:
    """The dither of one valve.

    Attributes:
        type: 0x6360, 0 where it is off.
    """

    def __init__(self, od: ObjectDictionary) -> None:
        """Bind the profile's objects; EdsError where one is of a wrong kind."""
        self.type = optional(od, 0x6360, 0, INTEGER8)
        self.type.add_check(_check_type)
        self._amplitude = optional(od, 0x6361, 1, UNSIGNED16)
        self._frequency = optional(od, 0x6362, 1, UNSIGNED16)

    def swing(self, now: int) -> float:
        """Return the dither to add at `now` [ns], in increments."""
        # Whole periods go first, in integers, so that a long run loses no phase.
        phase = self._frequency.value * now % _SECOND / _SECOND
        return float(self._amplitude.value) * math.sin(2.0 * math.pi * phase)


def _check_type(kind: int) -> None:
    if kind not in {0, 1}:
        raise SdoAbort(*abort_codes.VALUE)
