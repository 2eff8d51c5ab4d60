"""Driver for a pressure transducer on Modbus."""

import math
from pathlib import Path

from device_profiles import REGISTERS
from hil_drivers.interfaces import Reading
from hil_drivers.modbus.client import ModbusClient
from hil_drivers.modbus.device import ModbusDevice
from hil_drivers.modbus.register_map import RegisterMap

_NOT_VALID = 0x01
_INPUTS = "input_registers"


class PressureSensor(ModbusDevice):
    """One channel of a pressure transducer.

    Args:
        client: the client that reaches the device.
        unit_id: its unit-ID.
        registers: its register map; the pressure may be of any type and scale.
        max_age: values older than this [s] are refused.

    Raises:
        ValueError: the unit-ID is out of range.
        RegisterMapError: the register map cannot be read.
        DeviceMismatchError: the register map has no pressure.
    """

    PROFILE = "pressure_404"

    def __init__(
        self,
        client: ModbusClient,
        unit_id: int,
        registers: RegisterMap | Path | str = REGISTERS / "pressure_404.toml",
        *,
        max_age: float = 0.1,
    ) -> None:
        super().__init__(client, unit_id, registers, max_age=max_age)
        self._pressure = self.map.require(_INPUTS, "pressure")
        self._status = self.map.find(_INPUTS, "0x6150.01")
        self._poll_registers([self._pressure, self._status])

    @property
    def pressure(self) -> float:
        """Pressure [Pa]; NaN while the device says that its value is not valid."""
        counts = self._value(self._pressure)
        return counts * self._pressure.factor if self._is_valid(counts) else math.nan

    @property
    def is_valid(self) -> bool:
        """Whether the device says that its value is valid."""
        return self._is_valid(self._value(self._pressure))

    @property
    def reading(self) -> Reading:
        """The pressure with unit, time and validity."""
        return Reading(self.pressure, "Pa", self.received_at, self.is_valid)

    def _is_valid(self, counts: float) -> bool:
        if self._status is not None and int(self._value(self._status)) & _NOT_VALID:
            return False
        return math.isfinite(counts) and counts != self._pressure.no_value
