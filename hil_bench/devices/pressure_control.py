"""The pressure control of a CiA 408 valve: control modes 4 (pressure) and 5 (p/Q).

The set-point 0x6380.01, between the limits 0x63A1.01 and 0x63A0.01 and times the factor 0x63A2, is
the demand value 0x6390.01; 0x6381.01 is what the valve's pressure sensor shows and 0x63D0.01 the
control deviation. The reference value 0x6391.01 stands for the end of the sensor's range.

The controller is PI. Its gain, opening of the spool by deviation of the pressure, both as parts of
their references, and its integral time are the maker's objects 0x2380.01 and 0x2380.02. Its output
is a spool set-point, which goes through the demand value generator as one from the bus does. It
integrates only while the spool obeys it.

Pressure: the controller has the spool. p/Q: the spool set-point 0x6300.01 has it until the
controller asks for less; then the pressure controller is active, bit 8 of the status word.

Sources: Moog ACV CANopen manual B99224-DV018-D-211 (objects, modes, bit 8). The structure of the
controller and its parameters are this device's own, and 0x63D0 follows from 0x6350 by the distance
that the other pressure objects have from those of the spool.
"""

from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import INTEGER16, UNSIGNED16, UNSIGNED32
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.devices.bound_objects import locate, optional, saturate
from hil_bench.errors import EdsError, SdoAbort

PRESSURE: Final = 4
PRESSURE_AND_FLOW: Final = 5
"""Values of the control mode 0x6043."""

_LOWEST: Final = -32768
_HIGHEST: Final = 32767
_REFERENCE: Final = 16384
_UNITY: Final = 0x0001_0001
_GAIN_UNIT: Final = 0.01
_SECOND: Final = 1_000_000_000


class PressureControl:
    """The pressure controller of one valve.

    Attributes:
        is_active: whether the pressure controller holds back the flow set-point (p/Q).
        sense: 1 where a positive spool raises the pressure, -1 where it lowers it; 0 for a valve
            without a pressure sensor, which has neither mode.
    """

    def __init__(self, od: ObjectDictionary, mode: Variable, reference: Variable) -> None:
        """Bind the profile's objects.

        Args:
            od: object dictionary of the valve.
            mode: 0x6043, which part of the valve has the spool.
            reference: the spool's value of 100 %.

        Raises:
            EdsError: one is of a wrong kind.
        """
        self.sense = 0
        self.is_active = False
        self._span = 1.0
        self._pressure = 0.0
        self._integral = 0.0
        self._then: int | None = None
        self._spool_reference = reference
        self._mode = mode
        self._setpoint = optional(od, 0x6380, 1, INTEGER16)
        self._actual = optional(od, 0x6381, 1, INTEGER16)
        self._demand = optional(od, 0x6390, 1, INTEGER16)
        self._reference = optional(od, 0x6391, 1, INTEGER16, absent=_REFERENCE)
        self._upper = optional(od, 0x63A0, 1, INTEGER16, absent=_HIGHEST)
        self._lower = optional(od, 0x63A1, 1, INTEGER16, absent=_LOWEST)
        self._factor = optional(od, 0x63A2, 0, UNSIGNED32, absent=_UNITY)
        self._deviation = optional(od, 0x63D0, 1, INTEGER16)
        self._gain = optional(od, 0x2380, 1, UNSIGNED16)
        self._integral_time = optional(od, 0x2380, 2, UNSIGNED16)
        if self._reference.default <= 0:
            raise EdsError(
                f"{locate(od, self._reference)} is {self._reference.default}; "
                "the value that stands for 100 % is more than 0"
            )
        self._reference.add_check(_check_reference)
        self._upper.add_check(self._check_upper)
        self._lower.add_check(self._check_lower)
        self._factor.add_check(_check_factor)

    def fit_sensor(self, span: float, sense: int) -> None:
        """Give the valve a pressure sensor.

        Args:
            span: pressure of 100 % [Pa].
            sense: see `sense`.
        """
        self._span = span
        self.sense = sense

    def measure(self, pressure: float) -> None:
        """Take and show what the pressure sensor measures [Pa]; NaN leaves the last value."""
        steps = pressure / self._span * self._reference.value
        self._actual.value = saturate(steps, _LOWEST, _HIGHEST, unknown=self._actual.value)
        if pressure == pressure:  # noqa: PLR0124 - false for NaN only
            self._pressure = pressure / self._span

    def restart(self) -> None:
        """Forget what was integrated."""
        self._integral = 0.0
        self._then = None
        self.is_active = False

    def control(self, flow: int, now: int) -> int:
        """Return the spool set-point [increments].

        Args:
            flow: the set-point 0x6300.01, which counts in p/Q.
            now: bench time [ns].
        """
        spool_reference: int = self._spool_reference.value
        ceiling, floor = 1.0, -1.0
        if self._mode.value == PRESSURE_AND_FLOW:
            wanted = flow / spool_reference
            # What raises the pressure is held back; what lowers it is not.
            ceiling, floor = (wanted, -1.0) if self.sense > 0 else (1.0, wanted)
        asked = self._follow(self._show_demand(), now, floor, ceiling)
        opening = min(max(asked, floor), ceiling)
        is_flow = opening == (ceiling if self.sense > 0 else floor)
        self.is_active = self._mode.value == PRESSURE_AND_FLOW and not is_flow
        return saturate(opening * spool_reference, _LOWEST, _HIGHEST, unknown=0)

    def _show_demand(self) -> float:
        """Return the deviation [-] and show what leads to it."""
        limited = min(max(self._setpoint.value, self._lower.value), self._upper.value)
        numerator, denominator = divmod(self._factor.value, 0x10000)
        demand = saturate(limited * numerator / denominator, _LOWEST, _HIGHEST, unknown=0)
        self._demand.value = demand
        self._deviation.value = saturate(demand - self._actual.value, _LOWEST, _HIGHEST, unknown=0)
        return float(demand / self._reference.value) - self._pressure

    def _follow(self, deviation: float, now: int, floor: float, ceiling: float) -> float:
        """Return the spool that the controller asks for [-]."""
        gain = self.sense * self._gain.value * _GAIN_UNIT
        elapsed = 0.0 if self._then is None else (now - self._then) / _SECOND
        self._then = now
        asked: float = gain * deviation + self._integral
        is_held = (asked >= ceiling and gain * deviation > 0.0) or (
            asked <= floor and gain * deviation < 0.0
        )
        if self._integral_time.value and not is_held:
            rate = 1000.0 / self._integral_time.value
            self._integral += gain * deviation * rate * elapsed
            self._integral = min(max(self._integral, -1.0), 1.0)
        return asked

    def _check_upper(self, limit: int) -> None:
        if limit < self._lower.value:
            raise SdoAbort(*abort_codes.VALUE_TOO_LOW)

    def _check_lower(self, limit: int) -> None:
        if limit > self._upper.value:
            raise SdoAbort(*abort_codes.VALUE_TOO_HIGH)


def _check_reference(reference: int) -> None:
    if reference <= 0:
        raise SdoAbort(*abort_codes.VALUE_TOO_LOW)


def _check_factor(factor: int) -> None:
    if not factor >> 16 or not factor & 0xFFFF:
        raise SdoAbort(*abort_codes.VALUE)
