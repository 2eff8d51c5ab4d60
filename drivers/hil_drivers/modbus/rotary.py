"""Driver for a rotary position sensor on Modbus."""

import math
from collections.abc import Sequence

from hil_drivers.errors import DeviceMismatchError
from hil_drivers.interfaces import Reading
from hil_drivers.modbus.device import ModbusDevice
from hil_drivers.modbus.register_map import Register
from hil_drivers.turns import TurnCounter

_INPUTS = "input_registers"


class RotarySensor(ModbusDevice):
    """A rotary position sensor, of one turn or of many.

    The angle counts on where the sensor's position begins again, as long as the shaft turns by less
    than half of the sensor's range between two values.
    """

    PROFILE = "rotary_encoder_406"

    def _find_registers(self) -> Sequence[Register | None]:
        self._position = self.map.require(_INPUTS, "0x6004")
        self._turn_steps = self.map.require(_INPUTS, "turn_steps")
        self._range_steps = self.map.require(_INPUTS, "range_steps")
        self._speed = self.map.find(_INPUTS, "speed")
        self._alarms = self.map.find(_INPUTS, "0x6503")
        self._turns = TurnCounter()
        self._scale = (0, 0)
        return [
            self._position,
            self._turn_steps,
            self._range_steps,
            self._speed,
            self._alarms,
        ]

    @property
    def angle(self) -> float:
        """Angle [rad], over all turns; it begins anew where the steps were set to others."""
        position = self._steps(self._position)
        per_turn, total = scale = self._count(self._turn_steps), self._count(self._range_steps)
        if scale != self._scale:
            self._scale = scale
            self._turns.restart()
        return self._turns.count(position, total) * math.tau / per_turn

    @property
    def speed(self) -> float:
        """Speed [rad/s]; `DeviceMismatchError` if the register map has none."""
        register = self._speed or self.map.require(_INPUTS, "speed")
        return self._value(register) * register.factor

    @property
    def is_valid(self) -> bool:
        """Return True if the device says that its value is valid."""
        return self._alarms is None or not self._value(self._alarms)

    @property
    def reading(self) -> Reading:
        """The angle with unit, time and validity."""
        return Reading(self.angle, "rad", self.received_at, self.is_valid)

    def _steps(self, register: Register) -> int:
        return round(self._value(register) * register.factor)

    def _count(self, register: Register) -> int:
        steps = self._steps(register)
        if steps < 1:
            raise DeviceMismatchError(f"{self}: {register.name} is {steps}; 1 or more is right")
        return steps
