"""Driver for a linear position sensor on Modbus."""

from collections.abc import Sequence

from hil_drivers.errors import DeviceMismatchError
from hil_drivers.interfaces import Reading
from hil_drivers.modbus.device import ModbusDevice
from hil_drivers.modbus.register_map import Register

_INPUTS = "input_registers"


class PositionSensor(ModbusDevice):
    """A linear position sensor."""

    PROFILE = "encoder_406"

    def _find_registers(self) -> Sequence[Register | None]:
        self._position = self.map.require(_INPUTS, "position")
        self._speed = self.map.find(_INPUTS, "speed")
        self._alarms = self.map.find(_INPUTS, "0x6503")
        return [self._position, self._speed, self._alarms]

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
        """Return True if the device says that its value is valid."""
        return self._alarms is None or not self._value(self._alarms)

    @property
    def reading(self) -> Reading:
        """The position with unit, time and validity."""
        return Reading(self.position, "m", self.received_at, self.is_valid)
