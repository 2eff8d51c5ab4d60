"""An absolute linear encoder on the bus: profile CiA 406.

The position 0x6004, the same as 0x6020.01, counts steps of 0x6005.01 x 0.001 μm; the speed
0x6030.01 counts steps of 0x6005.02 x 0.01 mm/s, the acceleration 0x6040.01 steps of 0x6005.03 x
1 mm/s². Bit 3 of the operating parameters 0x6000 reverses all. A write to the steps or to the
direction changes the next published values.

A preset, written to 0x6003 or 0x6010.01, makes the present position that value: it sets the offset
0x6509, which is added to what is measured. Without one, 0 is the plant's 0. The present position is
the last published one.

A position that the counter cannot hold is a position error: bit 0 of the alarms 0x6503, an EMCY,
and the counter stands at its nearest end (at its last value where the position is no number). A
speed beyond the counter stands at its end and sets bit 0 of the warnings 0x6505.

The cyclic timer 0x6200 and the event timer 0x1800.05 are one value. Cams and work area:
`CamSwitches`, `WorkArea`; total measuring range and identification: `MeasuringRange`.

Sources: Temposonics E-Series and HYDAC HLT 1100 operation manuals (objects and units),
TR-Electronic LA-46 manual (error register of a position error) and CM-36 manual (preset, its abort
code), BEI MHK5 manual (offset), Kübler CANlift manual (meaning of warning bit 0).
"""

import math
from typing import ClassVar, Final, NamedTuple

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.agenda import NEVER
from hil_bench.canopen_device.datatypes import (
    INTEGER16,
    INTEGER32,
    UNSIGNED8,
    UNSIGNED16,
    UNSIGNED32,
)
from hil_bench.canopen_device.emcy import DEVICE_PROFILE
from hil_bench.canopen_device.events import NodeEventKind
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.devices.bound_objects import locate, nearest, optional, required, saturate
from hil_bench.errors import EdsError, SdoAbort

# Switches of a CiA 406 encoder: cam switches 0x6300 to 0x6337, area state 0x6400.
#
# Cam n + 1 of the one channel is bit n of the state 0x6300.01. It is active while the position is
# between its limits, both included; once active, it stays so until the position is further outside
# than its hysteresis. A cam that is not enabled is not active. The polarity turns a bit round,
# whether its cam is enabled or not.
#
# Sources: BEI MHK5 manual (objects, area state), Turck BL20 manual, object 6B00h (limits, polarity
# of a cam that is not enabled). The sense of the hysteresis is this device's own.


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


# The measuring range of a CiA 406 encoder, and its type: 0x6002, 0x650A and 0x650B.
#
# The total measuring range 0x6002 and the lowest and highest position 0x650A.02 and 0x650A.03
# count measuring steps; no preset shifts them. 0x650B is the serial number of 0x1018.04.
#
# Sources: Temposonics E-Series and TR-Electronic LA-46 manuals (objects), BEI MHK5 manual (serial
# number). Makers give 0x6002 as rw and say that the scaling is fixed; so where an EDS file lets
# the bus write it, it takes the range that it has and no other.

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


POSITION_UNITS: Final = 1e9
"""Units of 0x6005.01, 0.001 μm, in one metre."""
SPEED_UNITS: Final = 1e5
"""Units of 0x6005.02, 0.01 mm/s, in one metre a second."""
ACCELERATION_UNITS: Final = 1e3
"""Units of 0x6005.03, 1 mm/s², in one metre a second squared."""

REVERSED_BIT: Final = 1 << 3
"""Measuring direction, in 0x6000 and 0x6500."""

POSITION_ERROR: Final = 1 << 0
"""Bit of the alarms 0x6503 and 0x6504."""
OVERSPEED: Final = 1 << 0
"""Bit of the warnings 0x6505 and 0x6506."""

CHANNEL: Final = 1
"""Of a device that has one: the source of its errors."""

POSITION_EMCY: Final = 0x1000


