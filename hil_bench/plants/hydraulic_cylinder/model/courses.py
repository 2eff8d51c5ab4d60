"""Whole courses of motion of one plant, for whoever compares runs beside each other.

A course begins at rest, so the extensions with states of their own begin as a plant that starts
has them. Lines with waves and loads over time have more than that, and are not among them.
"""

from typing import cast

import numpy as np
import numpy.typing as npt

from hil_bench.plants.hydraulic_cylinder.model.batch import OPEN, SEEN, WHOLE, part_at
from hil_bench.plants.hydraulic_cylinder.model.constants import (
    Constants,
    ExtendedConstants,
    unpack,
    unpack_extended,
)
from hil_bench.plants.hydraulic_cylinder.model.extended_midpoint import Others, try_extended
from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import Cylinder, Spool
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel, long_kernel, make_row
from hil_bench.plants.hydraulic_cylinder.model.load import LoadSeries
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parts import (
    PARTS,
    RATIO,
    TOLERANCE,
    largest_part,
    place_between,
    shorten,
)
from hil_bench.plants.hydraulic_cylinder.model.spool import move_spool, orifice_state

Values = npt.NDArray[np.float64]
CourseCuts = npt.NDArray[np.int64]
"""Where each step of a course is cut, as `model.cuts` has it, shape (steps,)."""


def states_without_start(options: PlantOptions) -> list[str]:
    """List the extensions that are on and that a start at rest does not determine."""
    hidden = {
        "lines with waves": options.has_lines,
        "a load over time": any(isinstance(load, LoadSeries) for load in options.loads),
    }
    return [name for name, is_on in hidden.items() if is_on]


@kernel
def move_extended_along(
    cylinder: Cylinder,
    spool: Spool,
    others: Others,
    constants: Constants,
    extension: ExtendedConstants,
    cuts: int,
) -> tuple[Cylinder, Others, int]:
    """Return the cylinder and the other states one step later, and where the step was cut.

    Args:
        cylinder: at the start of the step.
        spool: its way over the step.
        others: bristles, supply and components at the start of the step.
        constants: in their groups.
        extension: those of the extensions.
        cuts: of the step, as `model.cuts` has them; `OPEN` to find them.
    """
    is_open = cuts < 0
    done, size, made = 0, PARTS if is_open else part_at(cuts, 0), WHOLE
    while done < PARTS:
        way = (place_between(spool, done), place_between(spool, done + size))
        moved, reached, error = try_extended(
            cylinder, way, extension[3][0], others, shorten(constants, size), extension
        )
        if is_open and error > TOLERANCE and size > 1:
            size //= RATIO
        else:
            cylinder, others, done = moved, reached, done + size
            if done < PARTS:
                made |= 1 << (done - 1)
                size = largest_part(done, size) if is_open else part_at(cuts, done)
    return cylinder, others, made


@long_kernel
def follow_course(
    start: Floats, constants: Floats, setpoints: Floats, cuts: CourseCuts, seen: Floats, every: int
) -> None:
    """Run a plant along its set-points.

    Args:
        start: the fields of `PlantState`, then P_S, which becomes that at the end, openings of the
            counterbalance valves, Q_P.
        constants: as `pack_extended` gives them.
        setpoints: u of each step [m].
        cuts: of each step, which are followed; what is `OPEN` is found and taken down.
        seen: takes, after each `every`-th step, the fields of `SEEN`.
        every: steps between two rows.
    """
    groups, extension = unpack(constants), unpack_extended(constants)
    cylinder = (start[0], start[1], start[2], start[3], start[6], start[7])
    nu, nu_dot = start[4], start[5]
    others = (0.0, start[8], (start[9], start[10], start[11]))
    for step in range(len(setpoints)):
        before = nu
        nu, nu_dot = move_spool(nu, nu_dot, setpoints[step], groups[3])
        cylinder, others, made = move_extended_along(
            cylinder, (before, nu), others, groups, extension, cuts[step]
        )
        cuts[step] = made
        if (step + 1) % every == 0:
            place = ((step + 1) // every - 1) * 5
            seen[place], seen[place + 1] = cylinder[0], cylinder[1]
            seen[place + 2], seen[place + 3] = cylinder[2], cylinder[3]
            seen[place + 4] = orifice_state(nu, groups[2])
    start[8] = others[1]


def run_course(
    constants: Floats, start: Values, setpoints: Values, *, every: int, cuts: CourseCuts
) -> tuple[Values, float]:
    """Run a plant along its set-points; other threads run meanwhile.

    Args:
        constants: as `pack_extended` gives them, without `states_without_start`; not checked here.
        start: the fields of `PlantState`, then P_S, openings of the counterbalance valves, Q_P.
        setpoints: u of each step, shape (steps,) [m].
        every: steps between two rows.
        cuts: of each step, which are followed; what is `OPEN` there is found and taken down.

    Returns:
        The fields of `SEEN` after each `every`-th step, shape (steps // every, 5), and P_S [Pa] at
        the end.
    """
    seen = np.empty((len(setpoints) // every, len(SEEN)))
    row = make_row(start.tolist())
    follow_course(
        row,
        constants,
        cast("Floats", setpoints),
        cuts,
        cast("Floats", seen.reshape(-1)),
        every,
    )
    return seen, row[8]


def open_cuts(steps: int) -> CourseCuts:
    """Return cuts that are all still to be found."""
    return np.full(steps, OPEN, dtype=np.int64)
