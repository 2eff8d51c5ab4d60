"""The demand value generator of a CiA 408 valve: from the set-point to what the spool is told.

In this order: limits 0x6320 and 0x6321, scaling 0x6322 and 0x6323, ramp 0x6330 to 0x6336,
directional gain 0x6340 and 0x6341, characteristic 0x6346, dead band compensation 0x6342 to 0x6345,
zero correction 0x6324.
By their defaults all of them but the limits are off.

The type of the characteristic but 0 is the maker's own, -1: the straight lines between the 257
points in the maker's objects 0x4348 (inputs -16384 to -128), 0x4349 (0) and 0x434A (128 to 16384).
A device without them knows type 0 only.

Source: Moog ACV CANopen manual B99224-DV018-D-211, section 7.2 (order, limits, scaling). The types
of the ramp are those of a firmware made after DS 408 V1.5.2 (Lambda Sistemi): 1 one time, 2 one
for speeding up and one for slowing down, 3 four times.
"""

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import Final, NamedTuple

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import INTEGER8, INTEGER16, UNSIGNED16, UNSIGNED32
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.devices.bound_objects import locate, optional, saturate
from hil_bench.devices.ramp import Ramp, RampTimes
from hil_bench.errors import EdsError, SdoAbort

# Compensation of cylinder and spool in the set-point of a CiA 408 valve.
#
# Source: Moog ACV CANopen manual B99224-DV018-D-211, sections 7.2.6 (directional gain), 7.2.7
# (characteristic) and 7.2.8 (dead band). Which side is A is not in the part of it that was at
# hand: here a positive set-point opens to A.

CURVE_POINTS: Final = 257
"""Points of a characteristic, from -16384 to 16384."""
_CURVE_STEP: Final = 128
_CURVE_START: Final = -16384


class DeadBandType(IntEnum):
    """Values of 0x6342."""

    OFF = 0
    JUMP = 1
    CONTINUOUS = 2


class DeadBand(NamedTuple):
    """Dead band compensation: the smallest openings are made larger.

    Attributes:
        kind: what happens below the threshold: nothing comes out, or a part of the step.
        side_a: step of a positive set-point [increments].
        side_b: step of a negative set-point, as a positive number [increments].
        threshold: set-point of the step [increments].
        reference: set-point that goes through unchanged, 100 % [increments].
    """

    kind: DeadBandType
    side_a: int
    side_b: int
    threshold: int
    reference: int

    def compensate(self, value: float) -> float:
        """Return the set-point `value` with the step added."""
        if value > 0.0:
            return self._stretch(value, self.side_a)
        return -self._stretch(-value, self.side_b) if value else 0.0

    def _stretch(self, size: float, step: int) -> float:
        if size >= self.reference:
            return size
        if size >= self.threshold:
            slope = (self.reference - step) / (self.reference - self.threshold)
            return step + (size - self.threshold) * slope
        return 0.0 if self.kind is DeadBandType.JUMP else size * step / self.threshold


def follow_curve(value: float, outputs: Sequence[int]) -> float:
    """Return a set-point bent by a characteristic, straight between its points.

    Args:
        value: the set-point [increments].
        outputs: what comes out at -16384, -16256, ..., 16384; the ends hold beyond them.
    """
    place = (value - _CURVE_START) / _CURVE_STEP
    if place <= 0.0:
        return outputs[0]
    if place >= CURVE_POINTS - 1:
        return outputs[-1]
    below = int(place)
    return outputs[below] + (place - below) * (outputs[below + 1] - outputs[below])


def apply_directional_gain(value: float, factor: float) -> float:
    """Return a set-point whose gain is reduced on one side.

    Args:
        value: the set-point [increments].
        factor: gain of the positive side by that of the negative side; the larger gain is 1.
    """
    if factor < 1.0:
        return value * factor if value > 0.0 else value
    return value if value > 0.0 else value / factor


_LOWEST: Final = -32768
_HIGHEST: Final = 32767
_UNITY: Final = 0x0001_0001
_MILLISECOND: Final = 1_000_000

_CURVE: Final = (0x4348, 0x4349, 0x434A)
_CURVE_BY_TABLE: Final = -1

_RAMP_TIMES: Final = range(0x6331, 0x6337)
_RAMP_TYPES: Final = {
    0: (),
    1: (0x6331, 0x6331, 0x6331, 0x6331),
    2: (0x6331, 0x6331, 0x6334, 0x6334),
    3: (0x6332, 0x6333, 0x6335, 0x6336),
}
"""By the type in 0x6330: which objects hold the times of the quadrants, in their order."""


