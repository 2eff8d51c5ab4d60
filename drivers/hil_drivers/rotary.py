"""Driver for a rotary position sensor (CiA 406)."""

import math
from pathlib import Path

from device_profiles import ROTARY_ENCODER_406
from hil_drivers.encoder import Encoder
from hil_drivers.interfaces import Reading
from hil_drivers.network import Network
from hil_drivers.turns import TurnCounter

_PARAMETERS, _PER_TURN, _TOTAL, _POSITION = 0x6000, 0x6001, 0x6002, 0x6004
_SPEED_PARAMETERS = 0x6031
_RESOLUTION, _REVOLUTIONS = 0x6501, 0x6502
_SCALING = 1 << 2


class RotarySensor(Encoder):
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

    def __init__(
        self,
        network: Network,
        node_id: int,
        eds: Path | str = ROTARY_ENCODER_406,
        *,
        max_age: float = 0.1,
    ) -> None:
        super().__init__(network, node_id, eds, [(_POSITION, 0)], 1, max_age=max_age)
        self._step = math.nan
        self._total = 0
        self._turns = TurnCounter()

    @property
    def angle(self) -> float:
        """Angle [rad], over all turns."""
        return self._turns.count(int(self._value(self._position)), self._total) * self._step

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
        self._turns.restart()
        if self._speed is not None:
            multiplier, divider = (self._read_count(_SPEED_PARAMETERS, sub) for sub in (3, 4))
            self._speed_step = self._step * divider / multiplier
