"""An absolute multi-turn rotary encoder on the bus: profile CiA 406.

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
from hil_bench.canopen_device.datatypes import INTEGER32, UNSIGNED16, UNSIGNED32
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
