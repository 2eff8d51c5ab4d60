"""Driver for a linear position sensor (CiA 406)."""

import math
from pathlib import Path

from device_profiles import ENCODER_406
from hil_drivers.device import Input, Sensor
from hil_drivers.errors import DeviceMismatchError
from hil_drivers.interfaces import Reading
from hil_drivers.network import Network
from hil_drivers.node import object_name
from hil_drivers.pdo import PdoKind

METRE_PER_POSITION_UNIT = 1e-9
"""0x6005.01 counts position steps in 0.001 um (CiA 406)."""

METRE_PER_SECOND_PER_SPEED_UNIT = 1e-5
"""0x6005.02 counts speed steps in 0.01 mm/s (CiA 406)."""

_POSITION, _POSITION_MULTI_SENSOR, _SPEED, _STEPS = 0x6004, 0x6020, 0x6030, 0x6005


class PositionSensor(Sensor):
    """A linear position sensor.

    The position may be 0x6004 or a channel of 0x6020, whichever the EDS maps into a TPDO; the
    measuring steps are read from the device.

    Args:
        network: the network that the device is on.
        node_id: its node-ID.
        eds: its EDS.
        channel: sub-index of the channel in 0x6020 and 0x6030.
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
        eds: Path | str = ENCODER_406,
        *,
        channel: int = 1,
        max_age: float = 0.1,
    ) -> None:
        super().__init__(network, node_id, eds, max_age=max_age)
        candidates = [(_POSITION_MULTI_SENSOR, channel)]
        if channel == 1:
            candidates.insert(0, (_POSITION, 0))
        position, speed = self._first_mapped(candidates), (_SPEED, channel)
        inputs = self._add_inputs(self._carriers(PdoKind.TPDO, [position], [speed]))
        self._position = inputs[position]
        self._speed = inputs.get(speed)
        self._channel = channel
        self._position_step = self._speed_step = math.nan

    @property
    def primary(self) -> Input:
        """The PDO that brings the position."""
        return self._position

    @property
    def position(self) -> float:
        """Position [m]."""
        return self._value(self._position) * self._position_step

    @property
    def speed(self) -> float:
        """Speed [m/s]; a `DeviceMismatchError` where the EDS maps none."""
        if self._speed is None:
            raise self._not_mapped(PdoKind.TPDO, object_name(_SPEED, self._channel))
        return self._value(self._speed) * self._speed_step

    @property
    def is_valid(self) -> bool:
        """Whether the device says that its value is valid: it has no emergency that is active."""
        return self.node.active_emergency is None

    @property
    def reading(self) -> Reading:
        """The position with unit, time and validity."""
        return Reading(self.position, "m", self.received_at, self.is_valid)

    def _read_scaling(self) -> None:
        self._position_step = self._read_step(1) * METRE_PER_POSITION_UNIT
        if self._speed is not None:
            self._speed_step = self._read_step(2) * METRE_PER_SECOND_PER_SPEED_UNIT

    def _read_step(self, subindex: int) -> int:
        step = self.node.read_integer(_STEPS, subindex)
        if step < 1:
            raise DeviceMismatchError(
                f"{self.node}: {object_name(_STEPS, subindex)} (measuring step) is {step}; "
                "1 or more is right"
            )
        return step
