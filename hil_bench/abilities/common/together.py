"""The plants of a bench that move at once, without its nodes: an axis, or all on one supply."""

from collections.abc import Mapping, Sequence
from typing import cast

from hil_bench.bench.configuration import BenchConfig
from hil_bench.plants.hydraulic_cylinder.supply_group import Fed, SupplyConfig, SupplyGroup
from hil_bench.plants.plant import AxisConfig, Plant


class Alone:
    """A plant that moves by itself.

    Args:
        plant: it.

    Attributes:
        plants: it.
    """

    def __init__(self, plant: Plant) -> None:
        self.plants = (plant,)

    def drive(self, commands: Sequence[float], steps: int) -> Sequence[Sequence[float]]:
        """Move it on."""
        return [self.plants[0].drive(commands[0], steps)]


def find_supply(config: BenchConfig, axis: AxisConfig) -> SupplyConfig | None:
    """Return the supply that an axis shares; None where it has one of its own."""
    return next((each for each in config.supplies if axis.name in each.axes), None)


def axes_with(config: BenchConfig, axis: AxisConfig) -> list[AxisConfig]:
    """Return an axis and those that share its supply, in the supply's order."""
    supply = find_supply(config, axis)
    by_name = {each.name: each for each in config.axes}
    return [axis] if supply is None else [by_name[name] for name in supply.axes]


def build_together(
    config: BenchConfig,
    axes: Sequence[AxisConfig],
    starts: Sequence[Mapping[str, float]] | None = None,
) -> Alone | SupplyGroup:
    """Return the plants of axes as `axes_with` gives them.

    Args:
        config: the bench.
        axes: of it.
        starts: states to begin with, by the names of quantities [SI]; None for rest.
    """
    supply = find_supply(config, axes[0])
    if supply is None:
        axis = axes[0]
        return Alone(axis.kind.build(axis, config.dt, starts[0] if starts else None))
    return SupplyGroup(supply, cast("Sequence[Fed]", axes), config.dt, starts)
