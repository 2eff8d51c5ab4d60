"""Many plants at once: the bench's solver on blocks of plants, side by side in vector registers.

A block holds one number of each plant, then the next number: so the compiler turns the very kernels
of a single plant into vector instructions, and each plant of a batch gives the same bits as alone.
A block stays in the processor's first cache for all steps of a run. A plant whose step is made in
parts (`model.parts`) makes it alone, after the others.
"""

import math
from collections.abc import Sequence
from typing import cast

import numpy as np
import numpy.typing as npt

from hil_bench.plants.hydraulic_cylinder.model.constants import ROW, Constants, pack, unpack_lane
from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import Cylinder, Spool, try_step
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel, long_kernel
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
from hil_bench.plants.hydraulic_cylinder.model.side_by_side import cylinder_among, try_among
from hil_bench.plants.hydraulic_cylinder.model.spool import orifice_state
from hil_bench.plants.hydraulic_cylinder.model.state import PlantState

# Cuts of steps into parts: recorded in one run, and followed by others beside it.
#
# A step that is cut in one run and whole in the next makes their difference jump: by some
# thousandths of a sensor's noise, which is nothing for a run and all for a slope. So the runs
# beside a run, of which slopes are taken, cut their steps where that one did (internal
# numerical differentiation: Bock 1981, Springer Series in Chemical Physics 18, 102-125).


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


LANES = 16
"""Plants in a block: two registers of eight, so that one hides the latency of the other."""

SEEN = ("x", "v", "P_A", "P_B", "z")
"""What a batch shows of each plant, as in `model.state.PlantOutput`."""

_STATES = len(PlantState._fields)
_SETPOINT = _STATES  # its place in the block, after the states
_CONSTANTS = _STATES + 1
_NEXT = _CONSTANTS + ROW  # the states at the end of a step, and the error of the velocity
_PLACES = _NEXT + _STATES + 1

Values = npt.NDArray[np.float64]
PlantSet = Sequence[tuple[PlantParameters, PlantOptions, PlantState]]
"""What each plant is, and where it starts."""


def pack_block(plants: PlantSet, dt: float) -> Values:
    """Return a block of at most `LANES` plants; what is left is filled with the last one.

    Args:
        plants: without extensions.
        dt: step [s].
    """
    rows = [[*state, 0.0, *pack(parameters, options, dt)] for parameters, options, state in plants]
    block = np.zeros((_PLACES, LANES))
    block[:_NEXT, : len(rows)] = np.array(rows, dtype=np.float64).T
    block[:_NEXT, len(rows) :] = block[:_NEXT, len(rows) - 1, np.newaxis]
    return block.reshape(-1)


@kernel
def try_lane(block: Floats, lane: int) -> tuple[Cylinder, float, float, float]:
    """Return the cylinder, nu and nu_dot of one plant a step later, and the velocity's error."""
    constants = unpack_lane(block, _CONSTANTS * LANES + lane, LANES)
    return try_among(block, lane, LANES, block[_SETPOINT * LANES + lane], 0.0, constants)


@kernel
def move_lane(block: Floats, lane: int) -> Cylinder:
    """Return the cylinder of one plant a step later, made in parts."""
    constants = unpack_lane(block, _CONSTANTS * LANES + lane, LANES)
    spool = (block[4 * LANES + lane], block[(_NEXT + 4) * LANES + lane])
    return move_along(cylinder_among(block, lane, LANES), spool, 0.0, constants, OPEN)[0]


@kernel
def show_block(block: Floats, seen: Floats, row: int) -> None:
    """Write what is seen of each plant of a block as a row of `seen`."""
    for lane in range(LANES):
        constants = unpack_lane(block, _CONSTANTS * LANES + lane, LANES)
        place = row * len(SEEN) * LANES + lane
        for field in range(4):
            seen[place + field * LANES] = block[field * LANES + lane]
        seen[place + 4 * LANES] = orifice_state(block[4 * LANES + lane], constants[2])


@long_kernel
def run_block(block: Floats, setpoints: Floats, seen: Floats, steps: int, every: int) -> None:
    """Run a block of plants under set-points of their own, in place.

    Args:
        block: as `pack_block` gives it.
        setpoints: u [m] of each plant for the first step, then for the next, and so on.
        seen: takes, after each `every`-th step, each field of `SEEN` of all plants.
        steps: how many.
        every: steps between two rows.
    """
    first = _NEXT * LANES
    for step in range(steps):
        for lane in range(LANES):
            block[_SETPOINT * LANES + lane] = setpoints[step * LANES + lane]
        for lane in range(LANES):
            (x, v, P_A, P_B, V_CA, V_CB), nu, nu_dot, error = try_lane(block, lane)
            block[first + lane], block[first + LANES + lane] = x, v
            block[first + 2 * LANES + lane], block[first + 3 * LANES + lane] = P_A, P_B
            block[first + 4 * LANES + lane], block[first + 5 * LANES + lane] = nu, nu_dot
            block[first + 6 * LANES + lane], block[first + 7 * LANES + lane] = V_CA, V_CB
            block[first + _STATES * LANES + lane] = error
        for lane in range(LANES):
            error = block[first + _STATES * LANES + lane]
            if error == math.inf or error > TOLERANCE:
                x, v, P_A, P_B, V_CA, V_CB = move_lane(block, lane)
                block[first + lane], block[first + LANES + lane] = x, v
                block[first + 2 * LANES + lane], block[first + 3 * LANES + lane] = P_A, P_B
                block[first + 6 * LANES + lane], block[first + 7 * LANES + lane] = V_CA, V_CB
        for place in range(_STATES * LANES):
            block[place] = block[first + place]
        if (step + 1) % every == 0:
            show_block(block, seen, (step + 1) // every - 1)


def run_plants(plants: PlantSet, setpoints: Values, *, dt: float, every: int = 1) -> Values:
    """Run at most `LANES` plants on the linearly implicit midpoint rule.

    Args:
        plants: without extensions; their parameters, options and states are not checked here.
        setpoints: u [m] of each plant, shape (plants, steps).
        dt: step [s].
        every: steps between two rows.

    Returns:
        The fields of `SEEN` after each `every`-th step, shape (plants, steps // every, 5).
    """
    block = pack_block(plants, dt)
    return _run(block, spread_setpoints(setpoints), every)[: len(plants)]


def spread_setpoints(setpoints: Values) -> Values:
    """Return set-points of at most `LANES` plants as the blocks want them, shape (steps, LANES).

    Args:
        setpoints: u [m] of each plant, shape (plants, steps).
    """
    count, steps = setpoints.shape
    lanes = np.empty((steps, LANES))
    lanes[:, :count] = setpoints.T
    lanes[:, count:] = setpoints[-1, :, np.newaxis]
    return lanes


def _run(block: Values, lanes: Values, every: int) -> Values:
    """Run a block and return the outputs of all its lanes, shape (LANES, rows, 5)."""
    steps = len(lanes)
    seen = np.empty((steps // every, len(SEEN), LANES))
    run_block(
        cast("Floats", block),
        cast("Floats", lanes.reshape(-1)),
        cast("Floats", seen.reshape(-1)),
        steps,
        every,
    )
    return seen.transpose(2, 0, 1)
