"""One axis of the bench: what commands its spool, its plant, and what measures it."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Protocol

from hil_bench.devices.bound_objects import QuantitySource
from hil_bench.devices.encoder_406 import EncoderDevice
from hil_bench.devices.pressure_404 import PressureDevice
from hil_bench.faults.signal_path import SignalPath, Stage
from hil_bench.plant.state import PlantInput, PlantOutput
from hil_bench.plant.stepping import Plant


class PressureMeasurement:
    """What hands one pressure of an axis to its transducer.

    Args:
        device: the transducer.
        source: "P_A" or "P_B".
        stages: what the pressure passes on its way; without any the transducer is ideal.
        name: of the transducer, for recordings.

    Attributes:
        path: that way.
        name: as passed in.
        measured: the pressure that was published last [Pa].
    """

    def __init__(
        self, device: PressureDevice, source: str, stages: Iterable[Stage] = (), *, name: str = ""
    ) -> None:
        self.path = SignalPath(stages)
        self.name = name
        self.measured = math.nan
        self._device = device
        self._field = PlantOutput._fields.index(source)

    def __call__(self, output: PlantOutput, now: int) -> None:
        """Publish the pressure of this tick [ns]."""
        pressure = output[self._field]
        for stage in self.path.stages:
            pressure = stage(pressure)
        self.measured = pressure
        self._device.publish(pressure, now)


class PositionMeasurement:
    """What hands position and speed of an axis to its position sensor.

    Args:
        device: the position sensor.
        stages: what the position passes on its way; without any the sensor is ideal.
        speed_stages: what the speed passes, after the position.
        name: of the sensor, for recordings.

    Attributes:
        path: the way of the position.
        speed_path: the way of the speed.
        name: as passed in.
        measured: the position that was published last [m].
        measured_speed: the speed that was published last [m/s].
    """

    def __init__(
        self,
        device: EncoderDevice,
        stages: Iterable[Stage] = (),
        speed_stages: Iterable[Stage] = (),
        *,
        name: str = "",
    ) -> None:
        self.path = SignalPath(stages)
        self.speed_path = SignalPath(speed_stages)
        self.name = name
        self.measured = self.measured_speed = math.nan
        self._device = device

    def __call__(self, output: PlantOutput, now: int) -> None:
        """Publish position and speed of this tick [ns]."""
        position, speed = output.x, output.v
        for stage in self.path.stages:
            position = stage(position)
        for stage in self.speed_path.stages:
            speed = stage(speed)
        self.measured, self.measured_speed = position, speed
        self._device.publish(position, speed, now)


class QuantityMeasurement:
    """What hands the plant's output of a name, such as "P_A", to an object.

    Args:
        source: the object.
        output_name: of the plant's output.
        stages: what the quantity passes on its way.
        name: of the object, as in ``NODE.0x6401.01``.

    Attributes:
        path: the way of the quantity.
        name: as passed in.
    """

    def __init__(
        self,
        source: QuantitySource,
        output_name: str,
        stages: Iterable[Stage] = (),
        *,
        name: str = "",
    ) -> None:
        self.path = SignalPath(stages)
        self.name = name
        self._source = source
        self._field = PlantOutput._fields.index(output_name)

    def __call__(self, output: PlantOutput, now: int) -> None:  # noqa: ARG002 - it has no delay
        """Publish the quantity of this tick [ns]."""
        quantity = output[self._field]
        for stage in self.path.stages:
            quantity = stage(quantity)
        self._source.publish(quantity)


Measurement = PressureMeasurement | PositionMeasurement | QuantityMeasurement


class SpoolCommand(Protocol):
    """What commands a spool, such as a valve."""

    @property
    def full_opening(self) -> float:
        """Spool position of 100 % [m]."""

    def command(self, now: int) -> float:
        """Return the spool set-point [m] at `now` [ns]."""

    def publish(self, spool_position: float, now: int) -> None:
        """Take the spool position [m] at `now` [ns]."""


@dataclass(frozen=True, slots=True)
class Axis:
    """One cylinder with its valve and its sensors.

    Attributes:
        name: as in the configuration.
        plant: valve and cylinder.
        valve: the device that commands the spool.
        sensors: what to call with the plant's new quantities, one a sensor.
        load: external load force F_L [N], constant.
        command_path: what the spool set-point passes between valve and spool.
    """

    name: str
    plant: Plant
    valve: SpoolCommand
    sensors: tuple[Measurement, ...]
    load: float = 0.0
    command_path: SignalPath = field(default_factory=SignalPath)

    def advance(self, now: int, steps: int) -> float:
        """Move the axis on by `steps` plant steps and return what the valve commands [m]."""
        commanded = u = self.valve.command(now)
        for stage in self.command_path.stages:
            u = stage(u)
        output = self.plant.step(PlantInput(u, self.load), steps)
        self.valve.publish(output.nu, now)
        for publish in self.sensors:
            publish(output, now)
        return commanded
