"""The kinds of encoders by CiA 406."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

from device_profiles import ENCODER_406, ENCODER_REDUNDANT_406, REGISTERS, ROTARY_ENCODER_406
from hil_bench.canopen_device.node import Node
from hil_bench.config.settings import Problems, Settings
from hil_bench.devices.axis import Fitting, Measurement, Rate
from hil_bench.devices.encoder_406 import EncoderDevice
from hil_bench.devices.kinds.bindings import Surroundings
from hil_bench.devices.kinds.kind import DeviceKind, NodeConfig, require_quantities
from hil_bench.devices.measurement.low_pass import ChainParameters
from hil_bench.devices.rotary_encoder_406 import RedundantEncoder, RotaryEncoderDevice
from hil_bench.plants.plant import AxisSettings

# Common parts of the kinds of devices that measure a motion of their axis, and its speed.

_SPEED = "speed"


@dataclass(frozen=True, slots=True)
class MotionConfig(NodeConfig):
    """A sensor of a motion.

    Attributes:
        chain: what lies between the motion and the sensor's objects.
    """

    chain: ChainParameters


MotionT = TypeVar("MotionT", bound=MotionConfig)


class MotionKind(DeviceKind[MotionT]):
    """A sensor of a motion and its speed.

    Attributes:
        quantity: which motion, by its name at the plant.
    """

    quantity: str

    def check(self, table: str, node: Settings, axis: AxisSettings, problems: Problems) -> None:
        """Note a plant without such a motion."""
        require_quantities(problems.place(table, "axis"), (self.quantity, _SPEED), axis, problems)

    def measured(self, config: MotionT) -> str:
        """Return the quantity."""
        return self.quantity

    def watched(self, config: MotionT) -> Mapping[str, str]:
        """Return the quantity."""
        return {self.quantity: self.quantity}

    def measure(
        self,
        config: MotionT,
        name: str,
        publish: Callable[[float, float, int], None],
        surroundings: Surroundings,
    ) -> Measurement:
        """Build the measurement of motion and speed of the axis, by the named chain if any."""
        chain = surroundings.chain(config.chain, name)
        by_name = surroundings.axes[str(config.axis)].kind.by_name
        return Measurement(
            publish,
            by_name[self.quantity],
            () if chain is None else (chain.measure,),
            name=name,
            rate=Rate("speed", by_name[_SPEED], () if chain is None else (chain.speed,)),
        )


# The linear position sensor of CiA 406 as a kind of device.


@dataclass(frozen=True, slots=True)
class EncoderConfig(MotionConfig):
    """A linear position sensor (CiA 406)."""


class EncoderKind(MotionKind[EncoderConfig]):
    """An encoder measures position and speed of its axis."""

    name = "encoder_406"
    record = EncoderConfig
    eds = ENCODER_406
    registers: Path | None = REGISTERS / "encoder_406.toml"
    chain_unit = "m"
    driver = "hil_drivers:PositionSensor"
    quantity = "position"

    def fit(self, config: EncoderConfig, node: Node, surroundings: Surroundings) -> Fitting:
        """Build the sensor, behind its chain if any."""
        device = EncoderDevice(node, self.stroke(config, surroundings))
        measurement = self.measure(config, config.name, device.publish, surroundings)
        return Fitting(sensors=((str(config.axis), measurement),))

    def stroke(self, config: EncoderConfig, surroundings: Surroundings) -> tuple[float, float]:
        """Return the positions at the ends of the axis [m]; (0, 0) where it has none."""
        ends = surroundings.axes[str(config.axis)].limits(self.quantity)
        return ends if all(map(math.isfinite, ends)) else (0.0, 0.0)


ENCODER: Final = EncoderKind()


# The rotary position sensor of CiA 406 as a kind of device.


@dataclass(frozen=True, slots=True)
class RotaryEncoderConfig(MotionConfig):
    """A rotary position sensor (CiA 406)."""


class RotaryEncoderKind(MotionKind[RotaryEncoderConfig]):
    """An encoder measures angle and speed of its axis."""

    name = "rotary_encoder_406"
    record = RotaryEncoderConfig
    eds = ROTARY_ENCODER_406
    registers = REGISTERS / "rotary_encoder_406.toml"
    chain_unit = "rad"
    driver = "hil_drivers:RotarySensor"
    quantity = "angle"

    def fit(self, config: RotaryEncoderConfig, node: Node, surroundings: Surroundings) -> Fitting:
        """Build the sensor, behind its chain if any."""
        publish = RotaryEncoderDevice(node).publish
        measurement = self.measure(config, config.name, publish, surroundings)
        return Fitting(sensors=((str(config.axis), measurement),))


ROTARY_ENCODER: Final = RotaryEncoderKind()


# The linear position sensor of CiA 406 with two measuring systems as a kind of device.


class RedundantEncoderKind(EncoderKind):
    """Such an encoder measures position and speed of its axis twice."""

    name = "encoder_redundant_406"
    eds = ENCODER_REDUNDANT_406
    registers = REGISTERS / "encoder_redundant_406.toml"

    def signals(self, name: str, node: Settings) -> dict[str, str]:
        """Return both positions."""
        return {name: str(self.chain_unit), f"{name}.2": str(self.chain_unit)}

    def fit(self, config: EncoderConfig, node: Node, surroundings: Surroundings) -> Fitting:
        """Build the sensor, each system behind a chain of its own if any."""
        axis = str(config.axis)
        device = RedundantEncoder(node, self.stroke(config, surroundings))
        first = self.measure(config, config.name, device.publish, surroundings)
        name = f"{config.name}.2"
        second = self.measure(config, name, device.publish_second, surroundings)
        return Fitting(sensors=((axis, first), (axis, second)))


REDUNDANT_ENCODER: Final = RedundantEncoderKind()