class DemandGenerator:
    """The generator of one valve's demand value.

    Attributes:
        is_limited: whether a limit held the last set-point back.
        has_ramp: whether the ramp is on.
        ramp: the ramp; it runs while the demand value is on its way.
    """

    def __init__(self, object_dictionary: ObjectDictionary, reference: Variable) -> None:
        """Bind the profile's objects; EdsError where one is of a wrong kind.

        Args:
            object_dictionary: that of the valve.
            reference: the value that stands for 100 %.
        """
        self.is_limited = False
        self.ramp = Ramp()
        self._reference = reference
        self._scaled = 0.0
        self.has_ramp = False
        self._bind_limits(object_dictionary)
        self._bind_scaling(object_dictionary)
        self._bind_ramp(object_dictionary)
        self._bind_compensation(object_dictionary)
        self._bind_characteristic(object_dictionary)
        reference.add_hook(self._configure)
        self.restart()

    def _bind_limits(self, od: ObjectDictionary) -> None:
        self._upper_limit = optional(od, 0x6320, 1, INTEGER16, absent=_HIGHEST)
        self._lower_limit = optional(od, 0x6321, 1, INTEGER16, absent=_LOWEST)
        self._upper_limit.add_check(self._check_upper_limit)
        self._lower_limit.add_check(self._check_lower_limit)

    def _bind_scaling(self, od: ObjectDictionary) -> None:
        self._factor = self._bind_factor(od, 0x6322)
        self._offset = self._bind(od, 0x6323, 1)
        self._zero_correction = self._bind(od, 0x6324, 1)

    def _bind_ramp(self, od: ObjectDictionary) -> None:
        self._ramp_type = optional(od, 0x6330, 0, INTEGER8)
        self._check_type(od, self._ramp_type, range(len(_RAMP_TYPES)))
        self._ramp_times = {index: optional(od, index, 1, UNSIGNED16) for index in _RAMP_TIMES}
        for time in self._ramp_times.values():
            time.add_hook(self._configure)

    def _bind_compensation(self, od: ObjectDictionary) -> None:
        self._gain_type = optional(od, 0x6340, 0, INTEGER8)
        self._check_type(od, self._gain_type, range(2))
        self._gain_factor = self._bind_factor(od, 0x6341)
        self._dead_band_type = optional(od, 0x6342, 0, INTEGER8)
        self._check_type(od, self._dead_band_type, range(len(DeadBandType)))
        self._side_a, self._side_b = self._bind(od, 0x6343, 1), self._bind(od, 0x6344, 1)
        self._threshold = self._bind(od, 0x6345, 1)
        for size in (self._side_a, self._side_b, self._threshold):
            size.add_check(_check_size)

    def _bind_characteristic(self, od: ObjectDictionary) -> None:
        self._curve_type = optional(od, 0x6346, 0, INTEGER8)
        self._curve_points = _find_curve(od) if 0x6346 in od else ()
        lowest = _CURVE_BY_TABLE if self._curve_points else 0
        self._check_type(od, self._curve_type, range(lowest, 1))
        for point in self._curve_points:
            point.add_hook(self._configure)

    def _bind(self, od: ObjectDictionary, index: int, subindex: int) -> Variable:
        variable = optional(od, index, subindex, INTEGER16)
        variable.add_hook(self._configure)
        return variable

    def _bind_factor(self, od: ObjectDictionary, index: int) -> Variable:
        factor = optional(od, index, 0, UNSIGNED32, absent=_UNITY)
        if not factor.default >> 16 or not factor.default & 0xFFFF:
            raise EdsError(
                f"{locate(od, factor)} is 0x{factor.default:08X}; numerator (upper half) and "
                "denominator are more than 0, as in 0x00010001"
            )
        factor.add_check(_check_factor)
        factor.add_hook(self._configure)
        return factor

    def _check_type(self, od: ObjectDictionary, variable: Variable, types: range) -> None:
        """Let `variable` hold one of `types`.

        Raises:
            EdsError: its default is another one.
        """
        if variable.default not in types:
            raise EdsError(
                f"{locate(od, variable)} is {variable.default}; {types[0]} to {types[-1]} exist"
            )

        def check(value: int) -> None:
            if value not in types:
                raise SdoAbort(*abort_codes.VALUE)

        variable.add_check(check)
        variable.add_hook(self._configure)

    def generate(self, setpoint: int, now: int) -> int:
        """Return the demand value of a set-point at `now` [ns]; all [increments]."""
        limited = setpoint
        if not self._lower_limit.value <= setpoint <= self._upper_limit.value:
            limited = min(max(setpoint, self._lower_limit.value), self._upper_limit.value)
        self.is_limited = limited != setpoint
        if self._is_plain:
            self._scaled = float(limited)
            return limited
        return self._shape(limited, now)

    def restart(self) -> None:
        """Begin anew with the objects' present values, at 0."""
        self._scaled = 0.0
        self.ramp.restart(0.0)
        self._configure()

    def shift_ramp(self, offset: float) -> None:
        """Have the ramp go on from elsewhere [increments]."""
        self._scaled += offset
        self.ramp.restart(self._scaled)

    def _shape(self, limited: int, now: int) -> int:
        value = limited * self._scale + self._offset.value
        if self.has_ramp:
            value = self.ramp.follow(value, now)
        self._scaled = value
        if self._gain_type.value:
            value = apply_directional_gain(value, self._gain)
        if self._curve:
            value = follow_curve(value, self._curve)
        if self._dead_band is not None:
            value = self._dead_band.compensate(value)
        return saturate(value + self._zero_correction.value, _LOWEST, _HIGHEST, unknown=0)

    def _configure(self, _written: int = 0) -> None:
        self._scale = _quotient(self._factor)
        self._gain = _quotient(self._gain_factor)
        self._dead_band = self._present_dead_band()
        is_bent = self._curve_type.value == _CURVE_BY_TABLE
        self._curve = tuple(point.value for point in self._curve_points) if is_bent else ()
        self._configure_ramp()
        self._is_plain = not (
            self.has_ramp
            or self._gain_type.value
            or self._dead_band
            or self._curve
            or self._scale != 1.0
            or self._offset.value
            or self._zero_correction.value
        )

    def _present_dead_band(self) -> DeadBand | None:
        kind = self._dead_band_type.value
        if kind not in {DeadBandType.JUMP, DeadBandType.CONTINUOUS}:
            return None
        sizes = (self._side_a, self._side_b, self._threshold, self._reference)
        return DeadBand(DeadBandType(kind), *(size.value for size in sizes))

    def _configure_ramp(self) -> None:
        milliseconds = [
            self._ramp_times[index].value for index in _RAMP_TYPES.get(self._ramp_type.value, ())
        ]
        unit = _MILLISECOND / self._reference.value
        self.ramp.times = RampTimes(*(time * unit for time in milliseconds))
        had_ramp, self.has_ramp = self.has_ramp, self._ramp_type.value != 0
        if self.has_ramp != had_ramp:
            self.ramp.restart(self._scaled)

    def _check_upper_limit(self, limit: int) -> None:
        if limit < self._lower_limit.value:
            raise SdoAbort(*abort_codes.VALUE_TOO_LOW)

    def _check_lower_limit(self, limit: int) -> None:
        if limit > self._upper_limit.value:
            raise SdoAbort(*abort_codes.VALUE_TOO_HIGH)


