"""Driver for a linear position sensor on Modbus."""

from pathlib import Path

from device_profiles import REGISTERS
from hil_drivers.errors import DeviceMismatchError
from hil_drivers.interfaces import Reading
from hil_drivers.modbus.client import ModbusClient
from hil_drivers.modbus.device import ModbusDevice
from hil_drivers.modbus.register_map import RegisterMap

_INPUTS = "input_registers"


class PositionSensor(ModbusDevice):
    """A linear position sensor.

    Args:
        client: the client that reaches the device.
        unit_id: its unit-ID.
        registers: its register map; position and speed may be of any type and scale.
        max_age: values older than this [s] are refused.

    Raises:
        ValueError: the unit-ID is out of range.
        RegisterMapError: the register map cannot be read.
        DeviceMismatchError: the register map has no position.
    """

    PROFILE = "encoder_406"

    def __init__(
        self,
        client: ModbusClient,
        unit_id: int,
        registers: RegisterMap | Path | str = REGISTERS / "encoder_406.toml",
        *,
        max_age: float = 0.1,
    ) -> None:
        super().__init__(client, unit_id, registers, max_age=max_age)
        self._position = self.map.require(_INPUTS, "position")
        self._speed = self.map.find(_INPUTS, "speed")
        self._alarms = self.map.find(_INPUTS, "0x6503")
        self._poll_registers([self._position, self._speed, self._alarms])

    @property
    def position(self) -> float:
        """Position [m]."""
        return self._value(self._position) * self._position.factor

    @property
    def speed(self) -> float:
        """Speed [m/s].

        Raises:
            DeviceMismatchError: the register map has none.
        """
        if self._speed is None:
            raise DeviceMismatchError(
                f'{self.map.path}: no register in {_INPUTS} has source "speed"; '
                "a map that has one is right"
            )
        return self._value(self._speed) * self._speed.factor

    @property
    def is_valid(self) -> bool:
        """Whether the device says that its value is valid."""
        return self._alarms is None or not self._value(self._alarms)

    @property
    def reading(self) -> Reading:
        """The position with unit, time and validity."""
        return Reading(self.position, "m", self.received_at, self.is_valid)
