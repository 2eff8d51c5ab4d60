"""The rotary position sensor of CiA 406 as a kind of device."""

from dataclasses import dataclass
from functools import partial
from typing import Final

from device_profiles import REGISTERS, ROTARY_ENCODER_406
from hil_bench.canopen_device.node import Node
from hil_bench.devices.axis import Fitting
from hil_bench.devices.quantities import rotary_quantities
from hil_bench.devices.rotary_encoder_406 import RotaryEncoderDevice
from hil_bench.kinds.motion_sensor import MotionConfig, MotionKind
from hil_bench.kinds.surroundings import Surroundings


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
        return Fitting(
            sensors=((str(config.axis), measurement),),
            registers=partial(rotary_quantities, node.object_dictionary),
        )


ROTARY_ENCODER: Final = RotaryEncoderKind()