def _find_curve(od: ObjectDictionary) -> tuple[Variable, ...]:
    """The points of a characteristic; none where the maker's objects are something else."""
    points = tuple(variable for variable in od if variable.index in _CURVE and variable.subindex)
    is_curve = len(points) == CURVE_POINTS and all(point.data_type is INTEGER16 for point in points)
    return points if is_curve else ()


def _quotient(factor: Variable) -> float:
    numerator, denominator = divmod(factor.value, 0x10000)
    return float(numerator / denominator) if denominator else 1.0


def _check_factor(factor: int) -> None:
    if not factor >> 16 or not factor & 0xFFFF:
        raise SdoAbort(*abort_codes.VALUE)


def _check_size(size: int) -> None:
    if size < 0:
        raise SdoAbort(*abort_codes.VALUE_TOO_LOW)


# The dither of a CiA 408 valve: 0x6360 to 0x6362.
#
# While it is on (0x6360 = 1) and the valve is ACTIVE, a sine of the amplitude 0x6361.01
# [increments] and the frequency 0x6362.01 [Hz] is added to what the spool is told; the demand
# value 0x6310.01 stays without it. It is sampled once a tick, so a frequency above half of the
# ticks a second shows as a lower one.
#
# Source: Moog ACV CANopen manual B99224-DV018-D-211 (objects and unit). Type and shape are this
# device's own.

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
