"""A joystick with two axes, whose deflections follow a script, as a kind of device.

It belongs to no axis of the bench: it measures what its own hand does, in the range -1 to 1, and
shows it in 0x6401.01 and 0x6401.02.
"""

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from hil_bench.canopen_device.node import Node
from hil_bench.config.settings import Key, Settings
from hil_bench.config.values import points
from hil_bench.devices.axis import Fitting, Measurement, RegisterValue
from hil_bench.devices.bound_objects import QuantitySource
from hil_bench.devices.kinds.bindings import Surroundings
from hil_bench.devices.kinds.kind import DeviceKind, NodeConfig
from hil_bench.plants.plant import Quantity
from hil_bench.units import Unit

Script = tuple[tuple[float, float], ...]

HERE = Path(__file__).parent
SECOND_AND_DEFLECTION = Unit("[s, -]", "")
INCREMENTS = 10_000  # of a full deflection
DELTA = 100  # increments whose change is an event for the TPDO
DEFLECTIONS = (Quantity("x", "-", 0), Quantity("y", "-", 1))


@dataclass(frozen=True, slots=True)
class JoystickConfig(NodeConfig):
    """A joystick.

    Attributes:
        x: deflection to the right over bench time, points of [s, -].
        y: deflection away from the user.
    """

    x: Script
    y: Script


class JoystickKind(DeviceKind[JoystickConfig]):
    """A joystick measures itself."""

    name = "joystick"
    record = JoystickConfig
    eds = HERE / "joystick.eds"
    registers = HERE / "joystick.toml"
    has_axis = False
    keys = tuple(
        Key(name, points(SECOND_AND_DEFLECTION), ((0.0, 0.0),), SECOND_AND_DEFLECTION)
        for name in ("x", "y")
    )

    def signals(self, name: str, node: Settings) -> Mapping[str, str]:
        """Both deflections may have a sensor's faults."""
        return {f"{name}.{deflection.name}": deflection.unit for deflection in DEFLECTIONS}

    def fit(self, config: JoystickConfig, node: Node, surroundings: Surroundings) -> Fitting:
        """Build the joystick."""
        measurements = [
            Measurement(
                QuantitySource(
                    node,
                    node.object_dictionary.variable(0x6401, number),
                    scale=INCREMENTS,
                    offset=0.0,
                    delta=DELTA,
                ).publish,
                deflection,
                name=f"{config.name}.{deflection.name}",
            )
            for number, deflection in enumerate(DEFLECTIONS, 1)
        ]

        def advance(now: int) -> None:
            time = now * 1e-9
            hand = interpolate(config.x, time), interpolate(config.y, time)
            for measurement in measurements:
                measurement.take(hand, now)

        return Fitting(
            sensors=tuple((None, measurement) for measurement in measurements),
            advance=advance,
            registers=lambda: {
                deflection.name: RegisterValue(deflection.unit, lambda each=each: each.measured)
                for deflection, each in zip(DEFLECTIONS, measurements, strict=True)
            },
        )


def interpolate(script: Script, time: float) -> float:
    """Return the deflection at a time [s]: linear between points, constant before and after."""
    after = bisect_right(script, time, key=lambda point: point[0])
    if after in {0, len(script)}:
        return script[max(after - 1, 0)][1]
    (begin, low), (end, high) = script[after - 1], script[after]
    return low + (high - low) * (time - begin) / (end - begin)


JOYSTICK = JoystickKind()
