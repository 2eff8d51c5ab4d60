"""A CiA 406 encoder with two measuring systems in one housing: channels 1 and 2.

Channel 1 is the whole encoder (`encoder_406`). Channel 2 measures the same motion by itself and
shows position 0x6020.02 and speed 0x6030.02, in the steps and the direction of channel 1, which
are one for the device. It has a preset 0x6010.02 and an offset 0x650C.02 of its own. A position
that its counter cannot hold is a position error of the device, as on channel 1.

Comparing the channels is the controller's part: no object of the profile does it.

Source: Temposonics E-Series operation manual (multi-sensor objects 6010h, 6020h, 6030h, one
sub-index a position). That a second system uses the second sub-index is this device's own reading.
"""

from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import INTEGER16, INTEGER32
from hil_bench.canopen_device.node import Node
from hil_bench.devices.bound_objects import optional, required, saturate
from hil_bench.devices.encoder_406 import EncoderDevice
from hil_bench.errors import SdoAbort

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
