"""The parts in which the default solver makes a step, one by one."""

from collections.abc import Callable, Iterator
from typing import TypeVar

from hil_bench.plants.hydraulic_cylinder.model.constants import Constants
from hil_bench.plants.hydraulic_cylinder.model.parts import (
    PARTS,
    RATIO,
    TOLERANCE,
    largest_part,
    place_between,
    shorten,
)

State = TypeVar("State")
Spool = tuple[float, float]


def made_parts(
    attempt: Callable[[State, Spool, Constants], tuple[State, float]],
    start: State,
    spool: Spool,
    constants: Constants,
) -> Iterator[tuple[State, State, Spool, float]]:
    """Yield state before and after, way of the spool and duration of each part of a step.

    Args:
        attempt: makes a part and estimates its error.
        start: state at the start of the step.
        spool: spool position at the start and at the end of the step [m].
        constants: of the step, in their groups.
    """
    done, size = 0, PARTS
    while done < PARTS:
        way = (place_between(spool, done), place_between(spool, done + size))
        moved, error = attempt(start, way, shorten(constants, size))
        if error > TOLERANCE and size > 1:
            size //= RATIO
            continue
        yield start, moved, way, constants[0][0] * size / PARTS
        start, done = moved, done + size
        size = largest_part(done, size)