class EncoderDevice:
    """The encoder behind one node.

    Attributes:
        node: the node that carries it on the bus.
    """

    PARAMETER_BITS: ClassVar[int] = REVERSED_BIT
    """Those of 0x6000 that may be set."""

    def __init__(self, node: Node, span: tuple[float, float] = (0.0, 0.0)) -> None:
        """Bind the profile's objects; EdsError where one is missing or of a wrong kind.

        Args:
            node: the node; its object dictionary comes from the encoder's EDS file.
            span: positions at the ends of the measuring range [m]; by default it tells of none.
        """
        self.node = node
        self._span = span
        self._last_position: float = 0.0
        self._last_speed: float = 0.0
        self._then = NEVER
        self._position_errors: set[int] = set()
        self._bind_position()
        self._bind_speed()
        self._bind_preset()
        self._bind_diagnostics()
        self._bind_timer()
        self._bind_scale()
        self._cams = CamSwitches(node.object_dictionary)
        self._work_area = WorkArea(node.object_dictionary)
        self._restart()

    def _bind_position(self) -> None:
        od = self.node.object_dictionary
        self._positions = tuple(
            required(od, index, subindex, INTEGER32, UNSIGNED32)
            for index, subindex in ((0x6004, 0), (0x6020, 1))
            if od.find(index, subindex) is not None
        )
        if not self._positions:
            raise EdsError(
                f"{od.source}: objects 0x6004.00 and 0x6020.01 are missing; "
                "the device profile needs one of them"
            )
        self._lowest = max(int(position.data_type.low or 0) for position in self._positions)
        self._highest = min(int(position.data_type.high or 0) for position in self._positions)

    def _bind_speed(self) -> None:
        od = self.node.object_dictionary
        self._speed = optional(od, 0x6030, 1, INTEGER16)
        self._acceleration = optional(od, 0x6040, 1, INTEGER16)

    def _bind_scale(self) -> None:
        od = self.node.object_dictionary
        self._position_step = required(od, 0x6005, 1, UNSIGNED32)
        self._speed_step = optional(od, 0x6005, 2, UNSIGNED32, absent=1)
        self._acceleration_step = optional(od, 0x6005, 3, UNSIGNED32, absent=1)
        for step in (self._position_step, self._speed_step, self._acceleration_step):
            self._bind_step(step)
        self._range = MeasuringRange(od, self._span)

    def _bind_preset(self) -> None:
        od = self.node.object_dictionary
        self._presets = (
            optional(od, 0x6003, 0, INTEGER32, UNSIGNED32),
            optional(od, 0x6010, 1, INTEGER32, UNSIGNED32),
        )
        self._offsets = (
            optional(od, 0x6509, 0, INTEGER32),
            optional(od, 0x650C, 1, INTEGER32),
        )
        for preset in self._presets:
            preset.add_check(self._check_preset)
            preset.add_hook(self._preset)

    def _bind_step(self, step: Variable) -> None:
        if step.default == 0:
            place = locate(self.node.object_dictionary, step)
            raise EdsError(f"{place} is 0; a measuring step is more than 0")
        step.add_check(_check_step)
        step.add_hook(self._scale)

    def _bind_diagnostics(self) -> None:
        od = self.node.object_dictionary
        self._parameters = optional(od, 0x6000, 0, UNSIGNED16)
        self._parameters.add_check(self._check_parameters)
        self._parameters.add_hook(self._scale)
        self._operating_status = optional(od, 0x6500, 0, UNSIGNED16)
        self._measuring_step = optional(od, 0x6501, 0, UNSIGNED32)
        self._alarms = optional(od, 0x6503, 0, UNSIGNED16)
        self._supported_alarms = optional(od, 0x6504, 0, UNSIGNED16)
        self._warnings = optional(od, 0x6505, 0, UNSIGNED16)
        self._supported_warnings = optional(od, 0x6506, 0, UNSIGNED16)

    def _bind_timer(self) -> None:
        od = self.node.object_dictionary
        self._cyclic_timer = optional(od, 0x6200, 0, UNSIGNED16)
        self._event_timer = optional(od, 0x1800, 5, UNSIGNED16)
        # As a check, so that what the TPDO refuses is refused here too.
        self._cyclic_timer.add_check(self._event_timer.write)
        self._event_timer.add_hook(self._show_event_timer)

    def publish(self, position: float, speed: float, now: int) -> None:
        """Put position, speed and acceleration into the object dictionary.

        Args:
            position: position of the piston [m]; NaN where there is none, a position error.
            speed: speed of the piston [m/s]; NaN where there is none: the last one stays.
            now: bench time [ns].
        """
        if self.node.events:
            self._hear_events()
        self._publish_position(position)
        self._publish_speed(speed * self._speed_counts)
        self._publish_acceleration(speed, now)

    def _publish_position(self, position: float) -> None:
        measured = position * self._position_counts
        steps = measured + self._offset
        if self._lowest <= steps <= self._highest:
            self._last_position = position
            self._show_position(nearest(measured) + self._offset)
            is_error = False
        else:
            last = self._positions[0].value
            self._show_position(saturate(steps, self._lowest, self._highest, unknown=last))
            is_error = True
        if is_error or self._position_errors:
            self._tell_position_error(CHANNEL, is_present=is_error)
        shown: int = self._positions[0].value
        self._cams.switch(shown)
        self._work_area.show(shown, is_out_of_range=is_error)

    def _publish_speed(self, steps: float) -> None:
        if math.isnan(steps):
            return
        if -32768 <= steps <= 32767:
            self._speed.value = nearest(steps)
            self._warnings.value = 0
        else:
            self._speed.value = saturate(steps, -32768, 32767, unknown=self._speed.value)
            self._warnings.value = OVERSPEED

    def _publish_acceleration(self, speed: float, now: int) -> None:
        """Show the mean acceleration since the last tick; 0 in the first one."""
        elapsed = now - self._then
        if elapsed > 0:
            steps = (speed - self._last_speed) * 1e9 / elapsed * self._acceleration_counts
            shown: int = self._acceleration.value
            self._acceleration.value = saturate(steps, -32768, 32767, unknown=shown)
        self._last_speed, self._then = speed, now

    def _show_position(self, steps: int) -> None:
        for position in self._positions:
            position.value = steps

    def _tell_position_error(self, channel: int, *, is_present: bool) -> None:
        """Raise or take back the alarm of a channel; the device has one as long as any has."""
        if is_present is (channel in self._position_errors):
            return
        if is_present:
            self._position_errors.add(channel)
            self.node.emcy.raise_error(POSITION_EMCY, DEVICE_PROFILE, source=channel)
        else:
            self._position_errors.discard(channel)
            self.node.emcy.clear_error(POSITION_EMCY, channel)
        self._alarms.value = POSITION_ERROR if self._position_errors else 0

    def _hear_events(self) -> None:
        while self.node.events:
            kind, _ = self.node.events.popleft()
            if kind is NodeEventKind.RESET_NODE:
                self._restart()
            elif kind is NodeEventKind.RESET_COMMUNICATION:
                self._show_event_timer(self._event_timer.value)

    def _check_parameters(self, parameters: int) -> None:
        """Refuse bits of the operating parameters that mean nothing.

        Raises:
            SdoAbort: 0609 0030.
        """
        if parameters & ~self.PARAMETER_BITS:
            raise SdoAbort(*abort_codes.VALUE)

    def _check_preset(self, position: int) -> None:
        """Refuse a position that the counter or the offset cannot hold.

        Raises:
            SdoAbort: 0609 0030.
        """
        offset = position - self._measured()
        if not (self._lowest <= position <= self._highest and -(1 << 31) <= offset < 1 << 31):
            raise SdoAbort(*abort_codes.VALUE)

    def _preset(self, position: int) -> None:
        for preset in self._presets:
            preset.value = position
        self._set_offset(position - self._measured())
        self._show_position(position)

    def _measured(self) -> int:
        """The last position without offset [steps], in the present steps and direction."""
        return round(self._last_position * self._position_counts)

    def _set_offset(self, steps: int) -> None:
        self._offset = steps
        for offset in self._offsets:
            offset.value = steps

    def _restart(self) -> None:
        self._then = NEVER
        self._set_offset(0)
        self._cams.restart()
        self._supported_alarms.value = POSITION_ERROR
        self._supported_warnings.value = OVERSPEED
        self._show_event_timer(self._event_timer.value)
        self._scale()

    def _show_event_timer(self, milliseconds: int) -> None:
        self._cyclic_timer.value = milliseconds

    def _scale(self, _written: int = 0) -> None:
        direction: float = -1.0 if self._parameters.value & REVERSED_BIT else 1.0
        self._position_counts: float = direction * POSITION_UNITS / self._position_step.value
        self._speed_counts = direction * SPEED_UNITS / self._speed_step.value
        step = self._acceleration_step.value
        self._acceleration_counts = direction * ACCELERATION_UNITS / step
        self._operating_status.value = self._parameters.value & REVERSED_BIT
        self._measuring_step.value = self._position_step.value
        self._range.show(self._position_counts)


def _check_step(step: int) -> None:
    if step == 0:
        raise SdoAbort(*abort_codes.VALUE_TOO_LOW)
