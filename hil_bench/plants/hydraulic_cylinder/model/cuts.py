"""Cuts of steps into parts: recorded in one run, and followed by others beside it.

A step that is cut in one run and whole in the next makes their difference jump: by some thousandths
of a sensor's noise, which is nothing for a run and all for a slope. So the runs beside a run, of
which slopes are taken, cut their steps where that one did (internal numerical differentiation: Bock
1981, Springer Series in Chemical Physics 18, 102-125).
"""

from hil_bench.plants.hydraulic_cylinder.model.constants import Constants
from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import Cylinder, Spool, try_step
from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel
from hil_bench.plants.hydraulic_cylinder.model.parts import (
    PARTS,
    RATIO,
    TOLERANCE,
    largest_part,
    place_between,
    shorten,
)

OPEN = -1
"""Stands for the cuts of a step that is still to be cut, as its error asks for."""

WHOLE = 0
"""The cuts of a step that is made at once: bit n - 1 is set where a part ends after n of 64."""


@kernel
def part_at(cuts: int, done: int) -> int:
    """Return the size of the part that begins after `done` parts of 64."""
    size = 1
    while done + size < PARTS and not (cuts >> (done + size - 1)) & 1:
        size *= RATIO
    return size


@kernel
def move_along(
    cylinder: Cylinder, spool: Spool, F_L: float, constants: Constants, cuts: int
) -> tuple[Cylinder, int]:
    """Return the cylinder one step later, and where the step was cut.

    Args:
        cylinder: at the start of the step.
        spool: its way over the step.
        F_L: external load [N].
        constants: in their groups.
        cuts: of the step; `OPEN` to find them as `move_cylinder` does.
    """
    is_open = cuts < 0
    done, size, made = 0, PARTS if is_open else part_at(cuts, 0), WHOLE
    while done < PARTS:
        way = (place_between(spool, done), place_between(spool, done + size))
        moved, error = try_step(cylinder, way, F_L, shorten(constants, size))
        if is_open and error > TOLERANCE and size > 1:
            size //= RATIO
        else:
            cylinder, done = moved, done + size
            if done < PARTS:
                made |= 1 << (done - 1)
                size = largest_part(done, size) if is_open else part_at(cuts, done)
    return cylinder, made
