"""Drivers for the channels of a transducer (CiA 404): pressure and temperature."""

import math
from collections.abc import Mapping
from pathlib import Path

from device_profiles import PRESSURE_404
from hil_drivers.device import Input, Sensor
from hil_drivers.errors import DeviceMismatchError
from hil_drivers.interfaces import Reading
from hil_drivers.network import Network
from hil_drivers.node import object_name
from hil_drivers.pdo import PdoKind

PROCESS_VALUES = (0x6130, 0x9130, 0x8130, 0x7130)
"""Input process value as REAL32, INTEGER32, INTEGER24, INTEGER16: finest first."""

PASCAL_PER_UNIT = {0x22: 1.0, 0x4E: 1e5, 0xAB: 6894.757293168361}
"""Units of pressure by their code in CiA 303-2: pascal, bar, pound-force per square inch."""

CELSIUS_PER_UNIT = {0x2D: (1.0, 0.0), 0xAC: (5.0 / 9.0, -160.0 / 9.0)}
"""Units of temperature by their code: size [K] and zero [°C] of degree Celsius and Fahrenheit."""

_UNIT, _DIGITS, _STATUS = 0x6131, 0x6132, 0x6150
_MOST_DIGITS, _HIGHEST_POWER = 9, 9
_NOT_VALID = 0x01


class _Channel(Sensor):
    """One channel of a transducer.

    The process value may be a real number or a scaled integer, whichever the EDS maps into a TPDO;
    unit and decimal digits are read from the device.

    Args:
        network: the network that the device is on.
        node_id: its node-ID.
        eds: its EDS.
        channel: sub-index of the channel.
        max_age: values older than this [s] are refused.

    Raises:
        ValueError: the node-ID is out of range.
        EdsError: the EDS cannot be read.
        DeviceMismatchError: the EDS maps no process value of this channel.
    """

    PROFILE = 404

    def __init__(
        self,
        network: Network,
        node_id: int,
        eds: Path | str = PRESSURE_404,
        *,
        channel: int = 1,
        max_age: float = 0.1,
    ) -> None:
        super().__init__(network, node_id, eds, max_age=max_age)
        value = self._first_mapped([(index, channel) for index in PROCESS_VALUES])
        status = (_STATUS, channel)
        inputs = self._add_inputs(self._carriers(PdoKind.TPDO, [value], [status]))
        self._process_value = inputs[value]
        self._status = inputs.get(status)
        self._channel = channel

    @property
    def primary(self) -> Input:
        """The PDO that brings the process value."""
        return self._process_value

    @property
    def is_valid(self) -> bool:
        """Return True if the device says that its value is valid."""
        return self._is_valid(self._value(self._process_value))

    def _is_valid(self, value: float) -> bool:
        if self._status is not None and int(self._value(self._status)) & _NOT_VALID:
            return False
        # Beyond its range a transducer sends NaN or the smallest integer (WIKA MH-4-CAN manual).
        return math.isfinite(value) and value != self._process_value.signal.lowest

    def _process(self) -> float:
        """Return the process value as it stands in the PDO; NaN while it is not valid."""
        value = self._value(self._process_value)
        return value if self._is_valid(value) else math.nan

    def _read_unit(self, known: Mapping[int, object], right: str) -> tuple[int, float]:
        """Return the code of the unit that the device reports and its power of ten, by CiA 303-2.

        Raises:
            DeviceMismatchError: it is none that is known.
        """
        name = object_name(_UNIT, self._channel)
        code = self.node.read_integer(_UNIT, self._channel)
        exponent, numerator, denominator = code >> 24, code >> 16 & 0xFF, code >> 8 & 0xFF
        exponent -= 256 if exponent > 127 else 0
        if numerator not in known or denominator or abs(exponent) > _HIGHEST_POWER:
            raise DeviceMismatchError(
                f"{self.node}: {name} (physical unit) is 0x{code:08X}, {right} is right"
            )
        return numerator, 10.0**exponent

    def _read_resolution(self) -> float:
        """Return the value of one digit of the process value, in the device's unit.

        Raises:
            DeviceMismatchError: no integer of 32 bits has so many digits.
        """
        if self._process_value.signal.is_real:
            return 1.0
        digits = self.node.read_integer(_DIGITS, self._channel)
        if not 0 <= digits <= _MOST_DIGITS:
            name = object_name(_DIGITS, self._channel)
            right = f"0 to {_MOST_DIGITS} is right"
            raise DeviceMismatchError(f"{self.node}: {name} (decimal digits) is {digits}; {right}")
        return 10.0**-digits


class PressureSensor(_Channel):
    """One channel of a transducer that measures a pressure.

    Arguments and errors are those of every channel: the process value may be a real number or a
    scaled integer, whichever the EDS maps into a TPDO; unit and digits are read from the device.
    """

    _pascal_per_digit = math.nan

    @property
    def pressure(self) -> float:
        """Pressure [Pa]; NaN while the device says that its value is not valid."""
        return self._process() * self._pascal_per_digit

    @property
    def reading(self) -> Reading:
        """The pressure with unit, time and validity."""
        return Reading(self.pressure, "Pa", self.received_at, self.is_valid)

    def _read_scaling(self) -> None:
        right = "which is no pressure; 0x00220000 (Pa), 0x004E0000 (bar) or 0x00AB0000 (psi)"
        unit, power = self._read_unit(PASCAL_PER_UNIT, right)
        self._pascal_per_digit = PASCAL_PER_UNIT[unit] * power * self._read_resolution()


class TemperatureSensor(_Channel):
    """One channel of a transducer that measures a temperature; arguments as of a pressure."""

    _kelvin_per_digit = _zero = math.nan

    @property
    def temperature(self) -> float:
        """Temperature [°C]; NaN while the device says that its value is not valid."""
        return self._process() * self._kelvin_per_digit + self._zero

    @property
    def reading(self) -> Reading:
        """The temperature with unit, time and validity."""
        return Reading(self.temperature, "°C", self.received_at, self.is_valid)

    def _read_scaling(self) -> None:
        right = "which is no temperature; 0x002D0000 (°C) or 0x00AC0000 (°F)"
        unit, power = self._read_unit(CELSIUS_PER_UNIT, right)
        size, self._zero = CELSIUS_PER_UNIT[unit]
        self._kelvin_per_digit = size * power * self._read_resolution()
