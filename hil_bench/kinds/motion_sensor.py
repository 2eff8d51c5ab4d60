"""Common parts of the kinds of devices that measure a motion of their axis, and its speed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from hil_bench.config.settings import Problems, Settings
from hil_bench.devices.axis import Measurement, Rate
from hil_bench.devices.measurement.parameters import ChainParameters
from hil_bench.kinds.kind import DeviceKind, NodeConfig, require_quantities
from hil_bench.kinds.surroundings import Surroundings
from hil_bench.plants.kind import AxisSettings

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
