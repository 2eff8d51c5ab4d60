"""The linear position sensor of CiA 406 as a kind of device."""

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from device_profiles import ENCODER_406, REGISTERS
from hil_bench.canopen_device.node import Node
from hil_bench.devices.axis import Fitting
from hil_bench.devices.encoder_406 import EncoderDevice
from hil_bench.devices.quantities import encoder_quantities
from hil_bench.kinds.motion_sensor import MotionConfig, MotionKind
from hil_bench.kinds.surroundings import Surroundings


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
        return self.dress(config, device, surroundings)

    def stroke(self, config: EncoderConfig, surroundings: Surroundings) -> tuple[float, float]:
        """Return the positions at the ends of the axis [m]; (0, 0) where it has none."""
        ends = surroundings.axes[str(config.axis)].limits(self.quantity)
        return ends if all(map(math.isfinite, ends)) else (0.0, 0.0)

    def dress(
        self, config: EncoderConfig, device: EncoderDevice, surroundings: Surroundings
    ) -> Fitting:
        """Return the fitting of a built sensor: its measurement and its registers."""
        measurement = self.measure(config, config.name, device.publish, surroundings)
        return Fitting(
            sensors=((str(config.axis), measurement),),
            registers=partial(encoder_quantities, device.node.object_dictionary),
        )


ENCODER: Final = EncoderKind()
