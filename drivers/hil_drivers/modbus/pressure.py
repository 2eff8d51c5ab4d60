"""Driver for a pressure transducer on Modbus."""

import math
from collections.abc import Sequence

from hil_drivers.interfaces import Reading
from hil_drivers.modbus.device import ModbusDevice
from hil_drivers.modbus.register_map import Register

_NOT_VALID = 0x01
_INPUTS = "input_registers"


class PressureSensor(ModbusDevice):
    """One channel of a pressure transducer."""

    PROFILE = "pressure_404"

    def _find_registers(self) -> Sequence[Register | None]:
        self._pressure = self.map.require(_INPUTS, "pressure")
        self._status = self.map.find(_INPUTS, "0x6150.01")
        return [self._pressure, self._status]

    @property
    def pressure(self) -> float:
        """Pressure [Pa]; NaN while the device says that its value is not valid."""
        counts = self._value(self._pressure)
        return counts * self._pressure.factor if self._is_valid(counts) else math.nan

    @property
    def is_valid(self) -> bool:
        """Return True if the device says that its value is valid."""
        return self._is_valid(self._value(self._pressure))

    @property
    def reading(self) -> Reading:
        """The pressure with unit, time and validity."""
        return Reading(self.pressure, "Pa", self.received_at, self.is_valid)

    def _is_valid(self, counts: float) -> bool:
        if self._status is not None and int(self._value(self._status)) & _NOT_VALID:
            return False
        return math.isfinite(counts) and counts != self._pressure.no_value
