"""Driver for a rotary position sensor (CiA 406)."""

import math
from pathlib import Path

from device_profiles import ROTARY_ENCODER_406
from hil_drivers.device import Input, Sensor
from hil_drivers.errors import DeviceMismatchError
from hil_drivers.interfaces import Reading
from hil_drivers.network import Network
from hil_drivers.node import object_name
from hil_drivers.pdo import PdoKind

_PARAMETERS, _PER_TURN, _TOTAL, _POSITION = 0x6000, 0x6001, 0x6002, 0x6004
_SPEED, _SPEED_PARAMETERS = 0x6030, 0x6031
_RESOLUTION, _REVOLUTIONS = 0x6501, 0x6502
_SCALING = 1 << 2


class RotarySensor(Sensor):
    """A rotary position sensor, of one turn or of many.

    The angle counts on where the encoder's position begins again, as long as the shaft turns by
    less than half of the encoder's range between two values.

    Args:
        network: the network that the device is on.
        node_id: its node-ID.
        eds: its EDS.
        max_age: values older than this [s] are refused.

    Raises:
        ValueError: the node-ID is out of range.
        EdsError: the EDS cannot be read.
        DeviceMismatchError: the EDS maps no position.
    """

    PROFILE = 406

    def __init__(
        self,
        network: Network,
        node_id: int,
        eds: Path | str = ROTARY_ENCODER_406,
        *,
        max_age: float = 0.1,
    ) -> None:
        super().__init__(network, node_id, eds, max_age=max_age)
        position, speed = self._first_mapped([(_POSITION, 0)]), (_SPEED, 1)
        inputs = self._add_inputs(self._carriers(PdoKind.TPDO, [position], [speed]))
        self._position = inputs[position]
        self._speed = inputs.get(speed)
        self._step = self._speed_step = math.nan
        self._total = 0
        self._steps: int | None = None

    @property
    def primary(self) -> Input:
        """The PDO that brings the position."""
        return self._position

    @property
    def angle(self) -> float:
        """Angle [rad], over all turns."""
        steps = int(self._value(self._position))
        if self._steps is not None:
            half = self._total // 2
            steps = self._steps + (steps - self._steps + half) % self._total - half
        self._steps = steps
        return steps * self._step

    @property
    def speed(self) -> float:
        """Speed [rad/s]; a `DeviceMismatchError` where the EDS maps none."""
        if self._speed is None:
            raise self._not_mapped(PdoKind.TPDO, object_name(_SPEED, 1))
        return self._value(self._speed) * self._speed_step

    @property
    def is_valid(self) -> bool:
        """Whether the device says that its value is valid: it has no emergency that is active."""
        return self.node.active_emergency is None

    @property
    def reading(self) -> Reading:
        """The angle with unit, time and validity."""
        return Reading(self.angle, "rad", self.received_at, self.is_valid)

    def _read_scaling(self) -> None:
        is_scaled = self.node.read_integer(_PARAMETERS) & _SCALING
        per_turn = self._read_count(_PER_TURN if is_scaled else _RESOLUTION)
        self._total = (
            self._read_count(_TOTAL) if is_scaled else per_turn * self._read_count(_REVOLUTIONS)
        )
        self._step = 2.0 * math.pi / per_turn
        self._steps = None
        if self._speed is not None:
            multiplier, divider = (self._read_count(_SPEED_PARAMETERS, sub) for sub in (3, 4))
            self._speed_step = self._step * divider / multiplier

    def _read_count(self, index: int, subindex: int = 0) -> int:
        count = self.node.read_integer(index, subindex)
        if count < 1:
            name = object_name(index, subindex)
            raise DeviceMismatchError(f"{self.node}: {name} is {count}; 1 or more is right")
        return count
