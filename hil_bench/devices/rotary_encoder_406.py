"""Encoders of CiA 406 beyond the linear one: rotary, and with two measuring systems.

The position 0x6004 counts steps of which one revolution has 0x6001, and begins again at 0 after
0x6002 steps, so that it goes round both ways. Both hold while bit 2 of the operating parameters
0x6000 (scaling) is set; without it they are what the encoder is made for, 0x6501 steps a revolution
over 0x6502 revolutions. Bit 0 of 0x6000 reverses the direction.

The speed 0x6030.01 is steps a second times 0x6031.03 / 0x6031.04: at power-on, rpm.
A speed beyond the counter stands at its end and sets bit 0 of the warnings 0x6505.

A preset, written to 0x6003, makes the present position that value by the offset 0x6509. An angle
that is no number is a position error, as of a linear encoder; so are cams, work area and timer.

Sources: Pepperl+Fuchs and BEI THK4 manuals (0x6000 to 0x6004, 0x6030), ifm RM9000 manual (scaling
bit, code sequence, speed at its end), Pepperl+Fuchs ENA58IL manual (limits of 0x6001 and 0x6002).
"""

import math
from typing import ClassVar, Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import INTEGER16, INTEGER32, UNSIGNED16, UNSIGNED32
from hil_bench.canopen_device.node import Node
from hil_bench.devices.bound_objects import optional, required, saturate
from hil_bench.devices.encoder_406 import CHANNEL, EncoderDevice
from hil_bench.errors import SdoAbort

CODE_SEQUENCE_BIT: Final = 1 << 0
"""Of 0x6000: the position falls as the shaft turns positively."""
SCALING_BIT: Final = 1 << 2
"""Of 0x6000: 0x6001 and 0x6002 hold."""

_TURN: Final = 2.0 * math.pi


class RotaryEncoderDevice(EncoderDevice):
    """The encoder behind one node: `publish` takes an angle [rad] and a speed [rad/s]."""

    PARAMETER_BITS: ClassVar[int] = CODE_SEQUENCE_BIT | SCALING_BIT

    def _bind_scale(self) -> None:
        od = self.node.object_dictionary
        self._resolution = required(od, 0x6501, 0, UNSIGNED32)
        self._revolutions = optional(od, 0x6502, 0, UNSIGNED16, absent=1)
        self._per_turn = optional(od, 0x6001, 0, UNSIGNED32, absent=self._resolution.default)
        self._range_steps = optional(od, 0x6002, 0, UNSIGNED32, absent=self._most())
        self._multiplier = optional(od, 0x6031, 3, UNSIGNED16, absent=60)
        self._divider = optional(od, 0x6031, 4, UNSIGNED32, absent=self._resolution.default)
        self._ends = tuple(optional(od, 0x650A, sub, INTEGER32, UNSIGNED32) for sub in (2, 3))
        self._per_turn.add_check(lambda steps: _check_within(steps, self._resolution.value))
        self._range_steps.add_check(lambda steps: _check_within(steps, self._most()))
        self._divider.add_check(lambda steps: _check_within(steps, 0xFFFFFFFF))
        for variable in (self._per_turn, self._range_steps, self._multiplier, self._divider):
            variable.add_hook(self._scale)

    def _most(self) -> int:
        """Return the steps that the encoder is made for, over all its revolutions."""
        return int(self._resolution.value * self._revolutions.value)

    def _publish_position(self, position: float) -> None:
        if not math.isfinite(position):
            super()._publish_position(math.nan)
            return
        self._last_position = position
        self._show_position((self._measured() + self._offset) % self._total)
        self._tell_position_error(CHANNEL, is_present=False)
        shown = self._positions[0].value
        self._cams.switch(shown)
        self._work_area.show(shown, is_out_of_range=False)

    def _check_preset(self, position: int) -> None:
        """Refuse a position beyond the range.

        Raises:
            SdoAbort: 0609 0030.
        """
        if not 0 <= position < self._total:
            raise SdoAbort(*abort_codes.VALUE)

    def _set_offset(self, steps: int) -> None:
        """Set the offset, which counts round as the position does; it is at most half a range."""
        total, half = self._total, self._total // 2
        super()._set_offset((steps + half) % total - half)

    def _restart(self) -> None:
        self._scale_range()
        super()._restart()

    def _scale_range(self) -> None:
        is_scaled = bool(self._parameters.value & SCALING_BIT)
        self._total = int(self._range_steps.value) if is_scaled else self._most()
        self._steps = int(self._per_turn.value if is_scaled else self._resolution.value)

    def _scale(self, _written: int = 0) -> None:
        self._scale_range()
        is_reversed = self._parameters.value & CODE_SEQUENCE_BIT
        direction = -1.0 if is_reversed else 1.0
        self._position_counts = direction * self._steps / _TURN
        self._speed_counts = self._position_counts * self._multiplier.value / self._divider.value
        self._acceleration_counts = 0.0
        self._operating_status.value = self._parameters.value
        for variable, end in zip(self._ends, (0, self._total - 1), strict=True):
            low, high = int(variable.data_type.low or 0), int(variable.data_type.high or 0)
            variable.value = saturate(end, low, high, unknown=0)


