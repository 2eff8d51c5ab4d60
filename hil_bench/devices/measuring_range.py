"""The measuring range of a CiA 406 encoder, and its type: 0x6002, 0x650A and 0x650B.

The total measuring range 0x6002 and the lowest and highest position 0x650A.02 and 0x650A.03 count
measuring steps; no preset shifts them. 0x650B is the serial number of 0x1018.04.

Sources: Temposonics E-Series and TR-Electronic LA-46 manuals (objects), BEI MHK5 manual (serial
number). Makers give 0x6002 as rw and say that the scaling is fixed; so where an EDS file lets the
bus write it, it takes the range that it has and no other.
"""

from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import INTEGER32, UNSIGNED32
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.devices.profile_objects import optional
from hil_bench.devices.saturation import saturate
from hil_bench.errors import SdoAbort

_MOST_STEPS: Final = 0xFFFFFFFF


class MeasuringRange:
    """The range of one encoder."""

    def __init__(self, object_dictionary: ObjectDictionary, span: tuple[float, float]) -> None:
        """Bind the profile's objects; EdsError where one is of a wrong kind.

        Args:
            object_dictionary: that of the encoder.
            span: positions at the ends of the measuring range [m].
        """
        od = object_dictionary
        self._object_dictionary = od
        self._span = span
        self._total = optional(od, 0x6002, 0, UNSIGNED32)
        self._total.add_check(self._check_total)
        self._ends = tuple(optional(od, 0x650A, sub, INTEGER32, UNSIGNED32) for sub in (2, 3))
        self._serial_number = optional(od, 0x650B, 0, UNSIGNED32)

    def show(self, counts: float) -> None:
        """Show the range in steps.

        Args:
            counts: steps in a metre, negative where the direction is reversed.
        """
        first, last = sorted(round(end * counts) for end in self._span)
        for variable, steps in zip(self._ends, (first, last), strict=True):
            low, high = int(variable.data_type.low or 0), int(variable.data_type.high or 0)
            variable.value = saturate(steps, low, high, unknown=0)
        self._total.value = saturate(last - first, 0, _MOST_STEPS, unknown=0)
        self._serial_number.value = self._object_dictionary.number(0x1018, 4)

    def _check_total(self, steps: int) -> None:
        """Refuse another range than the encoder has.

        Raises:
            SdoAbort: 0609 0030.
        """
        if steps != self._total.value:
            raise SdoAbort(*abort_codes.VALUE)
