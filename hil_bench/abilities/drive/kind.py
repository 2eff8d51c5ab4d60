"""The drive of CiA 402 as a kind of device."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from device_profiles import DRIVE_402
from hil_bench.canopen_device.node import Node
from hil_bench.config.settings import Key, Problems, Settings
from hil_bench.config.values import number
from hil_bench.devices.axis import Drive, Fitting, Measurement, Rate
from hil_bench.devices.kinds.bindings import Surroundings
from hil_bench.devices.kinds.kind import require_quantities
from hil_bench.devices.kinds.valve_408 import FULL_OPENING, SpoolConfig, SpoolKind
from hil_bench.plants.plant import AxisSettings
from hil_bench.units import REVOLUTION_PER_MINUTE

_ANGLE, _SPEED = "angle", "speed"


@dataclass(frozen=True, slots=True)
class DriveConfig(SpoolConfig):
    """A drive (CiA 402).

    Attributes:
        full_speed: speed of the shaft at 100 % without load, which is fed forward [rad/s].
    """

    full_speed: float


class DriveKind(SpoolKind[DriveConfig]):
    """A drive commands the spool of an axis that turns, and measures its shaft."""

    name = "drive_402"
    record = DriveConfig
    eds = DRIVE_402
    keys = (
        FULL_OPENING,
        Key(
            "full_speed_rpm",
            number(REVOLUTION_PER_MINUTE, low=1.0, high=1e5),
            2500.0,
            REVOLUTION_PER_MINUTE,
            "full_speed",
        ),
    )

    def check(self, table: str, node: Settings, axis: AxisSettings, problems: Problems) -> None:
        """Note a plant that does not turn."""
        require_quantities(problems.place(table, "axis"), (_ANGLE, _SPEED), axis, problems)

    def signals(self, name: str, node: Settings) -> Mapping[str, str]:
        """Return the angle that its encoder measures."""
        return {name: "rad"}

    def fit(self, config: DriveConfig, node: Node, surroundings: Surroundings) -> Fitting:
        """Build the drive with its encoder."""
        from hil_bench.abilities.drive.drive_402 import DriveDevice  # noqa: PLC0415 - few have one

        axis = str(config.axis)
        device = DriveDevice(node, surroundings.full_scales[axis], config.full_speed)
        by_name = surroundings.axes[axis].kind.by_name
        rate = Rate("speed", by_name[_SPEED])
        encoder = Measurement(device.measure, by_name[_ANGLE], name=config.name, rate=rate)
        return Fitting(
            drives=(Drive(config.name, axis, device),),
            sensors=((axis, encoder),),
            state=lambda: device.state.value,
        )


KINDS: Final = (DriveKind(),)
"""The kinds of devices of this ability."""
