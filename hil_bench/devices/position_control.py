"""The axis position control of a CiA 408 valve: control mode 9.

The set-point 0x6600.01, between the limits 0x6621.01 and 0x6620.01, is the demand value 0x6610.01;
0x6601.01 and 0x6501.01 are position and speed that the valve's position sensor measures, and
0x6650.01 is the control deviation. All are in µm and µm/s, as their units and prefixes say.

In ACTIVE the set-point counts. In HOLD, FAULT_REACTION and FAULT_HOLD the valve goes on to control
the position: to where 0x2600.03 says, the hold set-point 0x6614.01 (0), the demand value (1) or the
actual value (2) of the moment in which ACTIVE was left. `DeviationMonitor` watches the deviation
while the loop is closed.

The controller is PI. Its gain, opening of the spool by deviation, and its integral time are the
maker's objects 0x2600.01 and 0x2600.02. Its output is a spool set-point, which goes through the
demand value generator as one from the bus does. It integrates only within the spool's opening.

The axis status word 0x561D says when the axis is there: bit 1 within window 1 (0x570C.01) and
slower than 0x570D.01, bit 3 slower than that, bit 5 within window 2 (0x570C.02).

Sources: Moog ACV CANopen manual B99224-DV018-D-211, sections 6.2.5 (set-point and hold), 7.7.4,
7.8.17, 7.14, 7.15.3 and 8.1.4 (0x8303); CanFestival's DS-408.prf (indices, types, limits).
Structure and parameters of the controller are this device's own.
"""

from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import INTEGER8, INTEGER16, INTEGER32, UNSIGNED8, UNSIGNED16
from hil_bench.canopen_device.emcy import DEVICE_PROFILE, EmcyProducer
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.devices.bound_objects import optional, saturate
from hil_bench.errors import SdoAbort

# The control deviation monitoring of a CiA 408 valve: 0x6351 to 0x6355; of its axis: 0x6651 ff.
#
# A control deviation outside the thresholds that lasts the delay time is an error: bit 11 of the
# status word, EMCY 0x8301, for the axis 0x8303. The time begins anew when the deviation is back
# inside, when the fault is acknowledged, and when a parameter of the monitoring is written.
#
# Source: Moog ACV CANopen manual B99224-DV018-D-211, sections 7.15.1 and 7.15.3 (function), 8.1.4
# (error codes).


DEVIATION_EMCY: Final = 0x8301
"""Position control monitoring."""

_MILLISECOND: Final = 1_000_000


class DeviationMonitor:
    """The monitoring of one valve.

    Attributes:
        is_on: whether it watches.
        has_tripped: whether the deviation has been outside for too long, and still is.
    """

    def __init__(
        self,
        object_dictionary: ObjectDictionary,
        emcy: EmcyProducer,
        *,
        base: int = 0x6350,
        code: int = DEVIATION_EMCY,
    ) -> None:
        """Bind the profile's objects; EdsError where one is of a wrong kind.

        Args:
            object_dictionary: of the valve.
            emcy: sends what it finds.
            base: index of the control deviation, before those of the monitoring.
            code: of its emergency message.
        """
        self._emcy, self._code = emcy, code
        od = object_dictionary
        self._type = optional(od, base + 1, 0, INTEGER8)
        self._delay = optional(od, base + 2, 1, UNSIGNED16)
        self._upper = optional(od, base + 4, 1, INTEGER16, INTEGER32)
        self._lower = optional(od, base + 5, 1, INTEGER16, INTEGER32)
        self._type.add_check(_check_type)
        for variable in (self._type, self._delay, self._upper, self._lower):
            variable.add_hook(self.restart)
        self.is_on = self.has_tripped = False
        self.restart()

    def restart(self, _written: int = 0) -> None:
        """Begin anew with the objects' present values."""
        self.is_on = self._type.value == 1
        self._outside_since: int | None = None
        self._recover()

    def watch(self, deviation: int, now: int) -> bool:
        """Take the deviation [increments] at `now` [ns]; return whether it has just tripped."""
        if self._lower.value <= deviation <= self._upper.value:
            self._outside_since = None
            self._recover()
            return False
        if self._outside_since is None:
            self._outside_since = now
        if self.has_tripped or now - self._outside_since < self._delay.value * _MILLISECOND:
            return False
        self.has_tripped = True
        self._emcy.raise_error(self._code, DEVICE_PROFILE)
        return True

    def _recover(self) -> None:
        if self.has_tripped:
            self.has_tripped = False
            self._emcy.clear_error(self._code)