def _check_within(steps: int, most: int) -> None:
    if steps < 1:
        raise SdoAbort(*abort_codes.VALUE_TOO_LOW)
    if steps > most:
        raise SdoAbort(*abort_codes.VALUE_TOO_HIGH)


# A CiA 406 encoder with two measuring systems in one housing: channels 1 and 2.
#
# Channel 1 is the whole encoder (`encoder_406`). Channel 2 measures the same motion by itself
# and shows position 0x6020.02 and speed 0x6030.02, in the steps and the direction of channel 1,
# which are one for the device. It has a preset 0x6010.02 and an offset 0x650C.02 of its own. A
# position that its counter cannot hold is a position error of the device, as on channel 1.
#
# Comparing the channels is the controller's part: no object of the profile does it.
#
# Source: Temposonics E-Series operation manual (multi-sensor objects 6010h, 6020h, 6030h, one
# sub-index a position). That a second system uses the second sub-index is this device's own
# reading.


_LOWEST: Final = -(1 << 31)
_HIGHEST: Final = (1 << 31) - 1
_CHANNEL: Final = 2


class RedundantEncoder(EncoderDevice):
    """The encoder behind one node, both channels."""

    def __init__(self, node: Node, span: tuple[float, float] = (0.0, 0.0)) -> None:
        """Bind the profile's objects; EdsError where one is missing or of a wrong kind.

        Args:
            node: the node; its object dictionary comes from the encoder's EDS file.
            span: positions at the ends of the measuring range [m].
        """
        od = node.object_dictionary
        self._second_position = required(od, 0x6020, _CHANNEL, INTEGER32)
        self._second_speed = optional(od, 0x6030, _CHANNEL, INTEGER16)
        self._second_preset = optional(od, 0x6010, _CHANNEL, INTEGER32)
        self._second_offset = optional(od, 0x650C, _CHANNEL, INTEGER32)
        self._second_preset.add_check(self._check_second_preset)
        self._second_preset.add_hook(self._preset_second)
        self._second_measured = 0.0
        super().__init__(node, span)

    def publish_second(self, position: float, speed: float, now: int) -> None:  # noqa: ARG002
        """Put what channel 2 measures into the object dictionary.

        Args:
            position: of the piston [m]; NaN where there is none, a position error.
            speed: of the piston [m/s]; NaN where there is none: the last one stays.
            now: bench time [ns].
        """
        steps = position * self._position_counts + self._second_offset.value
        if is_measured := _LOWEST <= steps <= _HIGHEST:
            self._second_measured = position
        shown = self._second_position
        shown.value = saturate(steps, _LOWEST, _HIGHEST, unknown=shown.value)
        self._tell_position_error(_CHANNEL, is_present=not is_measured)
        counts = speed * self._speed_counts
        unknown = self._second_speed.value
        self._second_speed.value = saturate(counts, -32768, 32767, unknown=unknown)

    def _steps_of_second(self) -> int:
        """The last position of channel 2 without offset, in the present steps and direction."""
        return round(self._second_measured * self._position_counts)

    def _check_second_preset(self, position: int) -> None:
        """Refuse a position whose offset does not fit.

        Raises:
            SdoAbort: 0609 0030.
        """
        if not _LOWEST <= position - self._steps_of_second() <= _HIGHEST:
            raise SdoAbort(*abort_codes.VALUE)

    def _preset_second(self, position: int) -> None:
        self._second_offset.value = position - self._steps_of_second()
        self._second_position.value = position

    def _restart(self) -> None:
        self._second_offset.value = 0
        super()._restart()
