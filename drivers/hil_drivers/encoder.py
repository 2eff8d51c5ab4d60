"""Common parts of the drivers of position sensors (CiA 406)."""

import math
from collections.abc import Sequence
from pathlib import Path

from hil_drivers.device import Input, Sensor
from hil_drivers.errors import DeviceMismatchError
from hil_drivers.network import Network
from hil_drivers.node import object_name
from hil_drivers.pdo import ObjectKey, PdoKind

_SPEED = 0x6030


class Encoder(Sensor):
    """Base of the drivers of position sensors.

    Args:
        network: the network that the device is on.
        node_id: its node-ID.
        eds: its EDS.
        positions: the objects that may bring the position; the first that is mapped does.
        channel: sub-index of the speed in 0x6030.
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
        eds: Path | str,
        positions: Sequence[ObjectKey],
        channel: int,
        *,
        max_age: float,
    ) -> None:
        super().__init__(network, node_id, eds, max_age=max_age)
        position, speed = self._first_mapped(positions), (_SPEED, channel)
        inputs = self._add_inputs(self._carriers(PdoKind.TPDO, [position], [speed]))
        self._position = inputs[position]
        self._speed = inputs.get(speed)
        self._channel = channel
        self._speed_step = math.nan

    @property
    def primary(self) -> Input:
        """The PDO that brings the position."""
        return self._position

    @property
    def speed(self) -> float:
        """Speed [m/s], of a rotary sensor [rad/s]; `DeviceMismatchError` if the EDS maps none."""
        if self._speed is None:
            raise self._not_mapped(PdoKind.TPDO, object_name(_SPEED, self._channel))
        return self._value(self._speed) * self._speed_step

    @property
    def is_valid(self) -> bool:
        """Return True if the device reports a valid value: it has no active emergency."""
        return self.node.active_emergency is None

    def _read_count(self, index: int, subindex: int = 0, meaning: str = "") -> int:
        count = self.node.read_integer(index, subindex)
        if count < 1:
            name = object_name(index, subindex) + meaning
            raise DeviceMismatchError(f"{self.node}: {name} is {count}; 1 or more is right")
        return count