def _check_type(monitoring: int) -> None:
    if monitoring not in {0, 1}:
        raise SdoAbort(*abort_codes.VALUE)


POSITION: Final = 9
"""Value of the control mode 0x6043."""

AXIS_DEVIATION_EMCY: Final = 0x8303
"""Position control monitoring, of the axis."""

IN_POSITION: Final = 1 << 1
STANDS: Final = 1 << 3
NEAR: Final = 1 << 5
"""Bits of the axis status word 0x561D."""

HOLD_SETPOINT, HOLD_DEMAND, HOLD_ACTUAL = 0, 1, 2
"""Values of 0x2600.03."""

_LOWEST: Final = -(1 << 31)
_HIGHEST: Final = (1 << 31) - 1
_LOWEST_SPOOL: Final = -32768
_HIGHEST_SPOOL: Final = 32767
_INCREMENTS: Final = 1e6
"""Of a metre."""
_SECOND: Final = 1_000_000_000


class PositionControl:
    """The position controller of one valve.

    Attributes:
        is_fitted: whether the valve has a position sensor; without one it has no such mode.
        is_closed: whether it commands the spool.
        is_limited: whether a limit holds the set-point back.
        monitor: of the control deviation.
    """

    def __init__(self, od: ObjectDictionary, emcy: EmcyProducer, reference: Variable) -> None:
        """Bind the profile's objects; EdsError where one is of a wrong kind.

        Args:
            od: object dictionary of the valve.
            emcy: sends what the monitor finds.
            reference: the spool's value of 100 %.
        """
        self.is_fitted = self.is_closed = self.is_limited = False
        self.monitor = DeviationMonitor(od, emcy, base=0x6650, code=AXIS_DEVIATION_EMCY)
        self._spool_reference = reference
        self._position: float | None = None
        self._integral = 0.0
        self._then: int | None = None
        self._held: int | None = None
        self._setpoint = optional(od, 0x6600, 1, INTEGER32)
        self._actual = optional(od, 0x6601, 1, INTEGER32)
        self._speed = optional(od, 0x6501, 1, INTEGER32)
        self._demand = optional(od, 0x6610, 1, INTEGER32)
        self._hold_setpoint = optional(od, 0x6614, 1, INTEGER32)
        self._upper = optional(od, 0x6620, 1, INTEGER32, absent=_HIGHEST)
        self._lower = optional(od, 0x6621, 1, INTEGER32, absent=_LOWEST)
        self._deviation = optional(od, 0x6650, 1, INTEGER32)
        self._gain = optional(od, 0x2600, 1, UNSIGNED16)
        self._integral_time = optional(od, 0x2600, 2, UNSIGNED16)
        self._hold_target = optional(od, 0x2600, 3, UNSIGNED8, absent=HOLD_ACTUAL)
        self._axis_status = optional(od, 0x561D, 0, UNSIGNED16)
        self._window = optional(od, 0x570C, 1, INTEGER32)
        self._outer_window = optional(od, 0x570C, 2, INTEGER32)
        self._speed_window = optional(od, 0x570D, 1, INTEGER32)
        self._upper.add_check(self._check_upper)
        self._lower.add_check(self._check_lower)
        self._hold_target.add_check(_check_target)
        for window in (self._window, self._outer_window, self._speed_window):
            window.add_check(_check_window)

    @property
    def has_integral(self) -> bool:
        """True if the loop is closed and its controller integrates."""
        return self.is_closed and self._integral_time.value > 0

    def measure(self, position: float, speed: float) -> None:
        """Take and show what the sensor measures [m], [m/s].

        Args:
            position: NaN leaves the last value, and opens the loop.
            speed: NaN leaves the last value.
        """
        increments = position * _INCREMENTS
        self._position = increments if increments == increments else None  # noqa: PLR0124 - NaN
        self._actual.value = saturate(increments, _LOWEST, _HIGHEST, unknown=self._actual.value)
        self._speed.value = saturate(
            speed * _INCREMENTS, _LOWEST, _HIGHEST, unknown=self._speed.value
        )
        self._show()

    def release(self) -> None:
        """Forget what was integrated and held: something else commands the spool."""
        if not self.is_closed and self._held is None:
            return
        self.is_closed = self.is_limited = False
        self._held = None
        self._integral = 0.0
        self._then = None
        self.monitor.restart()

    def follow(self, now: int) -> int | None:
        """Return the spool set-point [increments] on the way to the axis' set-point.

        Args:
            now: bench time [ns].

        Returns:
            None while the sensor measures nothing.
        """
        self._held = None
        return self._control(self._setpoint.value, now)

    def hold(self, now: int) -> int | None:
        """Return the same for the position in which the axis is to be held."""
        if self._held is None:
            asked = self._hold_target.value
            self._held = self._demand.value if asked == HOLD_DEMAND else self._actual.value
        is_setpoint = self._hold_target.value == HOLD_SETPOINT
        return self._control(self._hold_setpoint.value if is_setpoint else self._held, now)

    def shift(self, opening: float, position: float) -> None:
        """Integrate on from where another valve is, of which this one is the twin.

        Args:
            opening: by how much its spool is elsewhere [-].
            position: by how much its axis is [m].
        """
        if self.has_integral:
            integral = self._integral + opening + self._gain.value * position
            self._integral = min(max(integral, -1.0), 1.0)

    def watch(self, now: int) -> bool:
        """Return True if the deviation has just lasted too long, at `now` [ns]; while closed."""
        return self.monitor.is_on and self.monitor.watch(self._deviation.value, now)

    def _control(self, asked: int, now: int) -> int | None:
        if self._position is None:
            self.release()
            return None
        self.is_closed = True
        demand = min(max(asked, self._lower.value), self._upper.value)
        self.is_limited = demand != asked
        self._demand.value = demand
        self._show()
        opening = self._follow((demand - self._position) / _INCREMENTS, now)
        increments = opening * self._spool_reference.value
        return saturate(increments, _LOWEST_SPOOL, _HIGHEST_SPOOL, unknown=0)

    def _follow(self, deviation: float, now: int) -> float:
        """Return the opening that the controller asks for [-], for a deviation [m]."""
        elapsed = 0.0 if self._then is None else (now - self._then) / _SECOND
        self._then = now
        part: float = self._gain.value * deviation
        opening = part + self._integral
        is_held = (opening >= 1.0 and part > 0.0) or (opening <= -1.0 and part < 0.0)
        if not self._integral_time.value:
            self._integral = 0.0
        elif not is_held:
            self._integral += part * 1000.0 / self._integral_time.value * elapsed
            self._integral = min(max(self._integral, -1.0), 1.0)
        return min(max(opening, -1.0), 1.0)

    def _show(self) -> None:
        deviation = self._demand.value - self._actual.value
        self._deviation.value = min(max(deviation, _LOWEST), _HIGHEST)
        distance = abs(deviation)
        status = NEAR if distance < self._outer_window.value else 0
        if abs(self._speed.value) < self._speed_window.value:
            status |= STANDS
            if distance < self._window.value:
                status |= IN_POSITION
        self._axis_status.value = status

    def _check_upper(self, limit: int) -> None:
        if limit < self._lower.value:
            raise SdoAbort(*abort_codes.VALUE_TOO_LOW)

    def _check_lower(self, limit: int) -> None:
        if limit > self._upper.value:
            raise SdoAbort(*abort_codes.VALUE_TOO_HIGH)


def _check_target(target: int) -> None:
    if target > HOLD_ACTUAL:
        raise SdoAbort(*abort_codes.VALUE_TOO_HIGH)


def _check_window(window: int) -> None:
    if window < 0:
        raise SdoAbort(*abort_codes.VALUE_TOO_LOW)
