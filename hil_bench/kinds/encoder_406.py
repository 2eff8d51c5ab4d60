"""The linear position sensor of CiA 406 as a kind of device."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
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
    registers: Path | None = REGISTERS / "encoder_406.toml"
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
        device = EncoderDevice(node, self.stroke(config, surroundings))
        return self.dress(config, device, surroundings)

    def stroke(self, config: EncoderConfig, surroundings: Surroundings) -> tuple[float, float]:
        """Return the positions at the ends of the axis [m]; (0, 0) where it has none."""
        ends = surroundings.axes[str(config.axis)].limits(_POSITION)
        return ends if all(map(math.isfinite, ends)) else (0.0, 0.0)

    def dress(
        self, config: EncoderConfig, device: EncoderDevice, surroundings: Surroundings
    ) -> Fitting:
        """Return what a built sensor does on the bench."""
        measurement = measure_motion(config, config.name, device.publish, surroundings)
        return Fitting(
            sensors=((str(config.axis), measurement),),
            registers=partial(encoder_quantities, device.node.object_dictionary),
        )


def measure_motion(
    config: EncoderConfig,
    name: str,
    publish: Callable[[float, float, int], None],
    surroundings: Surroundings,
) -> Measurement:
    """Return what hands position and speed of the axis on, by the chain of that name if any."""
    chain = surroundings.chain(config.chain, name)
    by_name = surroundings.axes[str(config.axis)].kind.by_name
    return Measurement(
        publish,
        by_name[_POSITION],
        () if chain is None else (chain.measure,),
        name=name,
        rate=Rate("speed", by_name[_SPEED], () if chain is None else (chain.speed,)),
    )


ENCODER: Final = EncoderKind()
