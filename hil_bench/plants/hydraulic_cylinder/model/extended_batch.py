"""Runs of one plant with extensions from many starts, for whoever compares runs beside each other.

Extensions with states of their own would need their starts, too; loads, air in the oil, metering
lands, leakage to the tank, compensator and cushions have none.
"""

from typing import cast

import numpy as np
import numpy.typing as npt

from hil_bench.plants.hydraulic_cylinder.model.batch import LANES, SEEN, Cuts
from hil_bench.plants.hydraulic_cylinder.model.constants import Constants, unpack
from hil_bench.plants.hydraulic_cylinder.model.cuts import OPEN, WHOLE, part_at
from hil_bench.plants.hydraulic_cylinder.model.extended_constants import (
    ExtendedConstants,
    pack_extended,
    unpack_extended,
)
from hil_bench.plants.hydraulic_cylinder.model.extended_midpoint import Others, try_extended
from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import Cylinder, Spool
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel, long_kernel, make_row
from hil_bench.plants.hydraulic_cylinder.model.loads import LoadSeries
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.parts import (
    PARTS,
    RATIO,
    TOLERANCE,
    largest_part,
    place_between,
    shorten,
)
from hil_bench.plants.hydraulic_cylinder.model.spool import move_spool, orifice_state
from hil_bench.plants.hydraulic_cylinder.model.state import PlantState

Values = npt.NDArray[np.float64]

_STATES = len(PlantState._fields)


def states_without_start(options: PlantOptions) -> list[str]:
    """Return the extensions that are on and that a start of six states does not determine."""
    hidden = {
        "LuGre friction": options.bristles is not None,
        "the supply unit": options.supply is not None,
        "the counterbalance valve": options.counterbalance is not None,
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
def run_extended_lane(
    start: Floats,
    constants: Floats,
    setpoints: Floats,
    cuts: Cuts,
    seen: Floats,
    lane: int,
    every: int,
) -> None:
    """Run a plant from one start.

    Args:
        start: the fields of `PlantState`, then P_S.
        constants: as `pack_extended` gives them.
        setpoints: u [m] of each step and lane.
        cuts: likewise, which are followed; what is `OPEN` is found and taken down. Empty: all are
            found, and none is kept.
        seen: takes, after each `every`-th step, the fields of `SEEN`.
        lane: of the set-points and cuts.
        every: steps between two rows.
    """
    steps = len(setpoints) // LANES
    groups, extension = unpack(constants), unpack_extended(constants)
    keeps = len(cuts) > 0
    cylinder = (start[0], start[1], start[2], start[3], start[6], start[7])
    nu, nu_dot = start[4], start[5]
    others = (0.0, start[8], (0.0, 0.0, 0.0))
    for step in range(steps):
        before = nu
        nu, nu_dot = move_spool(nu, nu_dot, setpoints[step * LANES + lane], groups[3])
        known = cuts[step * LANES + lane] if keeps else OPEN
        cylinder, others, made = move_extended_along(
            cylinder, (before, nu), others, groups, extension, known
        )
        if keeps:
            cuts[step * LANES + lane] = made
        if (step + 1) % every == 0:
            place = ((step + 1) // every - 1) * 5
            seen[place], seen[place + 1] = cylinder[0], cylinder[1]
            seen[place + 2], seen[place + 3] = cylinder[2], cylinder[3]
            seen[place + 4] = orifice_state(nu, groups[2])


def run_extended_starts(
    plant: tuple[PlantParameters, PlantOptions],
    starts: Values,
    setpoints: Values,
    *,
    dt: float,
    every: int,
    cuts: Cuts,
) -> Values:
    """Run a plant with extensions from at most `LANES` states, as `model.batch.run_starts` does.

    Args:
        plant: without `states_without_start`; it is not checked here.
        starts: the fields of `PlantState`, shape (starts, 8); without cavities (starts, 6).
        setpoints: as `model.batch.spread_setpoints` gives them.
        dt: step [s].
        every: steps between two rows.
        cuts: are followed; what is `OPEN` there is found and taken down. Empty: none is kept.

    Returns:
        The fields of `SEEN` after each `every`-th step, shape (starts, steps // every, 5).
    """
    parameters, options = plant
    constants = make_row(pack_extended(parameters, options, dt))
    steps = len(setpoints)
    seen = np.empty((len(starts), steps // every, len(SEEN)))
    given, taken = setpoints.reshape(-1), cuts.reshape(-1)
    for lane, state in enumerate(starts.tolist()):
        cavities = [0.0] * (_STATES - len(state))
        run_extended_lane(
            make_row([*state, *cavities, parameters.P_S]),
            constants,
            cast("Floats", given),
            taken,
            cast("Floats", seen[lane].reshape(-1)),
            lane,
            every,
        )
    return seen
