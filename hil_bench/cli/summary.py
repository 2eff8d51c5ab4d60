"""What an engineer checks first of an axis, as lines."""

from collections.abc import Sequence

from hil_bench.bench.configuration import AxisConfig, BenchConfig
from hil_bench.plants.kind import Fact


def facts_of(config: BenchConfig, axis: AxisConfig) -> Sequence[Fact]:
    """Return what an engineer checks first of an axis."""
    return axis.kind.summarise(axis, config.tick_ns // 1000, config.step_ns // 1000)


def summary_lines(config: BenchConfig, axis: AxisConfig) -> list[str]:
    """Return the same as lines: name, value with its unit, note."""
    facts = facts_of(config, axis)
    width = max((len(fact.name) for fact in facts), default=0)
    return [
        f"{fact.name:{width}}  {_short(fact.value):>8} {fact.unit:6}  {fact.note}".rstrip()
        for fact in facts
    ]


def _short(value: float) -> str:
    """Return a number with four digits that count, and no exponent."""
    return f"{float(f'{value:.4g}'):.10g}"
