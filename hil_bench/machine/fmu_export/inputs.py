"""What acts on an axis from outside, with the values at which nothing does."""

from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.configuration import (
    CylinderConfig,
    require_own_supply,
)
from hil_bench.plants.kind import AxisConfig
from hil_bench.plants.quantity import SUPPLY
from hil_bench.plants.rotary.configuration import RotaryConfig


def input_starts(axis: AxisConfig) -> dict[str, float]:
    """Return the influences of an axis with their values at the start [SI].

    Raises:
        ConfigError: it is another plant than a cylinder or a motor, or shares its supply.
    """
    if isinstance(axis, RotaryConfig):
        cylinder = axis.cylinder
    elif isinstance(axis, CylinderConfig):
        cylinder = axis
    else:
        right = "give an axis that is a hydraulic cylinder or a rotary"
        raise ConfigError(f"plant.{axis.name}: a {axis.kind.name} cannot be exported; {right}")
    require_own_supply(axis, "an FMU")
    supply = cylinder.parameters.P_S
    return {each.name: supply if each.name == SUPPLY else 0.0 for each in axis.influences}
