"""The key figures of an axis, as lines."""

from collections.abc import Sequence

from hil_bench.bench.configuration import AxisConfig, BenchConfig
from hil_bench.plants.hydraulic_cylinder.supply_group import (
    Fed,
    SupplyConfig,
    summarise_supply,
)
from hil_bench.plants.kind import Fact


def facts_of(config: BenchConfig, axis: AxisConfig) -> Sequence[Fact]:
    """Return the key figures of an axis."""
    return axis.kind.summarise(axis, config.tick_ns // 1000, config.step_ns // 1000)


def facts_of_supply(config: BenchConfig, supply: SupplyConfig) -> Sequence[Fact]:
    """Return the key figures of a supply that axes share."""
    axes = [axis for axis in config.axes if axis.name in supply.axes and isinstance(axis, Fed)]
    return list(summarise_supply(supply, axes, config.dt))


def summary_lines(config: BenchConfig, axis: AxisConfig) -> list[str]:
    """Return the key figures of an axis as lines."""
    return fact_lines(facts_of(config, axis))


def fact_lines(facts: Sequence[Fact]) -> list[str]:
    """Return facts as lines: name, value with its unit, note."""
    width = max((len(fact.name) for fact in facts), default=0)
    return [
        f"{fact.name:{width}}  {_short(fact.value):>8} {fact.unit:6}  {fact.note}".rstrip()
        for fact in facts
    ]


def _short(value: float) -> str:
    """Return a number with four digits that count, and no exponent."""
    return f"{float(f'{value:.4g}'):.10g}"
