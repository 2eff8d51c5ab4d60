"""From what a CiA 404 sensor measures, the field value, to what it tells, the process value.

In this order: filter 0x61A0 and 0x61A1 (its result is the field value 0x6100.01), the line through
the points (0x6120.01, 0x6121.01) and (0x6122.01, 0x6123.01), factor 0x6126.01 and offset 0x6127.01,
input offset 0x6124.01. By their defaults all of them are off. The line is off while its two field
values are equal, as they are by default.

Source: Axiomatic AX030301 manual, objects 61A0h and 61A1h (filters). What one sample is there, 10
ms, is one tick here. CiA 404 has factor and offset as another form of the same line; here both
count.
"""

import math
from enum import IntEnum
from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import REAL32, UNSIGNED8
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.devices.profile_objects import optional
from hil_bench.errors import SdoAbort

LARGEST_REAL32: Final = float(REAL32.high or 0.0)
_UNITY: Final = 1.0


class FilterType(IntEnum):
    """Values of 0x61A0.01."""

    OFF = 0
    MOVING_AVERAGE = 1
    REPEATING_AVERAGE = 2


class Filter:
    """The filter of one channel.

    Attributes:
        kind: what it does with a new sample: nothing, move towards it by 1 / `constant` of the
            difference, or give the mean of each `constant` samples.
        constant: 1 or more.
    """

    def __init__(self) -> None:
        self.kind: int = FilterType.OFF
        self.constant = 1
        self._value = math.nan
        self._sum = 0.0
        self._count = 0

    def restart(self) -> None:
        """Forget all samples; the next one goes through unchanged."""
        self._value = math.nan
        self._sum, self._count = 0.0, 0

    def pass_through(self, sample: float) -> float:
        """Return the filter's value after a new sample."""
        if math.isnan(self._value) or self.kind == FilterType.OFF:
            self._value = sample
        if self.kind == FilterType.MOVING_AVERAGE:
            self._value += (sample - self._value) / self.constant
        elif self.kind == FilterType.REPEATING_AVERAGE:
            self._sum += sample
            self._count += 1
            if self._count >= self.constant:
                self._value = self._sum / self._count
                self._sum, self._count = 0.0, 0
        return self._value


class AnalogueInput:
    """The analogue input function block of one channel.

    Attributes:
        field_value: 0x6100 of the channel, what is measured after the filter.
        input_offset: 0x6124 of the channel.
    """

    def __init__(self, object_dictionary: ObjectDictionary, channel: int = 1) -> None:
        """Bind the profile's objects of a channel; EdsError where one is of a wrong kind."""
        od = object_dictionary
        self._channel = channel
        self._filter = Filter()
        self.field_value = optional(od, 0x6100, channel, REAL32)
        self._points = tuple(self._bind(od, index) for index in range(0x6120, 0x6124))
        self.input_offset = self._bind(od, 0x6124)
        self._factor, self._offset = self._bind(od, 0x6126), self._bind(od, 0x6127)
        self._factor.default = self._factor.default or _UNITY
        self._factor.value = self._factor.value or _UNITY
        self._factor.add_check(_check_factor)
        self._filter_type = optional(od, 0x61A0, channel, UNSIGNED8)
        self._filter_type.add_check(_check_filter_type)
        self._filter_type.add_hook(self.restart)
        self._filter_constant = optional(od, 0x61A1, channel, UNSIGNED8, absent=1)
        self._filter_constant.add_check(_check_filter_constant)
        self._filter_constant.add_hook(self.restart)
        self.restart()

    def _bind(self, od: ObjectDictionary, index: int) -> Variable:
        variable = optional(od, index, self._channel, REAL32)
        variable.add_check(check_real32)
        variable.add_hook(self._configure)
        return variable

    def measure(self, sample: float) -> float:
        """Take a new sample, and return the process value."""
        if self._filter.kind:
            sample = self._filter.pass_through(sample)
        self.field_value.value = sample
        return sample * self._scale + self._shift

    def restart(self, _written: int = 0) -> None:
        """Begin anew with the objects' present values; the filter forgets."""
        self._filter.restart()
        self._filter.kind = self._filter_type.value
        self._filter.constant = max(self._filter_constant.value, 1)
        self._configure()

    def _configure(self, _written: float = 0.0) -> None:
        first_fv, first_pv, second_fv, second_pv = (point.value for point in self._points)
        slope, shift = 1.0, 0.0
        if first_fv != second_fv:
            slope = (second_pv - first_pv) / (second_fv - first_fv)
            shift = first_pv - first_fv * slope
        self._scale: float = slope * self._factor.value
        self._shift: float = (
            shift * self._factor.value + self._offset.value + self.input_offset.value
        )


def check_real32(value: float) -> None:
    """Refuse what is no number, or more than REAL32 holds.

    Raises:
        SdoAbort: 0609 0030.
    """
    if not abs(value) <= LARGEST_REAL32:
        raise SdoAbort(*abort_codes.VALUE)


def _check_factor(factor: float) -> None:
    if factor == 0.0:
        raise SdoAbort(*abort_codes.VALUE)


def _check_filter_type(kind: int) -> None:
    if kind not in set(FilterType):
        raise SdoAbort(*abort_codes.VALUE)


def _check_filter_constant(constant: int) -> None:
    if constant == 0:
        raise SdoAbort(*abort_codes.VALUE_TOO_LOW)
