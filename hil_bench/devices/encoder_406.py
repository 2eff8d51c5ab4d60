"""An absolute linear encoder on the bus: profile CiA 406.

The position 0x6004, the same as 0x6020.01, counts steps of 0x6005.01 x 0.001 μm; the speed
0x6030.01 counts steps of 0x6005.02 x 0.01 mm/s. Bit 3 of the operating parameters 0x6000 reverses
both. A write to the steps or to the direction changes the next published values; there is no
preset, so 0 is the plant's 0.

A position that the counter cannot hold is a position error: bit 0 of the alarms 0x6503, an EMCY,
and the counter stands at its nearest end (at its last value where the position is no number). A
speed beyond the counter stands at its end and sets bit 0 of the warnings 0x6505.

The cyclic timer 0x6200 and the event timer 0x1800.05 are one value.

Sources: Temposonics E-Series and HYDAC HLT 1100 operation manuals (objects and units),
TR-Electronic LA-46 manual (error register of a position error), Kübler CANlift manual (meaning of
warning bit 0).
"""

from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import INTEGER16, INTEGER32, UNSIGNED16, UNSIGNED32
from hil_bench.canopen_device.events import NodeEventKind
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import Variable
from hil_bench.devices.profile_objects import locate, optional, required
from hil_bench.devices.saturation import saturate
from hil_bench.errors import EdsError, SdoAbort

POSITION_UNITS: Final = 1e9
"""Units of 0x6005.01, 0.001 μm, in one metre."""
SPEED_UNITS: Final = 1e5
"""Units of 0x6005.02, 0.01 mm/s, in one metre a second."""

REVERSED_BIT: Final = 1 << 3
"""Measuring direction, in 0x6000 and 0x6500."""

POSITION_ERROR: Final = 1 << 0
"""Bit of the alarms 0x6503 and 0x6504."""
OVERSPEED: Final = 1 << 0
"""Bit of the warnings 0x6505 and 0x6506."""

POSITION_EMCY: Final = 0x1000
DEVICE_PROFILE_ERROR: Final = 0x20
"""Bit of the error register that a position error sets."""


class EncoderDevice:
    """The encoder behind one node.

    Attributes:
        node: the node that carries it on the bus.
    """

    def __init__(self, node: Node) -> None:
        """Bind the profile's objects; EdsError where one is missing or of a wrong kind.

        Args:
            node: the node; its object dictionary comes from the encoder's EDS file.
        """
        self.node = node
        self._bind_position()
        self._bind_speed()
        self._bind_diagnostics()
        self._bind_timer()
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
        self._position_step = required(od, 0x6005, 1, UNSIGNED32)
        self._bind_step(self._position_step)

    def _bind_speed(self) -> None:
        od = self.node.object_dictionary
        self._speed = optional(od, 0x6030, 1, INTEGER16)
        self._speed_step = optional(od, 0x6005, 2, UNSIGNED32, absent=1)
        self._bind_step(self._speed_step)

    def _bind_step(self, step: Variable) -> None:
        if step.default == 0:
            place = locate(self.node.object_dictionary, step)
            raise EdsError(f"{place} is 0; a measuring step is more than 0")
        step.add_check(_check_step)
        step.add_hook(self._scale)

    def _bind_diagnostics(self) -> None:
        od = self.node.object_dictionary
        self._parameters = optional(od, 0x6000, 0, UNSIGNED16)
        self._parameters.add_check(_check_parameters)
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

    def publish(self, position: float, speed: float, now: int) -> None:  # noqa: ARG002 - no delay
        """Put position and speed into the object dictionary.

        Args:
            position: position of the piston [m].
            speed: speed of the piston [m/s].
            now: bench time [ns].
        """
        if self.node.events:
            self._hear_events()
        steps = position * self._position_counts
        if self._lowest <= steps <= self._highest:
            self._show_position(round(steps))
            if self._alarms.value:
                self._end_position_error()
        else:
            self._show_position_error(steps)
        steps = speed * self._speed_counts
        if -32768 <= steps <= 32767:
            self._speed.value = round(steps)
            self._warnings.value = 0
        else:
            self._speed.value = saturate(steps, -32768, 32767, unknown=self._speed.value)
            self._warnings.value = OVERSPEED

    def _show_position(self, steps: int) -> None:
        for position in self._positions:
            position.value = steps

    def _show_position_error(self, steps: float) -> None:
        last = self._positions[0].value
        self._show_position(saturate(steps, self._lowest, self._highest, unknown=last))
        if not self._alarms.value:
            self._alarms.value = POSITION_ERROR
            self.node.emcy.raise_error(POSITION_EMCY, DEVICE_PROFILE_ERROR)

    def _end_position_error(self) -> None:
        self._alarms.value = 0
        self.node.emcy.clear_error(POSITION_EMCY)

    def _hear_events(self) -> None:
        while self.node.events:
            kind, _ = self.node.events.popleft()
            if kind is NodeEventKind.RESET_NODE:
                self._restart()
            elif kind is NodeEventKind.RESET_COMMUNICATION:
                self._show_event_timer(self._event_timer.value)

    def _restart(self) -> None:
        self._supported_alarms.value = POSITION_ERROR
        self._supported_warnings.value = OVERSPEED
        self._show_event_timer(self._event_timer.value)
        self._scale()

    def _show_event_timer(self, milliseconds: int) -> None:
        self._cyclic_timer.value = milliseconds

    def _scale(self, _written: int = 0) -> None:
        direction = -1.0 if self._parameters.value & REVERSED_BIT else 1.0
        self._position_counts = direction * POSITION_UNITS / self._position_step.value
        self._speed_counts = direction * SPEED_UNITS / self._speed_step.value
        self._operating_status.value = self._parameters.value & REVERSED_BIT
        self._measuring_step.value = self._position_step.value


def _check_step(step: int) -> None:
    if step == 0:
        raise SdoAbort(*abort_codes.VALUE_TOO_LOW)


def _check_parameters(parameters: int) -> None:
    if parameters & ~REVERSED_BIT:
        raise SdoAbort(*abort_codes.VALUE)
