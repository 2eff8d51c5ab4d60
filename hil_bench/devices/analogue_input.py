"""The channel of a CiA 404 sensor: process value, its sending, its integer sets."""

import math
from collections.abc import Sequence
from enum import IntEnum
from functools import partial
from typing import Any, Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import (
    INTEGER16,
    INTEGER24,
    INTEGER32,
    REAL32,
    UNSIGNED8,
    DataType,
)
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.devices.bound_objects import TpdoTrigger, nearest, optional, required
from hil_bench.errors import SdoAbort

# From what a CiA 404 sensor measures, the field value, to what it tells, the process value.
#
# In this order: filter 0x61A0 and 0x61A1 (its result is the field value 0x6100.01), the line
# through the points (0x6120.01, 0x6121.01) and (0x6122.01, 0x6123.01), factor 0x6126.01 and
# offset 0x6127.01, input offset 0x6124.01. By their defaults all of them are off. The line is off
# while its two field values are equal, as they are by default.
#
# Source: Axiomatic AX030301 manual, objects 61A0h and 61A1h (filters). What one sample is there,
# 10 ms, is one tick here. CiA 404 has factor and offset as another form of the same line; here
# both count.

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


# When a CiA 404 sensor sends its process value by itself: 0x6133.01 to 0x6135.01.
#
# Each is an event for the TPDOs that carry the value (types 254 and 255). The delta: the value
# has changed by more than 0x6133.01 since the last event, or since the delta was set; a negative
# delta means by anything, 0 is off. The limits: the value has gone below 0x6134.01, or above
# 0x6135.01; they are off while the upper one is not above the lower one, as by default.
#
# Source: esd CAN-CBX-Pt100 manual C.3032.21, objects 9133h and 9134h. That a limit counts once,
# when it is passed, and how the limits are switched off, is this device's own.


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


# The integer sets of a CiA 404 channel: REAL32 objects once more as scaled integers.
#
# The first digit of an index tells the format: 0x6xxx REAL32, 0x7xxx INTEGER16, 0x8xxx INTEGER24,
# 0x9xxx INTEGER32. The integers are the REAL32 value times 10^(0x6132). What is too large for a
# format shows as its lowest value there; so does a value that is none.
#
# A parameter (scaling points, input offset, interrupt delta and limits, span) is one value in all
# formats: what is written to one is shown by the others, and what one refuses they all refuse.
#
# Source: HYDAC VFL protocol description (objects 71xxh and 91xxh beside 61xxh). Of the INTEGER24
# set this device has the process value alone.

FORMATS: Final[tuple[tuple[int, DataType], ...]] = (
    (0x1000, INTEGER16),
    (0x2000, INTEGER24),
    (0x3000, INTEGER32),
)
"""How far each set is above the REAL32 objects, and its data type."""

_PARAMETERS: Final = (*range(0x6120, 0x6125), *range(0x6133, 0x6136), 0x6148, 0x6149)


class _Face:
    """A value in one format."""

    __slots__ = ("highest", "lowest", "variable")

    def __init__(self, variable: Variable) -> None:
        self.variable = variable
        self.lowest = int(variable.data_type.low or 0)
        self.highest = int(variable.data_type.high or 0)


class IntegerFaces:
    """One value in the integer formats that the device has of it."""

    def __init__(self, od: ObjectDictionary, index: int, channel: int) -> None:
        """Bind the objects; EdsError where one is of a wrong kind.

        Args:
            od: that of the sensor.
            index: of the REAL32 object.
            channel: sub-index.
        """
        self.variables = tuple(
            required(od, index + above, channel, data_type)
            for above, data_type in FORMATS
            if od.find(index + above, channel) is not None
        )
        self._faces = tuple(_Face(variable) for variable in self.variables)

    def show(self, value: float, decimals: int) -> None:
        """Show a finite value; `decimals` is a power of ten."""
        scaled = nearest(value * decimals)
        shown: Any = scaled  # made an object once for all formats
        for face in self._faces:
            if face.lowest <= scaled <= face.highest:
                face.variable.value = shown
            else:
                face.variable.value = face.lowest

    def show_none(self) -> None:
        """Show that there is no value."""
        for face in self._faces:
            face.variable.value = face.lowest


class IntegerParameters:
    """The parameters of one channel in the integer formats.

    Args:
        od: object dictionary of the sensor.
        channel: sub-index.
        digits: 0x6132 of the channel.
    """

    def __init__(self, od: ObjectDictionary, channel: int, digits: Variable) -> None:
        self._digits = digits
        self._faces: list[tuple[Variable, IntegerFaces]] = []
        for index in _PARAMETERS:
            real = od.find(index, channel)
            faces = IntegerFaces(od, index, channel)
            if real is not None and faces.variables:
                self._join(real, faces)
        digits.add_hook(self.show)

    def _join(self, real: Variable, faces: IntegerFaces) -> None:
        self._faces.append((real, faces))
        for face in faces.variables:
            # As a check, so that what the REAL32 object refuses is refused here too.
            face.add_check(partial(self._write, real))
        real.add_hook(partial(self._show, faces))

    def show(self, _written: float = 0.0) -> None:
        """Show what the REAL32 objects hold at present."""
        for real, faces in self._faces:
            self._show(faces, real.value)

    def _show(self, faces: IntegerFaces, value: float) -> None:
        faces.show(value, 10**self._digits.value)

    def _write(self, real: Variable, scaled: int) -> None:
        real.write(scaled / 10**self._digits.value)


def mapped_values(channel: int) -> Sequence[tuple[int, int]]:
    """Return the objects by which a TPDO may carry the process value of a channel."""
    indices = (0x6130, *(0x6130 + above for above, _ in FORMATS), 0x6140)
    return [(index, channel) for index in indices]
