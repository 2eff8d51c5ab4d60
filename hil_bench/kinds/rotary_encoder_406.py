"""The rotary position sensor of CiA 406 as a kind of device."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from device_profiles import ROTARY_ENCODER_406
from hil_bench.canopen_device.node import Node
from hil_bench.config.settings import Problems, Settings
from hil_bench.devices.axis import Fitting, Measurement, Rate
from hil_bench.devices.measurement.parameters import ChainParameters
from hil_bench.devices.rotary_encoder_406 import RotaryEncoderDevice
from hil_bench.kinds.kind import DeviceKind, NodeConfig, require_quantities
from hil_bench.kinds.surroundings import Surroundings
from hil_bench.plants.kind import AxisSettings

_ANGLE, _SPEED = "angle", "speed"


@dataclass(frozen=True, slots=True)
class RotaryEncoderConfig(NodeConfig):
    """A rotary position sensor (CiA 406).

    Attributes:
        chain: what lies between the angle and the sensor's objects.
    """

    chain: ChainParameters


class RotaryEncoderKind(DeviceKind[RotaryEncoderConfig]):
    """An encoder measures angle and speed of its axis."""

    name = "rotary_encoder_406"
    record = RotaryEncoderConfig
    eds = ROTARY_ENCODER_406
    chain_unit = "rad"
    driver = "hil_drivers:RotarySensor"

    def check(self, table: str, node: Settings, axis: AxisSettings, problems: Problems) -> None:
        """Note a plant without an angle."""
        require_quantities(problems.place(table, "axis"), (_ANGLE, _SPEED), axis, problems)

    def measured(self, config: RotaryEncoderConfig) -> str:
        """Return the angle."""
        return _ANGLE

    def watched(self, config: RotaryEncoderConfig) -> Mapping[str, str]:
        """Return the angle."""
        return {_ANGLE: "angle"}

    def fit(self, config: RotaryEncoderConfig, node: Node, surroundings: Surroundings) -> Fitting:
        """Build the sensor, behind its chain if any."""
        chain = surroundings.chain(config.chain, config.name)
        by_name = surroundings.axes[str(config.axis)].kind.by_name
        measurement = Measurement(
            RotaryEncoderDevice(node).publish,
            by_name[_ANGLE],
            () if chain is None else (chain.measure,),
            name=config.name,
            rate=Rate("speed", by_name[_SPEED], () if chain is None else (chain.speed,)),
        )
        return Fitting(sensors=((str(config.axis), measurement),))


ROTARY_ENCODER: Final = RotaryEncoderKind()
