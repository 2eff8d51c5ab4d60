"""The linear position sensor of CiA 406 with two measuring systems as a kind of device."""

from dataclasses import replace
from functools import partial
from typing import Final

from device_profiles import ENCODER_REDUNDANT_406, REGISTERS
from hil_bench.canopen_device.node import Node
from hil_bench.config.settings import Settings
from hil_bench.devices.axis import Fitting
from hil_bench.devices.quantities import redundant_quantities
from hil_bench.devices.redundant_encoder import RedundantEncoder
from hil_bench.kinds.encoder_406 import EncoderConfig, EncoderKind
from hil_bench.kinds.surroundings import Surroundings


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
        fitting = self.dress(config, device, surroundings)
        name = f"{config.name}.2"
        second = self.measure(config, name, device.publish_second, surroundings)
        return replace(
            fitting,
            sensors=(*fitting.sensors, (axis, second)),
            registers=partial(redundant_quantities, node.object_dictionary),
        )


REDUNDANT_ENCODER: Final = RedundantEncoderKind()
