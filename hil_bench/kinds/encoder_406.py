"""The linear position sensor of CiA 406 as a kind of device."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

from device_profiles import ENCODER_406, REGISTERS
from hil_bench.canopen_device.node import Node
from hil_bench.config.settings import Problems, Settings
from hil_bench.devices.axis import Fitting, Measurement, Rate
from hil_bench.devices.encoder_406 import EncoderDevice
from hil_bench.devices.measurement.parameters import ChainParameters
from hil_bench.devices.quantities import encoder_quantities
from hil_bench.kinds.kind import DeviceKind, NodeConfig, require_quantities
from hil_bench.kinds.surroundings import Surroundings
from hil_bench.plants.kind import AxisSettings

_POSITION, _SPEED = "position", "speed"


@dataclass(frozen=True, slots=True)
class EncoderConfig(NodeConfig):
    """A linear position sensor (CiA 406).

    Attributes:
        chain: what lies between the position and the sensor's objects.
    """

    chain: ChainParameters


class EncoderKind(DeviceKind[EncoderConfig]):
    """An encoder measures position and speed of its axis."""

    name = "encoder_406"
    record = EncoderConfig
    eds = ENCODER_406
    registers = REGISTERS / "encoder_406.toml"
    chain_unit = "m"
    driver = "hil_drivers:PositionSensor"

    def check(self, table: str, node: Settings, axis: AxisSettings, problems: Problems) -> None:
        """Note a plant without a position."""
        require_quantities(problems.place(table, "axis"), (_POSITION, _SPEED), axis, problems)

    def measured(self, config: EncoderConfig) -> str:
        """Return the position."""
        return _POSITION

    def watched(self, config: EncoderConfig) -> Mapping[str, str]:
        """Return the position."""
        return {_POSITION: "position"}

    def fit(self, config: EncoderConfig, node: Node, surroundings: Surroundings) -> Fitting:
        """Build the sensor, behind its chain if any."""
        chain = surroundings.chain(config.chain, config.name)
        axis = surroundings.axes[str(config.axis)]
        device = EncoderDevice(node, axis.limits(_POSITION))
        by_name = axis.kind.by_name
        measurement = Measurement(
            device.publish,
            by_name[_POSITION],
            () if chain is None else (chain.measure,),
            name=config.name,
            rate=Rate("speed", by_name[_SPEED], () if chain is None else (chain.speed,)),
        )
        return Fitting(
            sensors=((str(config.axis), measurement),),
            registers=partial(encoder_quantities, node.object_dictionary),
        )


ENCODER: Final = EncoderKind()
