"""Driver for a linear position sensor (CiA 406)."""

import math
from pathlib import Path

from device_profiles import ENCODER_406
from hil_drivers.encoder import Encoder
from hil_drivers.interfaces import Reading
from hil_drivers.network import Network

METRE_PER_POSITION_UNIT = 1e-9
"""0x6005.01 counts position steps in 0.001 um (CiA 406)."""

METRE_PER_SECOND_PER_SPEED_UNIT = 1e-5
"""0x6005.02 counts speed steps in 0.01 mm/s (CiA 406)."""

_POSITION, _POSITION_MULTI_SENSOR, _STEPS = 0x6004, 0x6020, 0x6005


class PositionSensor(Encoder):
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

    def __init__(
        self,
        network: Network,
        node_id: int,
        eds: Path | str = ENCODER_406,
        *,
        channel: int = 1,
        max_age: float = 0.1,
    ) -> None:
        candidates = [(_POSITION_MULTI_SENSOR, channel)]
        if channel == 1:
            candidates.insert(0, (_POSITION, 0))
        super().__init__(network, node_id, eds, candidates, channel, max_age=max_age)
        self._position_step = math.nan

    @property
    def position(self) -> float:
        """Position [m]."""
        return self._value(self._position) * self._position_step

    @property
    def reading(self) -> Reading:
        """The position with unit, time and validity."""
        return Reading(self.position, "m", self.received_at, self.is_valid)

    def _read_scaling(self) -> None:
        self._position_step = self._read_step(1) * METRE_PER_POSITION_UNIT
        if self._speed is not None:
            self._speed_step = self._read_step(2) * METRE_PER_SECOND_PER_SPEED_UNIT

    def _read_step(self, subindex: int) -> int:
        return self._read_count(_STEPS, subindex, " (measuring step)")
