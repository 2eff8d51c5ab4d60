"""The inputs of an FMU's axes from outside, with their neutral values."""

from typing import NamedTuple

from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.together import find_supply
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.supply_group import Fed
from hil_bench.plants.kind import AxisConfig
from hil_bench.plants.quantity import SUPPLY


class Acting(NamedTuple):
    """An input that acts on an axis.

    Attributes:
        name: in the FMU.
        influence: in the bench.
        axis: number of the axis in the FMU.
        unit: SI.
        start: value at the start.
    """

    name: str
    influence: str
    axis: int
    unit: str
    start: float


def prefixes(axes: list[AxisConfig]) -> list[str]:
    """Return the prefixes of each axis' names in an FMU: empty for a single axis."""
    return [""] if len(axes) == 1 else [f"{axis.name}." for axis in axes]


def find_inputs(config: BenchConfig, axes: list[AxisConfig]) -> list[Acting]:
    """Return the inputs that act on the axes of an FMU; those of a shared supply once.

    Raises:
        ConfigError: an axis is another plant than a cylinder or a motor.
    """
    supply = find_supply(config, axes[0])
    found: list[Acting] = []
    for number, (axis, prefix) in enumerate(zip(axes, prefixes(axes), strict=True)):
        if not isinstance(axis, Fed):
            right = "give an axis that is a hydraulic cylinder or a rotary"
            raise ConfigError(f"plant.{axis.name}: a {axis.kind.name} cannot be exported; {right}")
        for each in axis.influences:
            if each.name != SUPPLY:
                found.append(Acting(prefix + each.name, each.name, number, each.unit, 0.0))
            elif supply is None:
                start = axis.cylinder.parameters.P_S
                found.append(Acting(each.name, each.name, number, each.unit, start))
            elif number == 0:
                found.append(Acting(each.name, each.name, number, each.unit, supply.pressure))
    return found
