"""Checks of the columns that requirements name: units that they can be judged in."""

from collections.abc import Iterable, Iterator
from dataclasses import fields

from hil_bench.abilities.scenario.dimensions import NUMBER
from hil_bench.abilities.scenario.nodes import (
    Arithmetic,
    Comparison,
    Node,
    Number,
    Operation,
    Value,
)
from hil_bench.abilities.scenario.reach import names_in
from hil_bench.abilities.scenario.resolve import Requirement
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import Recording
from hil_bench.outside.recording.column_units import check_quantities, given_units
from hil_bench.units import ONE, read_unit


def check_columns(requirements: Iterable[Requirement], recording: Recording, source: str) -> None:
    """Refuse to judge columns whose unit is none of their quantity, or that a number leaves open.

    Args:
        requirements: which.
        recording: in the bench's units.
        source: how messages name it.

    Raises:
        ConfigError: a unit contradicts; or a number without a unit is compared with a column that
            the file has in %, deg or another unit, of which it might be meant to be.
    """
    given = {name: unit for name, unit in given_units(recording).items() if not _is_one(unit)}
    for each in requirements:
        try:
            check_quantities(recording, names_in([each.condition]))
        except ConfigError as error:
            raise ConfigError(f"{source}: {each.id}: {error}") from None
        for comparison in _comparisons(each.condition):
            names = names_in([comparison]) & given.keys()
            if names and comparison.dimension == NUMBER and _has_plain_number(comparison):
                name = min(names)
                raise ConfigError(
                    f'{source}: {each.id}: {name} is in "{given[name]}" there, and is compared '
                    "with a number without a unit; give the number its unit"
                )


def _is_one(symbol: str) -> bool:
    """Return True if a unit is that of a plain number, as in ``1``."""
    unit = read_unit(symbol)
    return unit is not None and (unit.symbol, unit.factor) == (ONE.symbol, 1.0)


def _comparisons(condition: Node) -> Iterator[Comparison]:
    waiting: list[object] = [condition]
    while waiting:
        node = waiting.pop()
        if isinstance(node, Comparison):
            yield node
        elif isinstance(node, Node):
            waiting += (getattr(node, each.name) for each in fields(node))
        elif isinstance(node, tuple):
            waiting += node


def _has_plain_number(comparison: Comparison) -> bool:
    sides = (comparison.left, comparison.right)
    return not comparison.symbol and any(term != 0.0 for side in sides for term in _terms(side))


def _terms(value: Value) -> Iterator[float]:
    """Yield the numbers that are summands: what multiplies a signal has no unit."""
    if isinstance(value, Number):
        yield value.value
    elif isinstance(value, Arithmetic) and value.operation in {Operation.ADD, Operation.SUBTRACT}:
        yield from _terms(value.left)
        yield from _terms(value.right)
