"""Position control of a valve-controlled cylinder, on the drivers alone.

`PositionController` is the law, `PositionLoop` runs it cycle by cycle: SYNC, values of the devices,
law, command to the valve.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import NamedTuple

from hil_drivers.errors import BusLostError, DriverTimeoutError
from hil_drivers.interfaces import (
    CommandedValve,
    Medium,
    PolledDevice,
    PositionSource,
    PressureSource,
)
from hil_drivers.motion_profile import MotionProfile, SetPoint


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerParameters:
    """Parameters of the controller, of valve and cylinder; the defaults fit Ruderman 2017, Table I.

    Attributes:
        position_gain: speed per position error [1/s]; stable only well below 2 ζ ω_c of the
            hydraulic mode, which is 100 1/s there.
        full_speed: piston speed at full opening [m/s].
        dead_zone: spool travel from centre that opens nothing, as fraction of full opening [-].
        tolerance: position error [m] that is left alone at rest: with friction and a dead zone, a
            controller that goes for zero never comes to rest.

    Raises:
        ValueError: a parameter is negative, or full speed or travel is none.
    """

    position_gain: float = 20.0
    full_speed: float = 0.29
    dead_zone: float = 3e-4 / 1.3e-3
    tolerance: float = 5e-5

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0 <= value < math.inf:
                raise ValueError(f"{field.name} {value}: 0 or a positive number is right")
        if not self.full_speed:
            raise ValueError("full_speed 0: a positive speed is right")
        if self.dead_zone >= 1:
            raise ValueError(f"dead_zone {self.dead_zone}: a fraction below 1 is right")


class PositionController:
    """Proportional position control with speed feedforward and dead-zone compensation.

    The wanted speed v = v_s + k (x_s - x) becomes the opening that gives it,
    sgn(v) (d + (1 - d) |v| / v_full), at most 1; with the set-point at rest and the error within
    the tolerance the valve stays centred.

    Args:
        parameters: of the law.
    """

    def __init__(self, parameters: ControllerParameters | None = None) -> None:
        self.parameters = parameters or ControllerParameters()

    def command(self, setpoint: SetPoint, position: float) -> float:
        """Return the spool set-point as fraction of full opening, -1 to 1.

        Args:
            setpoint: where the piston is to be.
            position: where it is [m].
        """
        parameters = self.parameters
        error = setpoint.position - position
        if setpoint.speed == 0 and abs(error) <= parameters.tolerance:
            return 0.0
        speed = setpoint.speed + parameters.position_gain * error
        share = min(abs(speed) / parameters.full_speed, 1.0)
        return math.copysign(parameters.dead_zone + (1 - parameters.dead_zone) * share, speed)


class CycleRecord(NamedTuple):
    """The measured values and the command of one cycle.

    Attributes:
        time: since the start of the run [s].
        position_setpoint: [m].
        position: [m].
        pressure_a: at port A [Pa], NaN while not valid.
        pressure_b: at port B [Pa], NaN while not valid.
        spool_setpoint: commanded now, as fraction of full opening [-].
        spool_position: as fraction of full opening [-].
    """

    time: float
    position_setpoint: float
    position: float
    pressure_a: float
    pressure_b: float
    spool_setpoint: float
    spool_position: float


class PositionLoop:
    """The control loop of one cylinder, at a fixed rate on an absolute grid.

    The devices are set up to send with each SYNC, their nodes are OPERATIONAL and the valve is
    ACTIVE before `run`; leaving the valve safe afterwards is the caller's, with its `close`.

    Args:
        network: the bus that paces the loop: the CANopen network, where any device is on one; the
            Modbus client otherwise.
        valve: moves the cylinder.
        position: of its piston.
        pressures: at port A and at port B.
        controller: the law.
        period: between two cycles [s].

    Attributes:
        period: as passed in.
        overruns: cycles left out because the caller or the machine took too long.
        missed_samples: cycles in which not every device answered; they use older values.

    Raises:
        ValueError: the period is not positive.
    """

    def __init__(
        self,
        network: Medium,
        *,
        valve: CommandedValve,
        position: PositionSource,
        pressures: tuple[PressureSource, PressureSource],
        controller: PositionController | None = None,
        period: float = 0.002,
    ) -> None:
        if not 0 < period < math.inf:
            raise ValueError(f"period {period} s: a positive time is right")
        self._network = network
        self._valve = valve
        self._position = position
        self._pressures = pressures
        self._controller = controller or PositionController()
        self._devices: tuple[PolledDevice, ...] = (valve, position, *pressures)
        self.period = period
        self.overruns = 0
        self.missed_samples = 0

    def sample(self) -> float:
        """Return the position [m] after every device has given its values.

        Raises:
            DriverTimeoutError: one did not, in time.
        """
        since = self._network.now()
        self._network.sync()
        for device in self._devices:
            if device.poll():
                continue
            if not self._network.wait_for(
                lambda device=device: device.received_at > since,  # type: ignore[misc]
                device.max_age,
            ):
                raise DriverTimeoutError(
                    f"{device}: value with SYNC: not within {device.max_age:g} s"
                )
        return self._position.position

    def run(self, profile: MotionProfile, duration: float) -> Iterator[CycleRecord]:
        """Follow a profile for `duration` seconds.

        Yields:
            What each cycle saw and did.
        """
        self.sample()
        start = self._network.now()
        number = 0
        while (time := number * self.period) < duration:
            self._network.pump_until(start + time)
            yield self._cycle(time, profile.at(time), start + time + self.period)
            behind = int((self._network.now() - start) / self.period) - number - 1
            self.overruns += max(behind, 0)
            number += 1 + max(behind, 0)

    def _cycle(self, time: float, setpoint: SetPoint, end: float) -> CycleRecord:
        network, valve = self._network, self._valve
        since = network.now()
        network.sync()
        awaited = [device for device in self._devices if not self._has_answered(device)]
        if not network.wait_for(
            lambda: all(device.received_at > since for device in awaited), end - since
        ):
            self.missed_samples += 1
        valve.check_active()
        position = self._position.position
        valve.spool_setpoint = self._controller.command(setpoint, position)
        return CycleRecord(
            time,
            setpoint.position,
            position,
            self._pressures[0].pressure,
            self._pressures[1].pressure,
            valve.spool_setpoint,
            valve.spool_position,
        )

    def _has_answered(self, device: PolledDevice) -> bool:
        """Poll a device; one that does not answer is awaited, and its values grow old."""
        try:
            return device.poll()
        except (DriverTimeoutError, BusLostError):
            return False
